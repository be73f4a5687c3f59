"""Paths that are flown without stops: rules for each path, and at each moment."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st

from missions.events import Arrived, Event, Tracked
from missions.flight.airspace.airspace import Airspace
from missions.flight.path_orders import PLAN_LEAD_S
from missions.flight.return_home import ORDER_DELAY_S, return_route
from missions.flight.setting_of import setting_of
from missions.flight.vehicle_state import Phase
from missions.geo.braking import Course, braked
from missions.geo.fence import route_length_m
from missions.geo.path_in_fence import OUTSIDE_M
from missions.geo.trajectory import ACCELERATION_M_S2, Trajectory
from missions.lab.arena.roi import component
from missions.mapping.tree import patches
from missions.mission.views import path_speed_m_s
from missions.orders import FlyPath
from missions.planning.kernels.swath import SLOW
from tests.fake_fleet import Fleet
from tests.support.folding import fold
from tests.support.small_missions import Scenario, random_scenario, scattered, unkind_scenario

STEP_S = 0.1
BENT_M_S2 = 2.3
"""Maximum acceleration of braking on an arc, m/s2: 2.0 across and 1.0 along."""


@dataclass(slots=True)
class Watched(Fleet):
    """A fleet in the kind world that examines every path when it is ordered."""

    wrong: list[str] = field(default_factory=list)
    paths: int = 0
    courses: dict[int, Course] = field(default_factory=dict)

    def post(self, event: Event) -> None:
        before = self.state
        Fleet.post(self, event)
        if isinstance(event, Arrived):
            self.courses.pop(event.vehicle, None)  # it is at rest; a next path may be on its way
        for number, vehicle in self.state.vehicles.items():
            order, old = vehicle.order, before.vehicles[number].order
            if not isinstance(order, FlyPath):
                self.courses.pop(number, None)
            elif order is not old:
                self.paths += 1
                self._given(number, order.trajectory)
            if isinstance(order, FlyPath) and vehicle.phase is Phase.AIRBORNE:
                self._moment(number, order)
                # another vehicle that begins to wait for its landing binds it from its next report
                reported = isinstance(event, Tracked) and event.vehicle == number
                if order is not old or reported:
                    self._ahead(number, order)

    def _note(self, number: int, text: str) -> None:
        self.wrong.append(f"{self.state.t_s:.2f} s, vehicle {number}: {text}")

    def _given(self, number: int, path: Trajectory) -> None:
        setting, vehicle = self.setting, self.state.vehicles[number]
        now_s, course = self.state.t_s, self.courses.get(number)
        if path.begin_s < now_s + PLAN_LEAD_S - 2e-3:
            self._note(number, f"a path that begins at {path.begin_s}")
        first, drift_m_s = path.at(path.begin_s), setting.grid.drift_speed_m_s
        if course is None:  # from rest, where it is
            speed = math.hypot(first.v_east_m_s, first.v_north_m_s)
            if speed > drift_m_s + 1e-6:
                self._note(number, f"a path that begins from rest at {speed:.2f} m/s")
            off_m = first.place.distance_to(vehicle.position)
            if off_m > 0.05 + drift_m_s * PLAN_LEAD_S:
                self._note(number, f"a path that begins {off_m:.2f} m away")
            self.courses[number] = Course((path,))
        else:
            then = course.at(path.begin_s)
            off_m = first.place.distance_to(then.place)
            jump = math.hypot(
                first.v_east_m_s - then.v_east_m_s, first.v_north_m_s - then.v_north_m_s
            )
            # a path of the search lies in the fixed frame, those after it in the region's
            if off_m > 0.02 or jump > drift_m_s + SLOW:
                self._note(number, f"a path that jumps by {off_m:.2f} m and {jump:.2f} m/s")
            self.courses[number] = course.then(path, now_s)
        self._geometry(number, path)

    def _geometry(self, number: int, path: Trajectory) -> None:
        setting, vehicle = self.setting, self.state.vehicles[number]
        count = max(2, math.ceil((path.end_s - path.begin_s) / STEP_S))
        motions = [path.at(t) for t in np.linspace(path.begin_s, path.end_s, count)]
        most = path_speed_m_s(setting.mission, vehicle.cruise_height_m)
        most += setting.grid.drift_speed_m_s + 1e-3
        fastest = max(math.hypot(m.v_east_m_s, m.v_north_m_s) for m in motions)
        bent = max(math.hypot(m.a_east_m_s2, m.a_north_m_s2) for m in motions)
        if fastest > most or bent > BENT_M_S2:
            self._note(number, f"a path with {fastest:.2f} m/s and {bent:.2f} m/s2")
        places = np.array([m.place for m in motions])
        out_m = shapely.distance(setting.fence.inner, shapely.points(places))
        inside = np.flatnonzero(out_m <= 0.03)
        first = int(inside[0]) if len(inside) else count
        comes_in = out_m[0] <= OUTSIDE_M and all(
            b <= a + 0.03 for a, b in itertools.pairwise(out_m[: first + 1])
        )
        if first == count or (first and not comes_in) or out_m[first:].max() > 0.03:
            self._note(number, f"a path that is {out_m.max():.2f} m outside of the margin")

    def _ahead(self, number: int, order: FlyPath) -> None:
        """Check that a vehicle stops before the air of others."""
        vehicle, path = self.state.vehicles[number], order.trajectory
        begin_s = max(path.begin_s, self.state.t_s + PLAN_LEAD_S)
        stop = braked(path, begin_s, ACCELERATION_M_S2)
        if not Airspace(self.state).is_clear(vehicle, order) and path.end_s > stop.end_s + 0.6:
            self._note(number, "it flies on into reserved air")

    def _moment(self, number: int, order: FlyPath) -> None:
        """Check that a vehicle can come home."""
        setting, state = self.setting, self.state
        vehicle, path, now_s = state.vehicles[number], order.trajectory, state.t_s
        if vehicle.return_reason is not None:
            return
        place = braked(path, max(path.begin_s, now_s + ORDER_DELAY_S), ACCELERATION_M_S2)
        at = place.at(place.end_s).place
        energy = setting.energy.in_wind(vehicle.wind_m_s)
        way = return_route(setting, at, vehicle.pad)
        need_wh = energy.home_wh(route_length_m(at, way), vehicle.height_m, vehicle.drawn_w)
        if vehicle.remaining_wh < need_wh:
            self._note(number, f"{vehicle.remaining_wh:.2f} Wh left, of {need_wh:.2f}")


def flown(scenario: Scenario, limit_s: float = 5000.0) -> Watched:
    flight = Watched(setting_of(scenario.mission), scenario.roi)
    flight.start()
    flight.run(limit_s)
    return flight


def is_honest(flight: Watched, scenario: Scenario) -> None:
    state = flight.state
    if any(driver.misplaced for driver in flight.drivers.values()):
        return  # no program can know where its pictures were taken
    assert state.belief.roi <= scenario.roi
    if state.completed and state.tree is not None:
        assert component(scenario.roi, state.tree.root) <= state.belief.roi


def holds(scenario: Scenario) -> Watched:
    flight = flown(scenario)
    assert flight.wrong == []
    assert flight.faults == []
    assert {v.phase for v in flight.state.vehicles.values()} <= {Phase.FINISHED, Phase.FAILED}
    is_honest(flight, scenario)
    return flight


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 100_000))
def test_every_path_can_be_flown_and_left(seed: int) -> None:
    assert holds(random_scenario(seed, strategy="swath")).paths > 0


@settings(max_examples=6, deadline=None)
@given(seed=st.integers(0, 100_000))
def test_every_path_over_a_region_that_drifts(seed: int) -> None:
    flight = holds(random_scenario(seed, drift=True, strategy="swath"))
    assert flight.state.completed


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 100_000))
@example(116)
@example(733)
def test_every_path_of_small_missions(seed: int) -> None:
    """The missions have holes beside the homes and in the box, winds, and small batteries."""
    holds(unkind_scenario(seed, "swath"))


@settings(max_examples=5, deadline=None)
@given(seed=st.integers(0, 100_000))
@example(seed=8359)  # two on the ground, no lane left, and a few cells open
def test_every_path_of_a_survey(seed: int) -> None:
    scenario = random_scenario(seed, strategy="survey")
    flight = holds(scenario)
    seen = [c for c in flight.setting.box_cells if flight.state.belief.verdict(c) is not None]
    assert flight.state.completed == (len(seen) == len(flight.setting.box_cells))


@settings(max_examples=6, deadline=None)
@given(seed=st.integers(0, 100_000), high=st.booleans())
def test_every_path_of_a_mission_that_finds_every_patch(seed: int, high: bool) -> None:
    scenario = scattered(random_scenario(seed, strategy="swath"), seed, high=high)
    flight = holds(scenario)
    state, setting = flight.state, flight.setting
    assert state.tree is None
    if not state.completed:
        assert (
            setting.strategy.open_cells(state) or state.unsearched
        )  # behind the hole, or the fence
        return
    box = set(setting.box_cells)
    assert box <= state.belief.open_ballots.keys()
    for patch in patches(scenario.roi):
        assert not patch & box or patch <= state.belief.roi


@pytest.mark.parametrize("seed", [3])
def test_journal_that_ends_anywhere_gives_the_same_state(seed: int) -> None:
    """After a kill in the middle of a path the journal is all that is left, plans included."""
    flight = Watched(setting_of((scenario := random_scenario(seed, strategy="swath")).mission),
                     scenario.roi)  # fmt: skip
    flight.start()
    while not flight.ended and flight.t_s < 3000.0:
        due_s = flight.t_s + 17.0
        while not flight.ended and flight.t_s < due_s:
            flight.tick()
        if not flight.ended and flight.t_s < 120.0:
            flight.crash_and_resume()
    assert flight.ended
    assert flight.wrong == []
    assert flight.faults == []
    assert fold(flight.setting, flight.events) == flight.state
    is_honest(flight, scenario)
