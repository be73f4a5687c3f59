"""Journals of a mission that can be flown, for tests."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

from missions.errors import JournalError
from missions.events import Event, FrameSeen, Tracked, Vote
from missions.units import Cell, GridPoint
from tests.support.plans import named_text, plan_of
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import JOURNAL, FlightPlan

SOURCE = named_text("runway")
PLAN = plan_of(SOURCE.source, SOURCE.text + "# é\n", seed=7)
META: dict[str, Any] = {"plan": json.loads(json.dumps(PLAN.as_json()))}
"""Meta data as read back: a tuple is a list in JSON."""


def some_events(count: int) -> list[Event]:
    """Return two events for each of a number."""
    events: list[Event] = []
    for n in range(count):
        place = GridPoint(0.01 * n, -3.25)
        events.append(Tracked(1, n + 0.125, place, 12.0, 59.9))
        vote = Vote(Cell(n, -n), n % 2 == 0, 0.333)
        events.append(FrameSeen(1, n + 0.25, Cell(n, -n), (vote,)))
    return events


def write(path: Path, events: Iterable[Event]) -> Path:
    with Journal.create(path, META) as journal:
        for event in events:
            journal.append(event)
    return path


def begun(folder: Path, plan: FlightPlan, events: Iterable[Event] = (), **meta: object) -> Path:
    """Return a folder with the closed journal of a flight, and no other file."""
    with Journal.create(folder / JOURNAL, {"plan": plan.as_json(), **meta}) as journal:
        journal.append_all(events)
    return folder


def contents(folder: Path) -> dict[str, str]:
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.iterdir()}


def read(path: Path) -> tuple[list[Event], dict[str, Any]]:
    with Journal.open(path) as journal:
        return list(journal.events()), journal.meta


def refused(path: Path) -> str:
    """Return the line with which a journal is refused; assert that its folder is unchanged."""
    before = contents(path.parent)
    with pytest.raises(JournalError) as caught:
        Journal.open(path)
    assert contents(path.parent) == before
    line = str(caught.value)
    assert str(path) in line
    assert line.isprintable()
    return line
