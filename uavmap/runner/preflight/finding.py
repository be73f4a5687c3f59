"""A finding: what was examined before a flight, what was found, what is wanted, what to do."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from enum import Enum
from typing import Any


class Level(Enum):
    """How bad it is."""

    OK = "ok"
    WARN = "warn"
    """The mission can be flown; somebody should know."""
    BAD = "bad"
    """The mission cannot be flown, or should not be."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at."""

    what: str
    """The thing: a parameter by its name, or a word such as "GPS"."""
    level: Level
    found: str
    wanted: str = ""
    remedy: str = ""
    vehicle: int | None = None
    """By its number in the mission, from 1; None: of this computer."""
    binding: bool = False
    """Whether a bad one keeps everybody on the ground, whatever the operator says."""

    def line(self) -> str:
        """In a line.

        >>> Finding("GPS", Level.BAD, "no fix", "a 3D fix", "wait", vehicle=1).line()
        'bad   1 GPS: no fix (wanted: a 3D fix); wait'
        """
        of = "" if self.vehicle is None else f"{self.vehicle} "
        wanted = f" (wanted: {self.wanted})" if self.wanted and self.level is not Level.OK else ""
        remedy = f"; {self.remedy}" if self.remedy and self.level is not Level.OK else ""
        return f"{self.level.value:<5} {of}{self.what}: {self.found}{wanted}{remedy}"

    def as_json(self) -> dict[str, Any]:
        """For `--json`."""
        return {**asdict(self), "level": self.level.value}


def ok(what: str, found: str) -> Finding:
    """Nothing to say against it."""
    return Finding(what, Level.OK, found)


def warn(what: str, found: str, wanted: str, remedy: str) -> Finding:
    """Worth to be known."""
    return Finding(what, Level.WARN, found, wanted, remedy)


def bad(what: str, found: str, wanted: str, remedy: str, *, binding: bool = False) -> Finding:
    """Not to be flown with."""
    return Finding(what, Level.BAD, found, wanted, remedy, binding=binding)


def could_fly(findings: Iterable[Finding]) -> bool:
    """Whether nothing bad is among them."""
    return all(finding.level is not Level.BAD for finding in findings)


def binding(findings: Iterable[Finding]) -> Iterator[Finding]:
    """The bad ones that nobody can pass over."""
    return (f for f in findings if f.level is Level.BAD and f.binding)


def of_vehicle(number: int, findings: Iterable[Finding]) -> list[Finding]:
    """The findings as those of a vehicle."""
    return [replace(finding, vehicle=number) for finding in findings]
