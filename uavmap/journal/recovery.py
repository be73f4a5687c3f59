"""The recovery of a damaged journal: its good part, from which a flight continues."""

from __future__ import annotations

import os
from dataclasses import dataclass
from itertools import count
from pathlib import Path

from missions.errors import JournalError
from missions.events import Event
from uavmap.journal.event_log import JournalReader, install, lock


def good_events(reader: JournalReader) -> tuple[list[Event], str | None]:
    """Return the events before the first damage, and why there may be more, if there may."""
    trouble: str | None = None
    try:
        os.close(lock(reader.path))
    except JournalError:
        trouble = "its flight is still under way"
    events: list[Event] = []
    try:
        events.extend(reader.events())
    except JournalError:
        trouble = "its journal is damaged"
    return events, trouble


@dataclass(frozen=True, slots=True)
class Recovery:
    """The result of a recovery."""

    aside: Path
    """Copy of the damaged journal."""
    kept: int
    lost: int
    """Number of lost events with a trace; there may have been more."""


def recover(path: Path) -> Recovery | None:
    """Replace a damaged journal by its good beginning, beside a copy of it; None without damage.

    A process that is killed in here leaves the damaged journal in its place, or the recovered one.
    Raises `JournalError`, and changes nothing, if the flight plan cannot be read.
    """
    reader = JournalReader(path)
    held = lock(path)
    try:
        try:
            reader.bodies()
        except JournalError:
            names = (path.with_name(f"{path.stem}.damaged-{n}{path.suffix}") for n in count(1))
            aside = next(name for name in names if not name.exists())
            data, good = path.read_bytes(), reader.position
            install(aside, data)
            install(path, data[: good.offset])
            return Recovery(aside, good.events, data[good.offset :].count(b',"event":{'))
        return None
    except OSError as error:
        raise JournalError(f"{path} cannot be recovered: {error.strerror}") from None
    finally:
        os.close(held)
