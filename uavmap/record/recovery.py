"""A journal from the good beginning of a damaged one.

The new journal is built whole, and takes a name of its own, `journal.recovered-1.db`. From then on
the recovery is decided, and only names change: the damaged file moves aside with its log
(`journal.damaged-1.db`), the new one takes its place. A process that dies in between leaves that
for the next recovery to finish.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Final

from missions.errors import JournalError
from uavmap.record.flight_plan import FlightPlan
from uavmap.record.journal_file import SIDES, EventRow, beside, build, lock, to_disk
from uavmap.record.salvage import Salvaged, salvage
from uavmap.record.verification import read_both, verify

_RECOVERED: Final = "recovered"
_DAMAGED: Final = "damaged"


@dataclass(frozen=True, slots=True)
class Recovery:
    """What a recovery did."""

    aside: Path
    """Where the damaged journal lies now, as it was."""
    kept: int
    lost: int
    """Events of which there was a trace at least; there may have been more."""


def recover(path: Path) -> Recovery | None:
    """Put the good beginning of a damaged journal in its place, and the damaged one aside.

    Returns None where there is nothing to mend, or where an interrupted recovery was finished.

    Raises `JournalError` where the flight plan cannot be read; everything is left as it is then.
    """
    try:
        if not path.parent.is_dir():
            raise JournalError(f"{path}: there is no journal here")
    except OSError as error:
        raise JournalError(f"{path} cannot be opened: {error.strerror}") from None
    held = lock(path)
    try:
        if (begun := interrupted_recovery(path)) is not None:
            _finish(path, begun)
            return None
        if not path.is_file():
            raise JournalError(f"{path}: there is no journal here")
        try:
            verify(path)
        except JournalError:
            return _recover(path)
        return None
    except OSError as error:
        raise JournalError(f"{path} cannot be recovered: {error.strerror}") from None
    finally:
        os.close(held)


def interrupted_recovery(path: Path) -> int | None:
    """The number of a recovery that is decided and not finished."""
    folder = path.parent
    names = {p.name for p in folder.iterdir()} if folder.is_dir() else set()
    for number in range(1, len(names) + 1):
        if _named(path, _RECOVERED, number).name in names:
            return number
    return None


def _recover(path: Path) -> Recovery:
    good = salvage(*read_both(path))
    if good is None:
        raise JournalError(
            f"{path}: no flight plan can be read in it, so nothing can go on; left as it is"
        )
    events = tuple(_of_known_vehicles(good, path))
    number = next(n for n in count(1) if not _named(path, _DAMAGED, n).exists())
    temporary = build(path, good.meta, events)
    os.rename(temporary, _named(path, _RECOVERED, number))
    to_disk(path.parent)
    _finish(path, number)
    return Recovery(_named(path, _DAMAGED, number), len(events), good.seen - len(events))


def _of_known_vehicles(good: Salvaged, path: Path) -> Iterator[EventRow]:
    """The events up to the first of a vehicle that the mission does not have."""
    vehicles = len(FlightPlan.of_meta(good.meta, path).mission.vehicles)
    for event in good.events:
        if event.vehicle is not None and not 1 <= event.vehicle <= vehicles:
            return
        yield event


def _finish(path: Path, number: int) -> None:
    """Change the names; each step may have been done before."""
    aside = _named(path, _DAMAGED, number)
    # the log first: without its journal nothing reads it, and nothing is read without it
    for side in reversed(SIDES):
        if beside(path, side).exists() and not beside(aside, side).exists():
            os.rename(beside(path, side), beside(aside, side))
    to_disk(path.parent)
    os.rename(_named(path, _RECOVERED, number), path)
    to_disk(path.parent)


def _named(path: Path, what: str, number: int) -> Path:
    return path.with_name(f"{path.stem}.{what}-{number}{path.suffix}")
