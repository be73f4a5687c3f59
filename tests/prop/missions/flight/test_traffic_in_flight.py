"""Whole missions with aircraft of others that come and go."""

from __future__ import annotations

import functools
import math
import random
from dataclasses import dataclass, replace

import pytest

from missions.events import Continued, TrafficSeen
from missions.flight.return_home import turn_back
from missions.flight.vehicle_state import Phase, ReturnReason
from missions.orders import FlyPath, FlyTo, Look, Sweep
from missions.traffic import NO_TRAFFIC, Answer, Track
from missions.units import GridPoint
from tests.fake_fleet import Fleet, fleet
from tests.prop.missions.test_fleet import map_is_whole
from tests.support.folding import fold
from tests.support.small_missions import Scenario, random_scenario

VALID_S = 60.0
FROM_M = 1500.0


@dataclass(frozen=True)
class Intruder:
    """An aircraft that flies straight past the start at a lateral distance, m."""

    name: str
    begin_s: float
    toward_rad: float
    speed_m_s: float
    aside_m: float
    height_m: float | None
    reports_velocity: bool

    @classmethod
    def drawn(cls, rng: random.Random, name: str) -> Intruder:
        return cls(
            name, rng.uniform(5.0, 250.0), rng.uniform(0.0, math.tau), rng.uniform(5.0, 90.0),
            rng.uniform(-900.0, 900.0), rng.choice([None, 50.0, 200.0]), rng.random() < 0.8,
        )  # fmt: skip

    def track(self, t_s: float) -> Track:
        sin, cos = math.sin(self.toward_rad), math.cos(self.toward_rad)
        along_m = self.speed_m_s * (t_s - self.begin_s) - FROM_M
        place = GridPoint(along_m * sin + self.aside_m * cos, along_m * cos - self.aside_m * sin)
        velocity = GridPoint(self.speed_m_s * sin, self.speed_m_s * cos)
        reported = velocity if self.reports_velocity else None
        return Track(self.name, self.name, t_s, place, self.height_m, 100.0, reported)


def drawn(seed: int) -> Scenario:
    """Draw missions with stops, and without."""
    return random_scenario(seed, strategy="swath" if seed % 2 else None)


@functools.cache
def flown(seed: int) -> tuple[Fleet, set[Answer]]:
    """Return a flight, and how its team has reacted to traffic."""
    scenario, rng = drawn(seed), random.Random(seed)
    intruders = [Intruder.drawn(rng, name) for name in "ABCDE"]
    flight, answers = fleet(scenario.mission, scenario.roi), set()

    def watched(flight: Fleet) -> bool:
        if flight.t_s % 1.0 == 0.0:
            near = [i for i in intruders if i.begin_s <= flight.t_s < i.begin_s + VALID_S]
            if near:
                seen = TrafficSeen(flight.now_s, tuple(i.track(flight.t_s) for i in near))
                flight.post(seen)
        answer = flight.state.traffic.answer
        answers.add(answer)
        for vehicle in flight.state.vehicles.values():
            works = isinstance(vehicle.order, FlyTo | FlyPath | Sweep | Look) and vehicle.works
            flees = answer is Answer.COME_HOME and not flight.state.exploration_finished
            assert not (works and flees), flight.describe()
        return False

    flight.start()
    flight.run(until=watched)
    return flight, answers


@pytest.mark.parametrize("seed", range(3))
def test_mission_with_any_traffic_ends_with_a_whole_map_and_all_vehicles_safe(seed):
    flight, _ = flown(seed)
    assert flight.faults == []
    assert {v.phase for v in flight.state.vehicles.values()} == {Phase.FINISHED}
    if flight.setting.strategy.stops:  # the referee looks at the maps of the others
        map_is_whole(flight, drawn(seed))
    assert fold(flight.setting, flight.events) == flight.state


def test_traffic_of_these_missions_has_teams_hold_and_come_home():
    """The missions would prove nothing about traffic if it were always far away."""
    answers = [flown(seed)[1] for seed in range(3)]
    assert sum(Answer.HOLD in each for each in answers) >= 2
    assert sum(Answer.COME_HOME in each for each in answers) >= 2


def near(flight: Fleet, **how: object) -> Track:
    track = Track("A", "A", flight.now_s, GridPoint(0.0, 900.0), 50.0, 0.0, GridPoint(0.0, 0.0))
    return track._replace(**how)


def test_operator_lets_the_team_go_on_in_spite_of_traffic():
    scenario = random_scenario(0)
    flight = fleet(scenario.mission, scenario.roi)
    flight.start()
    flight.run(until=lambda flight: any(v.works for v in flight.state.vehicles.values()))
    flight.post(TrafficSeen(flight.now_s, (near(flight),)))
    assert flight.state.is_held
    flight.post(Continued(flight.now_s))
    flight.post(TrafficSeen(flight.now_s, (near(flight),)))
    assert not flight.state.is_held


def works_away(flight: Fleet) -> bool:
    """Return whether a vehicle works so far from its pad that its return takes a while."""
    return any(v.works and v.position.distance_to(v.pad) > 20.0 for v in flight.state.own_vehicles)


def test_vehicle_that_comes_home_for_traffic_turns_round_once_it_is_gone():
    scenario = random_scenario(0)
    flight = fleet(scenario.mission, scenario.roi)
    flight.start()
    flight.run(until=works_away)
    number = next(v.vehicle for v in flight.state.own_vehicles if v.works)
    flight.post(TrafficSeen(flight.now_s, (near(flight, velocity_m_s=None),)))
    assert flight.state.vehicles[number].return_reason is ReturnReason.TRAFFIC
    gone = near(flight, place=GridPoint(0.0, 5000.0))
    flight.post(TrafficSeen(flight.now_s, (gone,)))
    flight.run(until=lambda flight: flight.state.traffic.answer is Answer.GO_ON)
    flight.tick()
    assert flight.state.vehicles[number].return_reason in (None, ReturnReason.TRAFFIC)
    flight.run()
    assert flight.faults == []


@pytest.mark.parametrize("called", [True, False])
def test_vehicle_that_has_to_come_home_anyway_flies_on_when_the_traffic_is_gone(called):
    scenario = random_scenario(0)
    flight = fleet(scenario.mission, scenario.roi)
    flight.start()
    flight.run(until=works_away)
    number = next(v.vehicle for v in flight.state.own_vehicles if v.works)
    flight.post(TrafficSeen(flight.now_s, (near(flight, velocity_m_s=None),)))

    def flies_home(flight: Fleet) -> bool:
        vehicle = flight.state.vehicles[number]
        return vehicle.flees and isinstance(vehicle.order, FlyTo)

    flight.run(until=flies_home)
    vehicle = flight.state.vehicles[number]
    gone = replace(flight.state, traffic=NO_TRAFFIC)
    low = replace(vehicle, called_home=called, remaining_wh=vehicle.remaining_wh if called else 0.1)
    after = turn_back(gone.with_vehicle(low), low).vehicles[number]
    assert after.return_reason is (ReturnReason.RECALLED if called else ReturnReason.BATTERY)
    assert after.order is vehicle.order
