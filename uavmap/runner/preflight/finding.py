"""A finding: an examined thing before a flight, its value, the wanted value, the remedy."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from enum import Enum
from typing import Any, Final


class Level(Enum):
    """The severity of a finding."""

    OK = "ok"
    WARN = "warn"
    """The mission can be flown; the crew should know."""
    BAD = "bad"
    """The mission cannot be flown, or should not be."""


_LINE: Final = re.compile(r"(ok|warn|bad) +(?:(\d+) )?(.+?): (.*)")
_WANTED: Final = re.compile(r"(.*?) \(wanted: (.*)\)(?:; (.*))?")
_PLAIN: Final = re.compile(r"(.*?)()(?:; (.*))?")


@dataclass(frozen=True, slots=True)
class Finding:
    """One examined thing."""

    what: str
    """Name of the thing: a parameter, or a word such as "GPS"."""
    level: Level
    found: str
    wanted: str = ""
    remedy: str = ""
    vehicle: int | None = None
    """Number of its vehicle in the mission, from 1; None for this computer."""
    binding: bool = False
    """True if a bad one keeps all vehicles on the ground, whatever the operator answers."""

    def line(self) -> str:
        """Return it as a line.

        >>> Finding("GPS", Level.BAD, "no fix", "a 3D fix", "wait", vehicle=1).line()
        'bad   1 GPS: no fix (wanted: a 3D fix); wait'
        """
        of = "" if self.vehicle is None else f"{self.vehicle} "
        wanted = f" (wanted: {self.wanted})" if self.wanted and self.level is not Level.OK else ""
        remedy = f"; {self.remedy}" if self.remedy and self.level is not Level.OK else ""
        return f"{self.level.value:<5} {of}{self.what}: {self.found}{wanted}{remedy}"

    @classmethod
    def read(cls, line: str) -> Finding | None:
        """Read a finding from its line; None for another line.

        >>> Finding.read("bad   1 GPS: no fix (wanted: a 3D fix); wait")
        Finding(what='GPS', level=<Level.BAD: 'bad'>, found='no fix', wanted='a 3D fix',
        remedy='wait', vehicle=1, binding=False)
        """
        parts = _LINE.fullmatch(line)
        if parts is None:
            return None
        level, vehicle, what, found = parts.groups()
        wanted = remedy = ""
        if level != Level.OK.value and (
            parts := _WANTED.fullmatch(found) or _PLAIN.fullmatch(found)
        ):
            found, wanted, remedy = (part or "" for part in parts.groups())
        of = None if vehicle is None else int(vehicle)
        return cls(what, Level(level), found, wanted, remedy, of)

    def as_json(self) -> dict[str, Any]:
        """Return it for `--json`."""
        return {**asdict(self), "level": self.level.value}


def ok(what: str, found: str) -> Finding:
    """Return a finding without a fault."""
    return Finding(what, Level.OK, found)


def warn(what: str, found: str, wanted: str, remedy: str) -> Finding:
    """Return a finding that the crew should know."""
    return Finding(what, Level.WARN, found, wanted, remedy)


def bad(what: str, found: str, wanted: str, remedy: str, *, binding: bool = False) -> Finding:
    """Return a finding that forbids the flight."""
    return Finding(what, Level.BAD, found, wanted, remedy, binding=binding)


def could_fly(findings: Iterable[Finding]) -> bool:
    """Return whether none of them is bad."""
    return all(finding.level is not Level.BAD for finding in findings)


def binding(findings: Iterable[Finding]) -> Iterator[Finding]:
    """Yield the bad ones that no operator can override."""
    return (f for f in findings if f.level is Level.BAD and f.binding)


def for_vehicle(number: int, findings: Iterable[Finding]) -> list[Finding]:
    """Return the findings as those of a vehicle."""
    return [replace(finding, vehicle=number) for finding in findings]
