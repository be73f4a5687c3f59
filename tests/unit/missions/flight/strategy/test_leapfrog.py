"""A leapfrog in flight: one vehicle moves at a time, and both stay together."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.errors import MissionFileError
from missions.flight.setting_of import setting_of
from missions.flight.strategy.leapfrog import MAPPER, TRACKER
from missions.flight.vehicle_state import Phase
from missions.geo.fence import Fence
from missions.mission.fleet_checks import tracker_view
from missions.orders import FlyPath, FlyTo
from missions.planning.leapfrog_geometry import Role, TrackerView, steps_along
from missions.planning.leapfrog_offsets import OffsetNoise, Offsets
from missions.units import Cell, GridPoint
from tests.fake_fleet import Fleet
from tests.support.small_missions import mission, square

BOX, AROUND = square(-4, 12, 40, 24), square(-30, -30, 110, 100)
ROI = {Cell(2, 5), Cell(3, 5), Cell(3, 6)}
VIEW = TrackerView(above_m=12.0)


def fleet(capacity_wh: float = 60.0) -> Fleet:
    made = mission(
        BOX, AROUND, vehicles=2, capacity_wh=capacity_wh, strategy="leapfrog", layer_m=12.0
    )
    found = Fleet(setting_of(made), ROI)
    found.start()
    return found


@settings(max_examples=15, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 60), st.integers(0, 40)), min_size=2, max_size=5))
def test_pair_stays_in_the_fence_and_the_mapper_in_the_picture(places):
    hole = [GridPoint(*place) for place in square(22, 12, 14, 16)]
    fence = Fence.from_rings([GridPoint(*place) for place in square(-5, -5, 70, 50)], [hole], 2.0)
    way = [GridPoint(0.0, 0.0)]
    for east, north in places:
        way.extend(fence.route(way[-1], GridPoint(float(east), float(north))) or ())
    at = {Role.MAPPER: way[0], Role.TRACKER: way[0]}
    for step in steps_along(fence, VIEW, way):
        other = Role.TRACKER if step.mover is Role.MAPPER else Role.MAPPER
        assert at[step.mover].distance_to(GridPoint(*step.start)) < 1e-6
        assert at[other].distance_to(GridPoint(*step.hovering)) < 1e-6
        for place in step.path:
            assert math.dist(place, step.hovering) <= VIEW.reach_m + 1e-6
        for a, b in pairwise(step.path):
            assert fence.allows_leg(GridPoint(*a), GridPoint(*b))
        at[step.mover] = GridPoint(*step.end)
    length_m = sum(a.distance_to(b) for a, b in pairwise(way))
    assert length_m <= 0.5 or at[Role.MAPPER].distance_to(way[-1]) < 1e-6


def test_pair_moves_one_at_a_time_and_maps_the_box():
    flown = fleet()
    view = tracker_view(flown.setting.mission)
    apart_m = []
    begun = False
    while flown.t_s < 1500.0 and not flown.state.is_over:
        flown.tick()
        both = [flown.state.vehicles[number] for number in (MAPPER, TRACKER)]
        if all(v.phase is Phase.AIRBORNE and v.return_reason is None for v in both):
            moving = [isinstance(v.order, FlyPath | FlyTo) for v in both]
            assert sum(moving) <= 1
            begun = begun or moving[0]
            if begun:
                apart_m.append(both[0].position.distance_to(both[1].position))
    assert flown.state.completed
    assert {cell for cell in flown.setting.box_cells if cell in flown.state.belief.roi} == ROI
    # the tracker's picture holds margin_m more, for the deviations of both
    assert max(apart_m) <= view.reach_m + view.margin_m


def test_pair_swaps_batteries_together_and_continues():
    flown = fleet(capacity_wh=16.0)
    flown.run()
    assert flown.state.completed
    takeoffs = [vehicle for _, vehicle, order in flown.orders if type(order).__name__ == "TakeOff"]
    assert takeoffs.count(MAPPER) == takeoffs.count(TRACKER) >= 2


def test_vehicle_left_alone_returns_and_the_mission_is_not_complete():
    flown = fleet()
    flown.run(until=lambda now: now.t_s >= 60.0)
    assert flown.state.vehicles[TRACKER].phase is Phase.AIRBORNE
    flown.take_over(TRACKER)
    flown.put_down(TRACKER)
    flown.run()
    assert not flown.state.completed
    mapper = flown.state.vehicles[MAPPER]
    assert mapper.landed
    assert mapper.position.distance_to(mapper.home) < 2.0


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"vehicles": 1}, "exactly two"),
        ({"vehicles": 3}, "exactly two"),
        ({"layer_m": 4.2}, "team.layer_m = 4.2"),
        ({"layer_m": 25.0}, "navigation.tag_m = 0.4"),
        ({"drift_m_s": 0.5}, "drift.speed_m_s"),
    ],
)
def test_mission_that_no_pair_can_fly_is_refused(change, expected):
    how = {"vehicles": 2, "layer_m": 12.0, "strategy": "leapfrog", **change}
    with pytest.raises(MissionFileError, match=expected):
        mission(BOX, AROUND, **how)


def test_estimated_errors_of_both_are_honest():
    noise = OffsetNoise(mount_rad=0.0)
    squares = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        both, off = Offsets(noise), {role: rng.normal(0.0, noise.start_m, 2) for role in Role}
        odometer = {role: rng.normal(0.0, noise.odometer, 2) for role in Role}
        heading = rng.normal(0.0, noise.heading_rad)
        true = {role: np.zeros(2) for role in Role}
        for hop in range(10):
            mover = (Role.TRACKER, Role.MAPPER)[hop % 2]
            way = np.array([9.0, 2.0]) * (1.0 if hop < 6 else -1.0)
            for role in Role:
                still = role is not mover
                if still:
                    both.start_hover(role)
                    stopped = off[role].copy()
                # true less errors is the path flown; the filter receives reports alone
                reported = np.zeros(2) if still else way
                scale, turn = odometer[role]
                errs_m_s = noise.wander_m_s + noise.changing * math.hypot(*reported) / 5.0
                wander = rng.normal(0.0, math.sqrt(10.0 * errs_m_s**2 * 5.0), 2)
                changed = scale * reported + turn * np.array([-reported[1], reported[0]]) + wander
                both.add_move(role, (float(reported[0]), float(reported[1])), 5.0)
                off[role] = off[role] + changed
                true[role] = true[role] + reported - changed
                if still:
                    seen = stopped - off[role] + rng.normal(0.0, 0.03, 2)
                    both.held(role, (0.0, 0.0), (float(seen[0]), float(seen[1])), 0.03)
            # the camera, turned by `heading`, shows the distance between both
            apart = true[Role.MAPPER] - true[Role.TRACKER]
            seen_apart = apart - heading * np.array([-apart[1], apart[0]])
            seen_apart = seen_apart + rng.normal(0.0, 0.05, 2)
            reported_apart = apart + off[Role.MAPPER] - off[Role.TRACKER]
            both.add_sighting(tuple(reported_apart), tuple(seen_apart), np.eye(2) * 0.05**2, 100.0)
        left = np.array(both.off(Role.MAPPER)) - off[Role.MAPPER]
        squares.append(float(left @ np.linalg.solve(both.covariance(Role.MAPPER), left)))
    # 24 degrees of freedom: 95 % lie between 1.03 and 3.28
    assert 1.03 < float(np.mean(squares)) < 3.28
