"""Journals for tests: of a mission that can be flown, of the present version and of the first."""

from __future__ import annotations

import contextlib
import hashlib
import json
import sqlite3
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from missions.events import Event, FrameSeen, Tracked, Vote, to_json
from missions.units import Cell, GridPoint
from tests.plans import named_text, plan_of
from uavmap.record.flight_plan import SIM_EPOCH_UTC_S
from uavmap.record.journal import Journal
from uavmap.record.journal_file import APPLICATION_ID, SCHEMAS

SOURCE = named_text("runway")
PLAN = plan_of(
    SOURCE.source,
    SOURCE.text + "# é\n",
    strategy=None,
    vehicles=None,
    seed=7,
    urls=(),
    speedup=None,
    epoch_utc_s=SIM_EPOCH_UTC_S,
)
META: dict[str, Any] = {"plan": json.loads(json.dumps(PLAN.as_json()))}
"""As it is read back: a tuple is a list in JSON."""


def some_events(count: int) -> list[Event]:
    """Twice so many events."""
    events: list[Event] = []
    for n in range(count):
        place = GridPoint(0.01 * n, -3.25)
        events.append(Tracked(1, n + 0.125, place, 12.0, 59.9))
        vote = Vote(Cell(n, -n), n % 2 == 0, 0.333)
        events.append(FrameSeen(1, n + 0.25, Cell(n, -n), (vote,)))
    return events


def write(path: Path, events: Iterable[Event]) -> Path:
    """A journal, closed."""
    with Journal.create(path, META) as journal:
        for event in events:
            journal.append(event)
    return path


def write_version_1(path: Path, events: Iterable[Event]) -> Path:
    """A journal as the first version of the format has it, closed."""
    path.parent.mkdir(exist_ok=True)
    with contextlib.closing(sqlite3.connect(path)) as database:
        database.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        database.execute("PRAGMA user_version = 1")
        for statement in SCHEMAS[1]:
            database.execute(statement)
        for key, value in META.items():
            database.execute("INSERT INTO meta VALUES (?, ?)", (key, json.dumps(value)))
        for event in events:
            row = (event.t_s, getattr(event, "vehicle", None), event.kind, to_json(event))
            database.execute(
                "INSERT INTO events (t_s, vehicle, kind, body) VALUES (?, ?, ?, ?)", row
            )
        database.commit()
        database.execute("PRAGMA journal_mode = WAL")
    return path


def contents(folder: Path) -> dict[str, str]:
    """The hash of every file."""
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.iterdir()}


def read(path: Path) -> tuple[list[Event], dict[str, Any]]:
    """The events of a journal, and what it says of the mission."""
    with Journal.open(path) as journal:
        return list(journal.events()), journal.meta
