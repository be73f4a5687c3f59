"""The referee of the fake fleet can fail a flight: what must not happen is brought about."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace

import pytest

from missions.events import Event, FrameSeen
from missions.flight.state import State
from missions.flight.step import Orders
from missions.flight.vehicle_state import Phase
from missions.orders import StandDown
from missions.units import Cell, GridPoint
from tests.fake_fleet import Fleet, fleet
from tests.fake_fleet.troubles import Trouble
from tests.support.small_missions import mission, square

ROI = frozenset({Cell(2, 6), Cell(2, 7), Cell(3, 7)})
OUTSIDE = GridPoint(120.0, 0.0)
FAR_OUTSIDE = GridPoint(300.0, 0.0)


def started(vehicles: int = 1, roi: frozenset[Cell] = ROI) -> Fleet:
    """A flight that is in the air and on its way."""
    made = mission(
        square(-10, 16, 40, 30), square(-60, -60, 160, 160), capacity_wh=60.0, vehicles=vehicles
    )
    flight = fleet(made, roi)
    flight.start()
    flight.run(until=lambda f: all(v.phase is Phase.AIRBORNE for v in f.state.vehicles.values()))
    return flight


def kinds(flight: Fleet) -> set[str]:
    return {kind for kind, _ in flight.referee.found}


def ticks(flight: Fleet, seconds: float) -> set[str]:
    for _ in range(int(seconds * 4)):
        flight.tick()
    return kinds(flight)


def test_a_kind_flight_is_not_failed() -> None:
    flight = started(2)
    flight.run()
    flight.referee.conclude(flight, twice=True)
    assert flight.faults == []
    assert flight.state.completed


@pytest.mark.parametrize("phase", [Phase.FAILED, Phase.FINISHED, Phase.DOWN, Phase.LOST])
def test_nobody_responsible_is_seen(phase: Phase) -> None:
    flight = started()
    lone = replace(flight.state.vehicles[1], phase=phase, order=StandDown())
    flight.state = flight.state.with_vehicle(lone)
    assert ticks(flight, 6.0) == set()
    assert "alone" in ticks(flight, 6.0)


def test_a_breach_is_seen_and_forgiven_to_whom_positions_lie_but_not_for_long() -> None:
    flight = started()
    flight.vehicles[1].position = OUTSIDE
    assert "breach" in ticks(flight, 0.25)
    flight = started()
    flight.vehicles[1].position, flight.vehicles[1].offset_m = OUTSIDE, (-110.0, 0.0)
    assert ticks(flight, 20.0) == set()
    flight.vehicles[1].position, flight.vehicles[1].offset_m = FAR_OUTSIDE, (-290.0, 0.0)
    assert ticks(flight, 0.25) == {"far"}


def test_two_too_near_are_seen() -> None:
    flight = started(2)
    one, other = flight.vehicles.values()
    other.position, other.height_m = one.position, one.height_m + 1.0
    assert "near" in ticks(flight, 0.25)


def test_who_falls_for_want_of_energy_is_seen() -> None:
    flight = started()
    flight.vehicles[1].wh = 0.0
    assert "fell" in ticks(flight, 0.5)


def test_a_crash_that_nobody_tells_is_seen() -> None:
    flight = started()
    craft = flight.vehicles[1]
    flight.drivers[1].link = "silent"
    craft.position, craft.motors_failed = GridPoint(20.0, 20.0), True
    ticks(flight, 4.0)
    finished = replace(flight.state.vehicles[1], phase=Phase.FINISHED)
    flight.state = flight.state.with_vehicle(finished)
    flight.referee.conclude(flight, twice=False)
    assert "unreported" in kinds(flight)


def test_one_left_in_the_air_at_the_end_is_seen() -> None:
    flight = started()
    flight.referee.conclude(flight, twice=False)
    assert kinds(flight) == {"air"}


def completed(roi: frozenset[Cell] = ROI) -> Fleet:
    flight = started(roi=roi)
    flight.run()
    assert flight.state.completed
    return flight


def blind(flight: Fleet) -> None:
    flight.roi = {*ROI, Cell(4, 7)}


def forget(flight: Fleet) -> None:
    event = next(e for e in flight.events if isinstance(e, FrameSeen))
    flight.events.append(replace(event, t_s=event.t_s + 0.001))


def dream(flight: Fleet) -> None:
    belief = replace(flight.state.belief, roi=flight.state.belief.roi | {Cell(9, 9)})
    flight.state = replace(flight.state, belief=belief)


@pytest.mark.parametrize(
    ("spoil", "kind"), [(blind, "lie"), (forget, "lost votes"), (dream, "lie"), (dream, "fold")]
)
def test_a_map_that_is_not_the_truth_is_seen(spoil: Callable[[Fleet], None], kind: str) -> None:
    flight = completed()
    spoil(flight)
    flight.referee.conclude(flight, twice=True)
    assert kind in kinds(flight)


def test_a_lane_that_nobody_saw_is_seen() -> None:
    flight = completed(roi=frozenset())
    flight.drivers[1].seen_from = flight.drivers[1].seen_from[:5]
    flight.referee.conclude(flight, twice=False)
    assert kinds(flight) == {"lie"}


def test_a_reducer_that_raises_is_told_and_everybody_returns(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    flight = started(2)

    def fails(state: State, event: Event) -> tuple[State, Orders]:
        raise ZeroDivisionError("a fault of the test")

    monkeypatch.setattr(sys.modules[Fleet.__module__], "step", fails)
    flight.run()
    assert kinds(flight) == {"traceback"}
    assert {craft.mode for craft in flight.vehicles.values()} == {"rtl"}
    assert not any(craft.flying or craft.crashed for craft in flight.vehicles.values())


def test_a_flight_without_an_end_is_not_waited_for() -> None:
    flight = started()
    flight.troubles = [Trouble("none", 1, "search", 0.0)]
    with pytest.raises(AssertionError, match="no end"):
        flight.run(1.0)
