"""One trouble in the middle of a path that is flown without stops, and its outcome."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from missions.flight.setting_of import setting_of
from missions.flight.vehicle_state import Phase
from missions.lab.arena.roi import eden
from missions.orders import AwaitBattery, FlyPath, Hold
from missions.units import Cell, GridPoint
from tests.fake_fleet.aircraft import Storm
from tests.prop.missions.flight.test_paths_in_flight import Watched, is_honest
from tests.prop.quick_plans import quick_plans
from tests.support.small_missions import Scenario, at_heights, mission, square

BOX, FENCE = square(-10, 14, 40, 24), square(-40, -40, 120, 130)
LIMIT_S = 2500.0
SEAT = Cell(2, 7)


@pytest.fixture(scope="module", autouse=True)
def soon_planned() -> Iterator[None]:
    with quick_plans():
        yield


def region(cells: int, seat: Cell = SEAT) -> frozenset[Cell]:
    if cells == 1:
        return frozenset([seat])
    grown = eden(cells, np.random.default_rng(1))
    return frozenset(Cell(seat.east + e, seat.north + n) for e, n in grown)


def made(cells: int = 30, seat: Cell = SEAT, **how: object) -> tuple[Watched, Scenario]:
    chosen: dict[str, object] = {
        "strategy": "swath", "mounting": "gimbal", "altitude_m": 14.0, "capacity_wh": 40.0,
        "box": BOX, "fence": FENCE, "interval_s": 0.25, **how,
    }  # fmt: skip
    scenario = Scenario(mission(**chosen), region(cells, seat))  # type: ignore[arg-type]
    flight = Watched(setting_of(scenario.mission), scenario.roi)
    flight.start()
    return flight, scenario


def on_path(flight: Watched, number: int = 1) -> bool:
    vehicle, craft = flight.state.vehicles[number], flight.vehicles[number]
    order = vehicle.order
    return (
        isinstance(order, FlyPath)
        and flight.state.tree is not None
        and order.trajectory.end_s > flight.t_s + 4.0
        and craft.ground_speed_m_s > 2.0
    )


def ended(flight: Watched, scenario: Scenario, *, lasts: bool = True) -> None:
    """Check that a flight ends safely and honestly, and completes the map if it `lasts`."""
    flight.run(LIMIT_S)
    assert flight.faults == []
    assert flight.wrong == []
    is_honest(flight, scenario)
    assert flight.state.completed or not lasts


# --- troubles ----------------------------------------------------------------------------------
Act = Callable[[Watched], None]


def wait(flight: Watched, for_s: float) -> None:
    until_s = flight.t_s + for_s
    while not flight.ended and flight.t_s < until_s:
        flight.tick()


def pilot(flight: Watched) -> None:
    flight.take_over(1)
    wait(flight, 12.0)
    flight.give_back(1)


def silent(for_s: float) -> Act:
    def act(flight: Watched) -> None:
        flight.cut_link(1)
        wait(flight, for_s)
        flight.mend_link(1)

    return act


def deaf_20_s(flight: Watched) -> None:
    """Stop the stream while telemetry continues."""
    flight.drivers[1].link = "commands lost"
    wait(flight, 20.0)
    flight.drivers[1].link = "good"


def low_battery(flight: Watched) -> None:
    flight.vehicles[1].wh = 13.0


def camera(does: str) -> Act:
    return lambda flight: setattr(flight.drivers[1], "camera", does)


def storms(*begin_s: float, lasts_s: float, wind_m_s: tuple[float, float]) -> Act:
    return lambda flight: flight.air.storms.extend(
        Storm(flight.t_s + wait_s, flight.t_s + wait_s + lasts_s, wind_m_s) for wait_s in begin_s
    )


def order_failed(flight: Watched) -> None:
    flight.drivers[1].fail_in_s = flight.drivers[1].clock_s + 0.1


def position_leaps(flight: Watched) -> None:
    flight.vehicles[1].offset_m = (25.0, 10.0)
    wait(flight, 10.0)
    flight.vehicles[1].offset_m = (0.0, 0.0)


RECOVERED: dict[str, Act] = {
    "pilot": pilot,
    "link 2 s": silent(2.0),
    "link 60 s": silent(60.0),
    "killed": lambda flight: flight.die(kill=True, away_s=30.0),
    "resumed at once": lambda flight: flight.crash_and_resume(),
    "low battery": low_battery,
    "late frames": camera("slow"),
    "half the frames": camera("drops"),
    "blown off": storms(0.0, lasts_s=4.0, wind_m_s=(11.0, 0.0)),
    # wind in which the speed of its path cannot be held
    "gusts": storms(0.0, 20.0, 40.0, lasts_s=6.0, wind_m_s=(-10.0, 0.0)),
}
"""Troubles after which a single vehicle completes the map."""
BORNE: dict[str, Act] = {
    "deaf 20 s": deaf_20_s,
    "recalled": lambda flight: flight.recall(),
    "camera dead": camera("silent"),
    "camera lost": camera("lost"),
    "order failed": order_failed,
    "position leaps": position_leaps,
    "storm": storms(0.0, lasts_s=30.0, wind_m_s=(0.0, 16.0)),
}
"""Troubles after which it may have to end, honestly."""


@pytest.mark.parametrize("trouble", RECOVERED)
def test_a_trouble_that_passes_leaves_no_gap(trouble):
    flight, scenario = made(vehicles=2)
    flight.run(LIMIT_S, until=on_path)
    RECOVERED[trouble](flight)
    ended(flight, scenario)


@pytest.mark.parametrize("trouble", BORNE)
@pytest.mark.parametrize("vehicles", [1, 2])
def test_a_trouble_that_stays_ends_the_flight_safely(trouble, vehicles):
    flight, scenario = made(vehicles=vehicles)
    flight.run(LIMIT_S, until=on_path)
    BORNE[trouble](flight)
    ended(flight, scenario, lasts=vehicles == 2 and trouble not in ("recalled", "storm"))


def test_a_low_battery_is_swapped_and_the_rest_mapped():
    flight, scenario = made()
    flight.run(LIMIT_S, until=on_path)
    low_battery(flight)
    ended(flight, scenario)
    assert any(isinstance(order, AwaitBattery) for _, _, order in flight.orders)


# --- places ------------------------------------------------------------------------------------
WALL = [square(-39.9, 26, 119.8, 3)]
PLACES = {
    "one cell": ({"cells": 1, "seat": Cell(3, 6)}, True),
    "hole in the box": ({"holes": [square(4, 22, 8, 8)]}, True),
    "hole in the region": ({"cells": 60, "holes": [square(6, 27, 5, 5)]}, True),
    "passage": ({"cells": 60, "holes": [square(-39, 26, 70, 3)], "capacity_wh": 80.0}, True),
    "split": ({"cells": 60, "holes": WALL, "fence": square(-40, -20, 120, 120)}, False),
    "rim": ({"cells": 60, "fence": square(-40, -40, 120, 82)}, False),
    "tiny speed": ({"cells": 8, "speed_m_s": 0.3, "capacity_wh": 90.0}, True),
    "pictures seldom": ({"interval_s": 2.0}, True),
    "drifts": ({"drift_m_s": 0.3, "toward_deg": 70.0}, True),
    "drifts out": (
        {"cells": 60, "drift_m_s": 0.3, "toward_deg": 0.0, "fence": square(-40, -40, 120, 90)},
        False,
    ),
    "small battery": ({"cells": 60, "capacity_wh": 10.0}, True),
    "small batteries": ({"cells": 90, "capacity_wh": 13.0, "vehicles": 3}, True),
}


@pytest.mark.parametrize("place", PLACES)
def test_mission_in_a_difficult_place_ends_safely(place):
    how, whole = PLACES[place]
    flight, scenario = made(**how)  # type: ignore[arg-type]
    ended(flight, scenario, lasts=whole)
    phases = {vehicle.phase for vehicle in flight.state.vehicles.values()}
    assert phases == {Phase.FINISHED}
    if not whole:
        assert not flight.state.completed
        assert flight.state.undecided


def test_a_wait_ends_long_before_the_battery():
    """Cells that no frame can show are given up after the paths to them were flown."""
    flight, scenario = made(60, holes=WALL, fence=square(-40, -20, 120, 120), capacity_wh=200.0)
    ended(flight, scenario, lasts=False)
    held_s = sum(
        after - t_s
        for (t_s, _, order), (after, _, _) in zip(flight.orders, flight.orders[1:], strict=False)
        if isinstance(order, Hold)
    )
    assert held_s < 60.0
    assert flight.t_s < 400.0


def test_mission_with_homes_at_different_heights_is_complete():
    chosen = mission(
        BOX, FENCE, strategy="swath", mounting="gimbal", altitude_m=20.0, capacity_wh=60.0,
        vehicles=3,
    )  # fmt: skip
    scenario = Scenario(at_heights(chosen, (0.0, 5.0, -4.0)), region(60))
    flight = Watched(setting_of(scenario.mission), scenario.roi)
    flight.start()
    ended(flight, scenario)


def test_vehicle_that_stands_in_the_margin_takes_part():
    """Its actual home differs from that of the mission."""
    fence = square(-2.5, -2.5, 60, 60)
    chosen = mission(
        square(4, 14, 30, 24), fence, strategy="swath", mounting="gimbal", altitude_m=14.0,
        capacity_wh=40.0,
    )  # fmt: skip
    scenario = Scenario(chosen, region(20, Cell(4, 6)))
    flight = Watched(setting_of(chosen), scenario.roi, stand_off_m=[(-1.8, -1.6)])
    flight.start()
    ended(flight, scenario)
    assert flight.vehicles[1].position.distance_to(GridPoint(-1.8, -1.6)) < 2.0
