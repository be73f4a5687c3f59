"""One trouble in the middle of a path that is flown without stopping, and what comes of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from missions.flight.setting import Setting
from missions.flight.state import Phase
from missions.lab.arena.roi import eden
from missions.orders import AwaitBattery, FlyPath, Hold
from missions.units import Cell, GridPoint
from tests.fake_fleet.air import Storm
from tests.prop.missions.flight.test_paths_in_flight import Watched, is_honest
from tests.prop.quick_plans import quick_plans
from tests.support.small_missions import Scenario, mission, square

BOX, FENCE = square(-10, 14, 40, 24), square(-40, -40, 120, 130)
LIMIT_S = 2500.0
SEAT = Cell(2, 7)


@pytest.fixture(scope="module", autouse=True)
def soon_planned() -> Iterator[None]:
    """No trouble cares how good a plan is."""
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
    flight = Watched(Setting.of(scenario.mission), scenario.roi)
    flight.start()
    return flight, scenario


def on_path(flight: Watched, number: int = 1) -> bool:
    """Whether a vehicle explores, at full speed, in the middle of a path."""
    vehicle, craft = flight.state.vehicles[number], flight.vehicles[number]
    order = vehicle.order
    return (
        isinstance(order, FlyPath)
        and flight.state.tree is not None
        and order.trajectory.end_s > flight.t_s + 4.0
        and craft.ground_speed_m_s > 2.0
    )


def ended(flight: Watched, scenario: Scenario, *, lasts: bool = True) -> None:
    """It ends, safely and honestly; nothing is left undone for no reason, if it `lasts`."""
    flight.run(LIMIT_S)
    assert flight.faults == []
    assert flight.wrong == []
    is_honest(flight, scenario)
    assert flight.state.completed or not lasts


# --- troubles ----------------------------------------------------------------------------------
def pilot(flight: Watched) -> None:
    flight.take_over(1)
    wait(flight, 12.0)
    flight.give_back(1)


def link_2_s(flight: Watched) -> None:
    flight.cut_link(1)
    wait(flight, 2.0)
    flight.mend_link(1)


def link_60_s(flight: Watched) -> None:
    flight.cut_link(1)
    wait(flight, 60.0)
    flight.mend_link(1)


def deaf_20_s(flight: Watched) -> None:
    """The stream dies, and telemetry goes on."""
    flight.drivers[1].link = "commands lost"
    wait(flight, 20.0)
    flight.drivers[1].link = "good"


def killed(flight: Watched) -> None:
    flight.die(kill=True, away_s=30.0)


def resumed_at_once(flight: Watched) -> None:
    flight.crash_and_resume()


def low_battery(flight: Watched) -> None:
    flight.vehicles[1].wh = 13.0


def late_frames(flight: Watched) -> None:
    flight.drivers[1].camera = "slow"


def half_the_frames(flight: Watched) -> None:
    flight.drivers[1].camera = "drops"


def blown_off(flight: Watched) -> None:
    flight.air.storms.append(Storm(flight.t_s, flight.t_s + 4.0, (11.0, 0.0)))


def gusts(flight: Watched) -> None:
    """Wind against which the speed of its path cannot be held, for 6 s, three times."""
    flight.air.storms.extend(
        Storm(flight.t_s + wait_s, flight.t_s + wait_s + 6.0, (-10.0, 0.0))
        for wait_s in (0, 20, 40)
    )


def recalled(flight: Watched) -> None:
    flight.recall()


def camera_dead(flight: Watched) -> None:
    flight.drivers[1].camera = "silent"


def camera_lost(flight: Watched) -> None:
    flight.drivers[1].camera = "lost"


def order_failed(flight: Watched) -> None:
    flight.drivers[1].fail_in_s = flight.drivers[1].clock_s + 0.1


def position_leaps(flight: Watched) -> None:
    flight.vehicles[1].offset_m = (25.0, 10.0)
    wait(flight, 10.0)
    flight.vehicles[1].offset_m = (0.0, 0.0)


def storm(flight: Watched) -> None:
    flight.air.storms.append(Storm(flight.t_s, flight.t_s + 30.0, (0.0, 16.0)))


def wait(flight: Watched, for_s: float) -> None:
    until_s = flight.t_s + for_s
    while not flight.ended and flight.t_s < until_s:
        flight.tick()


RECOVERED = (
    pilot, link_2_s, link_60_s, killed, resumed_at_once, low_battery, late_frames, half_the_frames,
    blown_off, gusts,
)  # fmt: skip
"""After these a single vehicle completes the map."""
BORNE = (
    deaf_20_s, recalled, camera_dead, camera_lost, order_failed, position_leaps, storm,
)  # fmt: skip
"""After these it may have to end, honestly."""


@pytest.mark.parametrize("trouble", RECOVERED)
@pytest.mark.parametrize("vehicles", [2])
def test_a_trouble_that_passes_leaves_no_gap(
    trouble: Callable[[Watched], None], vehicles: int
) -> None:
    flight, scenario = made(vehicles=vehicles)
    flight.run(LIMIT_S, until=on_path)
    trouble(flight)
    ended(flight, scenario)


@pytest.mark.parametrize("trouble", BORNE)
@pytest.mark.parametrize("vehicles", [1, 2])
def test_a_trouble_that_stays_ends_the_flight_safely(
    trouble: Callable[[Watched], None], vehicles: int
) -> None:
    flight, scenario = made(vehicles=vehicles)
    flight.run(LIMIT_S, until=on_path)
    trouble(flight)
    ended(flight, scenario, lasts=vehicles == 2 and trouble not in (recalled, storm))


def test_a_low_battery_is_swapped_and_the_rest_mapped() -> None:
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
def test_a_place_where_it_is_hard_to_fly(place: str) -> None:
    how, whole = PLACES[place]
    flight, scenario = made(**how)  # type: ignore[arg-type]
    ended(flight, scenario, lasts=whole)
    phases = {vehicle.phase for vehicle in flight.state.vehicles.values()}
    assert phases == {Phase.FINISHED}
    if not whole:
        assert not flight.state.completed
        assert flight.state.undecided


def test_a_wait_ends_long_before_the_battery() -> None:
    """Cells that nobody can see are given up when the paths to them were flown in vain."""
    flight, scenario = made(60, holes=WALL, fence=square(-40, -20, 120, 120), capacity_wh=200.0)
    ended(flight, scenario, lasts=False)
    held_s = sum(
        after - t_s
        for (t_s, _, order), (after, _, _) in zip(flight.orders, flight.orders[1:], strict=False)
        if isinstance(order, Hold)
    )
    assert held_s < 60.0
    assert flight.t_s < 400.0


def test_homes_at_different_heights() -> None:
    chosen = mission(
        BOX, FENCE, strategy="swath", mounting="gimbal", altitude_m=20.0, capacity_wh=60.0,
        vehicles=3,
    )  # fmt: skip
    scenario = Scenario(chosen, region(60))
    flight = Watched(Setting.of(chosen), scenario.roi, levels_m=(0.0, 5.0, -4.0))
    flight.start()
    ended(flight, scenario)


def test_who_stands_in_the_margin_takes_part() -> None:
    """Its actual home is not where the mission says."""
    fence = square(-2.5, -2.5, 60, 60)
    chosen = mission(
        square(4, 14, 30, 24), fence, strategy="swath", mounting="gimbal", altitude_m=14.0,
        capacity_wh=40.0,
    )  # fmt: skip
    scenario = Scenario(chosen, region(20, Cell(4, 6)))
    flight = Watched(Setting.of(chosen), scenario.roi, stand_off_m=[(-1.8, -1.6)])
    flight.start()
    ended(flight, scenario)
    assert flight.vehicles[1].position.distance_to(GridPoint(-1.8, -1.6)) < 2.0
