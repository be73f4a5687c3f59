"""A recorded flight, folded again: `step` must say today what it said then.

How to renew the recording, and when: see `tests/golden/renew.py`.
"""

from __future__ import annotations

import json

import pytest

from missions.events import Event, from_json, to_json
from missions.state import State
from missions.step import fold, step
from tests.golden.recording import EVENTS, OUTCOME, outcome, setting


@pytest.fixture(scope="module")
def events() -> list[Event]:
    return [from_json(line) for line in EVENTS.read_text("utf-8").splitlines()]


def test_the_recording_is_a_whole_flight(events: list[Event]) -> None:
    kinds = {event.kind for event in events}
    assert {"connected", "airborne", "tracked", "arrived", "frame_seen"} <= kinds
    assert {"landed", "battery_swapped"} <= kinds
    assert EVENTS.stat().st_size < 60_000


def test_the_text_of_an_event_is_stable(events: list[Event]) -> None:
    assert [to_json(event) for event in events] == EVENTS.read_text("utf-8").splitlines()


def test_the_outcome_is_the_recorded_one(events: list[Event]) -> None:
    recorded = json.loads(OUTCOME.read_text("utf-8"))
    assert recorded["summary"]["completed"]
    assert recorded["summary"]["sorties"] >= 2
    assert outcome(events) == recorded


def test_any_prefix_folds_to_the_state_that_was_held_then(events: list[Event]) -> None:
    """What a resume after a kill relies on."""
    state = State.initial(setting())
    for number, event in enumerate(events, start=1):
        state, _ = step(setting(), state, event)
        if number % 40 == 0:
            assert fold(setting(), events[:number]) == state
    assert state.over
    assert state.completed


def test_the_order_of_the_frames_does_not_change_the_map(events: list[Event]) -> None:
    recorded = json.loads(OUTCOME.read_text("utf-8"))
    frames = [event for event in events if event.kind == "frame_seen"]
    belief = State.initial(setting()).belief
    for event in reversed(frames):
        state, _ = step(setting(), State.initial(setting()), event)
        belief = belief.join(state.belief)
    assert sorted([c.east, c.north] for c in belief.roi) == recorded["roi"]
