"""Whole missions with a fake fleet: rules at every instant, and at the end."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from missions.events import Event, FrameSeen
from missions.flight.vehicle_state import Phase
from missions.geo.terrain import FOLLOW_M
from missions.lab.arena.roi import component
from missions.mapping.belief import Belief, FrameId
from missions.orders import Hold, TakeOff
from missions.planning.stepwise import EXPLORERS
from tests.fake_fleet import Fleet, fleet
from tests.support.folding import fold
from tests.support.ground.hills import hills, over
from tests.support.small_missions import Scenario, random_scenario, reachable

SEEDS = range(9)
DRIFT_SEEDS = range(5)
KINDS = ["pilot", "link", "crash"]


def begun(scenario: Scenario) -> Fleet:
    flight = fleet(scenario.mission, scenario.roi)
    flight.start()
    return flight


def flown(scenario: Scenario) -> Fleet:
    flight = begun(scenario)
    flight.run()
    return flight


@functools.cache
def undisturbed(seed: int) -> Fleet:
    return flown(random_scenario(seed))


def map_is_whole(flight: Fleet, scenario: Scenario) -> None:
    state = flight.state
    assert state.belief.roi <= scenario.roi
    if state.tree is None:
        assert state.exhausted
        return
    looked, mapped = reachable(flight.setting, scenario.roi, state.tree.root)
    assert mapped <= state.belief.roi
    assert {c for c in looked if c not in state.tree or not state.tree.is_observed(c)} == set()
    assert state.abandoned.isdisjoint(looked)
    assert state.completed == (looked == component(scenario.roi, state.tree.root))


@pytest.mark.parametrize("seed", SEEDS)
def test_mission_ends_with_a_whole_map_and_all_vehicles_safe(seed):
    flight = undisturbed(seed)
    assert flight.faults == []
    assert {v.phase for v in flight.state.vehicles.values()} == {Phase.FINISHED}
    map_is_whole(flight, random_scenario(seed))


@pytest.mark.parametrize("seed", DRIFT_SEEDS)
def test_a_drifting_region_is_mapped_whole(seed):
    scenario = random_scenario(seed, drift=True)
    flight = flown(scenario)
    assert flight.faults == []
    assert flight.state.completed
    if flight.state.tree is not None:
        assert component(scenario.roi, flight.state.tree.root) <= flight.state.belief.roi


def test_the_batteries_are_swapped_somewhere():
    """The scenarios would prove nothing about batteries if one were always enough."""
    swaps = [
        sum(isinstance(order, TakeOff) for _, _, order in flight.orders) - len(flight.vehicles)
        for flight in map(undisturbed, (6, 9, 16))
    ]
    assert all(count > 0 for count in swaps)


def test_the_reserve_check_can_fail():
    """An unexpected squall far from home breaks the reserve."""
    scenario = random_scenario(11)
    flight = begun(scenario)
    farthest_s = next(t_s for t_s, _, order in undisturbed(11).orders if isinstance(order, Hold))
    flight.run(until=lambda f: f.t_s >= farthest_s)
    flight.vehicles[1].hover_w = 1800.0
    flight.run(until=lambda f: bool(f.faults))
    faults = flight.faults
    assert any("reserve" in fault or "fell" in fault for fault in faults)


# --- interruptions ---------------------------------------------------------------------------
def interrupted(scenario: Scenario, kind: str, rng: np.random.Generator) -> Fleet:
    flight = begun(scenario)
    for _ in range(5):
        until_s = flight.t_s + float(rng.uniform(3, 60))
        while flight.t_s < until_s and not flight.state.is_over:
            flight.tick()
        if flight.state.is_over:
            break
        number = int(rng.integers(1, len(flight.vehicles) + 1))
        pause_s = float(rng.uniform(2, 20))
        if kind == "crash":
            flight.crash_and_resume()
        elif flight.state.vehicles[number].phase is not Phase.FINISHED:
            (flight.take_over if kind == "pilot" else flight.cut_link)(number)
            until_s = flight.t_s + pause_s
            while flight.t_s < until_s:
                flight.tick()
            if kind == "pilot":
                flight.give_back(number)
            else:
                flight.mend_link(number)
    flight.run()
    return flight


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(5))
def test_interruptions_change_nothing_in_the_end(seed, kind):
    scenario = random_scenario(100 + seed)
    flight = interrupted(scenario, kind, np.random.default_rng([seed, KINDS.index(kind)]))
    assert flight.faults == []
    map_is_whole(flight, scenario)
    for event in flight.events:
        if isinstance(event, FrameSeen):
            frame = FrameId(event.vehicle, event.t_s)
            assert frame in flight.state.belief.looks[event.vantage]


@pytest.mark.parametrize("seed", range(4))
def test_recall_brings_all_vehicles_home_and_a_resume_continues(seed):
    scenario = random_scenario(200 + seed)
    flight = begun(scenario)
    when_s = float(np.random.default_rng(seed).uniform(2, 70))
    flight.run(until=lambda f: f.t_s >= when_s)
    flight.recall()
    flight.run(600.0)
    assert not any(v.flying for v in flight.vehicles.values())
    flight.crash_and_resume()
    flight.run()
    assert flight.faults == []
    map_is_whole(flight, scenario)


@pytest.mark.parametrize("seed", range(6))
def test_vehicle_lost_for_good_leaves_its_work_to_the_others(seed):
    """A vehicle lands under its pilot and never comes back: the others finish its work."""
    scenario = next(
        s for s in (random_scenario(330 + 10 * seed + i) for i in range(10))
        if len(s.mission.vehicles) > 1
    )  # fmt: skip
    flight = begun(scenario)
    flight.run(until=lambda f: f.t_s >= 12.0 + 3 * seed)
    number = next(n for n, craft in flight.vehicles.items() if craft.flying)
    flight.take_over(number)
    flight.tick()
    flight.put_down(number)
    flight.run()
    assert flight.faults == []
    map_is_whole(flight, scenario)


# --- the journal -----------------------------------------------------------------------------
def belief_of(events: list[Event], empty: Belief) -> Belief:
    belief = empty
    for event in events:
        if isinstance(event, FrameSeen):
            votes = {vote.cell: vote.positive for vote in event.votes}
            belief = belief.with_frame(event.vantage, FrameId(event.vehicle, event.t_s), votes)
    return belief


@pytest.mark.parametrize("seed", [0, 2, 14])
def test_the_same_frames_in_any_order_make_the_same_map(seed):
    flight = undisturbed(seed)
    mission = flight.setting.mission
    empty = Belief(mission.votes.frames, mission.votes.positive)
    events = list(flight.events)
    np.random.default_rng(seed).shuffle(events)
    assert belief_of(events, empty) == flight.state.belief


def test_the_same_scenario_twice_gives_the_same_events_and_orders():
    once, again = undisturbed(14), flown(random_scenario(14))
    assert once.events == again.events
    assert once.orders == again.orders
    assert fold(once.setting, once.events) == once.state


# --- strategies ------------------------------------------------------------------------------
def led_by(name: str, seed: int) -> Scenario:
    drawn = (random_scenario(seed + i) for i in range(100))
    scenario = next(s for s in drawn if len(s.mission.vehicles) > 1 and len(s.roi) < 12)
    mission = scenario.mission.model_copy(update={"strategy": name})
    return Scenario(mission, scenario.roi)


@pytest.mark.parametrize("name", EXPLORERS)
def test_every_strategy_flies_and_goes_on_after_a_crash(name):
    """After the crash the fold of the journal, with the strategy's memory, equals the state."""
    scenario = led_by(name, 400)
    flight = begun(scenario)
    flight.run(until=lambda f: f.state.tree is not None and len(f.state.tree) > 3)
    flight.crash_and_resume()
    flight.run()
    assert flight.faults == []
    assert fold(flight.setting, flight.events) == flight.state
    map_is_whole(flight, scenario)


@pytest.mark.parametrize(("seed", "strategy"), [(0, None), (7, "swath")])
def test_map_over_random_hills_is_whole_and_no_vehicle_comes_near_the_ground(seed, strategy):
    scenario = random_scenario(seed, strategy=strategy)
    mission = over(scenario.mission, hills(seed, 16.0))
    mission = mission.model_copy(
        update={"battery": mission.battery.model_copy(update={"capacity_wh": 60.0})}
    )
    flight = fleet(mission, scenario.roi)
    flight.start()
    flight.run()
    assert flight.faults == []
    assert {v.phase for v in flight.state.vehicles.values()} == {Phase.FINISHED}
    if strategy is None:
        map_is_whole(flight, scenario)
    assert min(d.least_off_m for d in flight.drivers.values()) >= -FOLLOW_M
