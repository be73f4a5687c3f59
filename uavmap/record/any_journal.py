"""What a journal holds, in whatever state it is: whole, still being written, or cut short.

For who only reads: nothing is changed, and nothing is gone on with.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from missions.errors import JournalError
from missions.events import Event, from_json
from uavmap.record.journal_file import lock
from uavmap.record.reading import JournalReader
from uavmap.record.salvage import salvage
from uavmap.record.verification import read_both, verify


@dataclass(frozen=True, slots=True)
class Found:
    """What was read."""

    meta: Mapping[str, str]
    """As texts of JSON."""
    events: tuple[Event, ...]
    trouble: str | None = None
    """Why there may be more, or was."""


def read_journal(path: Path) -> Found:
    """All that can be read of a journal. Raises `JournalError` where that is not even its plan."""
    if not path.is_file():
        raise JournalError(
            f"{path.parent}: there is no journal here; give the folder that a flight wrote to"
        )
    try:
        held = lock(path)
    except JournalError:
        return _read(path, "its flight is still under way")
    try:
        verify(path)
        return _read(path, None)
    except JournalError as damage:
        return _good_beginning(path, damage)
    finally:
        os.close(held)


def _read(path: Path, trouble: str | None) -> Found:
    reader = JournalReader(path)
    events: list[Event] = []
    while piece := reader.new_events():
        events.extend(piece)
    meta = {key: json.dumps(value) for key, value in reader.meta.items()}
    return Found(meta, tuple(events), trouble)


def _good_beginning(path: Path, damage: JournalError) -> Found:
    """The events up to where the checksums fail."""
    good = salvage(*read_both(path))
    if good is None or not good.events:
        raise JournalError(f"{damage}; or leave it out: nothing in it can be used")
    events = tuple(from_json(row.body) for row in good.events)
    return Found(dict(good.meta), events, "its journal is damaged")
