"""Recorded flights, folded again: `step` must give the recorded outcome.

`tests/golden/renew.py` describes how and when to renew the recordings.
"""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from missions.events import Event, from_json, to_json
from missions.flight.state import Setting
from missions.flight.step import step
from missions.mapping.overview import with_plain
from missions.orders import FlyPath, Look
from missions.planning.kernels.jit import COMPILED
from tests.golden.recording import PASSES, RECORDINGS, STOPS, Recording, outcome
from tests.support.folding import fold


@dataclass(frozen=True, slots=True)
class RecordedFlight:
    recording: Recording
    lines: list[str]
    events: list[Event]
    setting: Setting


@pytest.fixture(scope="module", params=RECORDINGS, ids=lambda recording: recording.name)
def flight(request: pytest.FixtureRequest) -> RecordedFlight:
    recording: Recording = request.param
    if recording.strategy == "swath" and not COMPILED:
        pytest.skip("numba is not installed: plans are shorter searches, and others")
    lines = recording.lines()
    return RecordedFlight(
        recording, lines, [from_json(line) for line in lines], recording.setting()
    )


def test_the_recording_is_a_whole_flight(flight):
    kinds = {event.kind for event in flight.events}
    assert {"connected", "airborne", "tracked", "frame_seen", "landed"} <= kinds
    assert flight.recording.events.stat().st_size < 120_000
    if flight.recording is STOPS:
        assert {"arrived", "battery_swapped"} <= kinds


def test_the_text_of_an_event_is_stable(flight):
    assert [to_json(event) for event in flight.events] == flight.lines


def test_the_outcome_is_the_recorded_one(flight):
    recorded = flight.recording.recorded()
    assert recorded["summary"]["completed"]
    assert outcome(flight.recording, flight.events) == recorded
    if flight.recording is STOPS:
        assert recorded["summary"]["sorties"] >= 2


def test_any_prefix_folds_to_the_state_that_was_held_then(flight):
    """A resume after a kill relies on this; at the end the recorded outcome is compared."""
    state = flight.setting.initial_state()
    every = len(flight.events) // 3 + 1
    for number, event in enumerate(flight.events, start=1):
        state, _ = step(state, event)
        if number % every == 0:
            assert fold(flight.setting, flight.events[:number]) == state
    assert state.is_over
    assert state.completed


def test_the_order_of_the_frames_does_not_change_the_map(flight):
    frames = [event for event in flight.events if event.kind == "frame_seen"]
    none = flight.setting.initial_state()
    low, high = none.belief, none.overview
    for event in reversed(frames):
        state, _ = step(none, event)
        low, high = low.join(state.belief), high.join(state.overview)
    shown = list(high.open_ballots)
    belief = with_plain(low, high, flight.setting.in_box, shown)
    assert sorted([c.east, c.north] for c in belief.roi) == flight.recording.recorded()["roi"]


@pytest.mark.parametrize(("recording", "stops"), [(STOPS, True), (PASSES, False)])
def test_strategy_with_stops_orders_looks_and_one_without_orders_paths(recording, stops):
    setting = recording.setting()
    state, kinds = setting.initial_state(), set[type]()
    for line in recording.lines():
        state, orders = step(state, from_json(line))
        kinds.update(type(order) for _, order in orders)
    assert (Look in kinds) is stops
    assert (FlyPath in kinds) is not stops
