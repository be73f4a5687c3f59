"""The path that the page shows ahead of a vehicle is the one that it then flies."""

from __future__ import annotations

import numpy as np
import pytest
from shapely.geometry import LineString, Point

from missions.events import Tracked, from_json
from missions.flight.state import Phase, State
from missions.flight.step import step
from missions.orders import FlyPath, FlyTo, Sweep
from tests.golden.recording import PASSES, SPILL, STOPS, Recording
from uavmap.ui.page.watching import UNTIMED_S, Ahead

MOST_M = 4.0
"""A copter is so far off its path at most, in these flights, and its position a little wrong."""


@pytest.mark.parametrize(
    ("recording", "kinds"), [(STOPS, {"FlyTo", "Sweep"}), (PASSES, {"FlyPath"})]
)
def test_it_is_flown(recording: Recording, kinds: set[str]) -> None:
    setting, lines = recording.setting(), recording.lines()[:160]
    state, ahead = State.initial(setting), Ahead(setting)
    told: dict[int, list[float]] = {}
    begun: dict[int, Point] = {}
    seen: set[str] = set()
    news = 0
    for line in lines:
        state, _ = step(setting, state, event := from_json(line))
        for number, vehicle in state.vehicles.items():
            here = Point(setting.grid.to_moving(vehicle.position, state.t_s))
            if isinstance(event, Tracked) and event.vehicle == number and told.get(number):
                path = told[number]
                points = [begun[number], *zip(path[1::3], path[2::3], strict=True)]
                assert LineString(points).distance(here) < MOST_M
            if (path := ahead.news(vehicle, state.t_s)) is not None:
                news += 1
                told[number], begun[number] = path, here
                seen.add(type(vehicle.order).__name__)
                if isinstance(vehicle.order, FlyPath):
                    assert path[::3] == sorted(path[::3])
                    assert path[-3] == pytest.approx(vehicle.order.trajectory.end_s, abs=0.06)
                elif path:
                    assert isinstance(vehicle.order, FlyTo | Sweep)
                    assert set(path[::3]) == {UNTIMED_S}
                assert len(path) <= 300
    assert kinds <= seen
    assert news < len(lines) / 2  # it is told again for a new order only


def test_over_a_region_that_drifts_it_is_where_the_path_will_be() -> None:
    setting, lines = SPILL.setting(), SPILL.lines()
    state, ahead = State.initial(setting), Ahead(setting)
    for line in lines:
        state, _ = step(setting, state, from_json(line))
        if isinstance(order := state.vehicles[1].order, FlyPath):
            break
    path = ahead.news(state.vehicles[1], state.t_s)
    assert path
    shown = LineString(list(zip(path[1::3], path[2::3], strict=True)))
    end_s = order.trajectory.end_s
    for time_s in np.linspace(path[0], end_s, 50):
        place = setting.grid.to_moving(order.trajectory.place_at(time_s), time_s)
        assert shown.distance(Point(place)) < 0.6
    straight = setting.grid.to_moving(order.trajectory.place_at(end_s), 0.0)
    assert shown.distance(Point(straight)) > 10.0  # it does drift


def test_who_is_not_ours_has_no_path() -> None:
    setting = STOPS.setting()
    vehicle = State.initial(setting).vehicles[1]
    ahead = Ahead(setting)
    assert ahead.news(vehicle, 0.0) == []
    assert ahead.news(vehicle, 1.0) is None
    assert vehicle.phase is not Phase.AIRBORNE
