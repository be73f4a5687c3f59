"""A damaged journal: what of it is good, and how a flight goes on from there."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

from missions.errors import JournalError
from missions.events import Event
from uavmap.journal.event_log import JournalReader, install, lock


@dataclass(frozen=True, slots=True)
class Found:
    """What can be read of a journal in whatever state it is."""

    path: Path
    meta: Mapping[str, Any]
    events: tuple[Event, ...]
    trouble: str | None = None
    """Why there may be more, or was."""


def read_journal(path: Path) -> Found:
    """Read the good lines of a journal. Raises `JournalError` where not even the plan is good."""
    reader = JournalReader(path)
    trouble: str | None = None
    try:
        os.close(lock(path))
    except JournalError:
        trouble = "its flight is still under way"
    events: list[Event] = []
    try:
        while piece := reader.new_events():
            events.extend(piece)
    except JournalError:
        trouble = "its journal is damaged"
    return Found(path, reader.meta, tuple(events), trouble)


@dataclass(frozen=True, slots=True)
class Recovery:
    """What a recovery did."""

    aside: Path
    """Where the damaged journal lies now, as it was."""
    kept: int
    lost: int
    """Events of which there was a trace at least; there may have been more."""


def recover(path: Path) -> Recovery | None:
    """Put the good beginning of a damaged journal in its place, and a copy of the damaged one
    beside it. Returns None where there is nothing to recover.

    A process that is killed in here leaves the damaged journal in its place, or the recovered one.
    Raises `JournalError` where the flight plan cannot be read; everything is left as it is then.
    """
    reader = JournalReader(path)
    held = lock(path)
    try:
        try:
            for _ in reader.events():
                pass
        except JournalError:
            return _recovered(path, reader)
        return None
    except OSError as error:
        raise JournalError(f"{path} cannot be recovered: {error.strerror}") from None
    finally:
        os.close(held)


def _recovered(path: Path, reader: JournalReader) -> Recovery:
    names = (path.with_name(f"{path.stem}.damaged-{n}{path.suffix}") for n in count(1))
    aside = next(name for name in names if not name.exists())
    data, good = path.read_bytes(), reader.position
    install(aside, data)
    install(path, data[: good.offset])
    return Recovery(aside, good.events, data[good.offset :].count(b',"event":{'))
