"""Exploring without a stop: paths that are planned anew while they are flown.

A path is an exact function of time, so a vehicle's place at the beginning of the next plan is known
without telemetry. The planner (`missions.planning.sweep.sweep_planner`) is asked again whenever
frames were judged. Every plan begins `PLAN_LEAD_S` in the future, on the present path.

A vehicle that has nothing to fly, or may not fly its plan, is planned for again after `RETRY_S`.
When no frame has added a vote for longer than the paths took, the rest is given up.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from missions.flight.path_orders import PLAN_LEAD_S, descent, fly_route, give_path
from missions.flight.return_home import flies_home
from missions.flight.state import Setting, State, Strategy
from missions.flight.strategy.charting import chart_of, flyer_of, over_home_s
from missions.flight.strategy.direct_flight import fetch
from missions.flight.strategy.fallback import fall_back, patience_s
from missions.flight.vehicle_state import Phase, ReturnReason, VehicleState
from missions.geo.path_in_fence import allowed, is_outside
from missions.geo.trajectory import Trajectory
from missions.mapping.tree import left_out
from missions.orders import FlyPath
from missions.planning.sweep.chart import KnownMap
from missions.planning.sweep.memo import plan_once, valued
from missions.planning.sweep.open_work import OpenWork, TourMemory, Work
from missions.planning.sweep.paths import Flyer, Plan, Route, Tuning, Waypoints
from missions.units import Cell

REPLAN_S: Final = 0.4
"""Minimum time between two plans, s."""
RETRY_S: Final = 2.0
"""Time after which a waiting vehicle is planned for again without news, s."""
STALLED_S: Final = 20.0
STALLED_SHARE: Final = 1.2
"""Time without a vote after which plans are stalled: s, and multiples of the longest path."""
STEP_M: Final = 1.0
"""Minimum length of a path that leads anywhere, m."""
MAX_PRIORITY: Final = 3
"""Maximum number of rises of priority for undone work, before a direct flight."""
PRIORITY: Final = 4.0
"""Factor of the penalty of work left undone for each step of its priority."""
OWN_PART_FACTOR: Final = 2.0
"""Factor of that penalty for a member's own part: no other vehicle maps it on its way."""
DETOUR_S: Final = 3.0
"""Excess over the straight path home that stays allowed once all is explored, s."""
NEAR_PAD_M: Final = 10.0
"""Distance to its pad within which a vehicle waits for others, m."""


@dataclass(frozen=True, slots=True)
class PathMemory:
    """Memory of the last plan for the next one."""

    planned_s: float = float("-inf")
    frames: int = -1
    """Number of frames that were judged by then."""
    waiting: frozenset[int] = frozenset()
    """Vehicles without a path after it."""
    routes: Mapping[int, Route] = field(default_factory=dict)
    paths: Mapping[int, Trajectory] = field(default_factory=dict)
    decisions: int = 0
    flown_s: float = 0.0
    """Time that vehicles have explored, s."""
    priority: int = 0
    votes: int = 0
    """Number of votes that counted by then."""
    stalled_s: float = 0.0
    """Time that plans were flown since the last added vote, s."""
    longest_s: float = 0.0
    """Duration of the longest path since then, s."""
    fetching: Mapping[int, Trajectory] = field(default_factory=dict)
    """Vehicles that fly straight to the rest; they are not planned for until they arrive."""
    tried: frozenset[Cell] = frozenset()
    """Their observation points since a vote was last added."""
    tour: TourMemory = field(default_factory=TourMemory)


def explore_paths(strategy: Strategy, state: State) -> State:
    """Plan anew for all vehicles that explore, if there is news and the last plan is old enough."""
    setting, tree = state.setting, state.tree
    lanes_left = strategy.flies_all_lanes and any(v.lanes for v in state.vehicles.values())
    memory = path_memory(state)
    team = {
        n: v for n, v in sorted(state.vehicles.items()) if _takes_part(strategy, state, v, memory)
    }
    ours = frozenset(n for n in team if n in state.our_numbers)
    waiting = frozenset(n for n in ours if team[n].idle)
    frames = state.belief.frames_taken(None)
    fresh = frames != memory.frames
    news = fresh or bool(waiting - memory.waiting)
    retry = bool(waiting) and state.t_s >= memory.planned_s + RETRY_S
    replan_s = max(REPLAN_S, strategy.replan_frames * setting.mission.camera.interval_s)
    due = state.t_s >= memory.planned_s + replan_s - 1e-6
    if not ours or not due or not (news or retry):
        return state
    begin_s = round(state.t_s + PLAN_LEAD_S, 3)
    able = {n: v for n, v in state.vehicles.items() if _able(v)}
    home_s = max(over_home_s(team[n].path, memory.paths.get(n), begin_s) for n in ours)
    known = chart_of(state, None if tree is None else tree.root, begin_s, able, home_s)
    memory = replace(memory, frames=frames, priority=0 if fresh else memory.priority)
    memory = _note_progress(memory, state, team)
    if tree is not None and memory.flown_s > patience_s(state):
        return fall_back(state)
    stalls = memory.stalled_s > STALLED_S + STALLED_SHARE * memory.longest_s
    if stalls and not lanes_left:
        return give_up_rest(replace(state, memory=memory))
    if memory.tried and waiting == ours:
        return _fetch(state, memory, known, waiting)
    paths, routes = memory.paths, memory.routes
    flyers = {
        n: flyer_of(setting, vehicle, paths.get(n), routes.get(n), begin_s)
        for n, vehicle in team.items()
    }
    work = Work(memory.tour)
    if strategy.shares_work:
        open_work = OpenWork(known, flyers, memory.tour, memory.decisions)
        state, work = setting.team.share_work(state, open_work)
    tour, tours, others_part = work
    memory = replace(memory, tour=tour)
    if others_part is not None:  # they plan for themselves
        team = {n: team[n] for n in sorted(ours)}
        flyers = {n: flyers[n] for n in team}
    times = 1.0 if others_part is None else OWN_PART_FACTOR
    plan = _plan(setting, known, flyers, memory, begin_s, tours, times)
    if plan.work == 0 and lanes_left and known.chart.open_behind():
        # without other work it maps behind the vehicles that still fly lanes
        plan = _plan(setting, known, flyers, memory, begin_s, tours, times)
    if plan.work == 0 and others_part is not None and setting.team.mark_unreported(state, known):
        plan = _plan(setting, known, flyers, memory, begin_s, tours, times)
    if plan.work == 0 and others_part is not None:
        known.chart.closed[others_part] = 0
        votes = setting.mission.votes
        # while others map it, no plan is stalled
        if valued(known, votes.frames, votes.positive)[3] > 0:
            state = replace(state, memory=replace(memory, waiting=waiting, stalled_s=0.0))
            return _homeward(state, waiting)
    if plan.work == 0:
        state = replace(state, memory=replace(memory, waiting=waiting))
        return state if lanes_left else give_up_rest(state)
    state, memory, blocked = _fly(state, team, plan, memory)
    idle = frozenset(n for n in ours if state.vehicles[n].idle)
    others_can = any(
        n not in ours and not _nowhere(path) for n, path in zip(team, plan.paths, strict=True)
    )
    if idle != ours or blocked or others_can:
        return replace(state, memory=replace(memory, waiting=idle))
    if all(map(_nowhere, plan.paths)) and memory.priority < MAX_PRIORITY:
        # once more, with a higher priority
        memory = replace(memory, priority=memory.priority + 1, waiting=frozenset())
        return replace(state, memory=memory)
    return _fetch(state, memory, known, idle)


def _homeward(state: State, waiting: frozenset[int]) -> State:
    """Have vehicles that wait while others map fly towards their pads."""
    for number in sorted(waiting):
        vehicle = state.vehicles[number]
        route = state.setting.fence.route(vehicle.position, state.setting.fence.inside(vehicle.pad))
        if route and vehicle.position.distance_to(route[-1]) > NEAR_PAD_M:
            state = fly_route(state, vehicle, route)
    return state


def _fetch(state: State, memory: PathMemory, known: KnownMap, idle: frozenset[int]) -> State:
    """Have the nearest waiting vehicle fly to the rest; give it up if none can."""
    waiting = {n: state.vehicles[n] for n in idle}
    found = fetch(state, waiting, known, memory.tried)
    if found is None:
        if any(n not in idle and _able(v) for n, v in state.vehicles.items()):
            return replace(state, memory=replace(memory, waiting=idle))
        return give_up_rest(replace(state, memory=memory))
    state = give_path(state, waiting[found.vehicle], found.path)
    if state.vehicles[found.vehicle].path is not None:
        memory = replace(
            memory,
            tried=memory.tried | {found.vantage},
            fetching={**memory.fetching, found.vehicle: found.path},
            longest_s=max(memory.longest_s, found.path.end_s - state.t_s),
        )
    return replace(state, memory=replace(memory, waiting=idle - {found.vehicle}))


def go_straight_home(state: State) -> State:
    """Straighten return paths once all is explored."""
    setting, memory = state.setting, path_memory(state)
    if state.t_s < memory.planned_s + REPLAN_S:
        return state
    begin_s, memory = round(state.t_s + PLAN_LEAD_S, 3), replace(memory, planned_s=state.t_s)
    for number, vehicle in sorted(state.vehicles.items()):
        path = vehicle.path
        if path is None or number not in state.our_numbers or not flies_home(vehicle):
            continue
        home_s = path.place_at(begin_s).distance_to(vehicle.pad) / setting.energy.speed_m_s
        if path.end_s - begin_s < home_s + DETOUR_S:
            continue
        chart = chart_of(state, None, begin_s, {number: vehicle}).chart
        known = KnownMap(chart, -1, np.zeros_like(chart.closed))
        flyer = flyer_of(setting, vehicle, memory.paths.get(number), None, begin_s)
        plan = _plan(setting, known, {number: flyer}, memory, begin_s, (), 1.0)
        state, memory, _ = _fly(state, {number: vehicle}, plan, memory)
    return replace(state, memory=memory)


def path_memory(state: State) -> PathMemory:
    """Return the memory of the last plan."""
    return state.memory if isinstance(state.memory, PathMemory) else PathMemory()


def _able(vehicle: VehicleState) -> bool:
    """Return whether a vehicle explores, or may again after a battery swap."""
    here = vehicle.phase in (Phase.AIRBORNE, Phase.GROUNDED)
    return here and vehicle.return_reason in (None, ReturnReason.BATTERY, ReturnReason.TRAFFIC)


def _note_progress(
    memory: PathMemory, state: State, team: Mapping[int, VehicleState]
) -> PathMemory:
    """Return the memory at a new plan: whether the last plans have added a vote."""
    votes = sum(total for _, total in state.belief.open_tallies.values())
    since_s = min(state.t_s - memory.planned_s, RETRY_S)
    stalled_s, flown_s = memory.stalled_s + since_s, memory.flown_s + since_s
    if votes != memory.votes:
        ends = (v.path.end_s for v in team.values() if v.path is not None)
        left_s = max((end_s - state.t_s for end_s in ends), default=0.0)
        memory, stalled_s = replace(memory, votes=votes, longest_s=left_s, tried=frozenset()), 0.0
    return replace(
        memory, planned_s=state.t_s, stalled_s=stalled_s, flown_s=flown_s,
        decisions=memory.decisions + 1,
    )  # fmt: skip


def _takes_part(
    strategy: Strategy, state: State, vehicle: VehicleState, memory: PathMemory
) -> bool:
    path, ours = vehicle.path, vehicle.vehicle in state.our_numbers
    idle = path is None and vehicle.idle
    if not vehicle.works or vehicle.braking_until_s is not None or not (idle or path is not None):
        return False
    if path is not None:
        apart = memory.fetching.get(vehicle.vehicle) is path
    else:
        # our vehicle comes inside first; over another's pad only that vehicle may be
        whole = None if ours else state.setting.whole_fence
        apart = is_outside(whole or state.setting.fence, vehicle.position)
    if apart or (strategy.flies_all_lanes and vehicle.lanes):
        return False
    waits = ours and idle and strategy.shares_work and state.setting.team.gathers(state, vehicle)
    return not waits and state.setting.heights.in_layer(state, vehicle)


def _plan(
    setting: Setting,
    known: KnownMap,
    flyers: Mapping[int, Flyer],
    memory: PathMemory,
    begin_s: float,
    tours: Waypoints,
    times: float,
) -> Plan:
    votes = setting.mission.votes
    penalty_s = Tuning().penalty_s * times * PRIORITY**memory.priority
    return plan_once(
        setting.plans, Tuning(penalty_s=penalty_s), known, tuple(flyers.values()), votes.frames,
        votes.positive, begin_s, memory.decisions, tours,
    )  # fmt: skip


def _fly(
    state: State, team: Mapping[int, VehicleState], plan: Plan, memory: PathMemory
) -> tuple[State, PathMemory, bool]:
    """Give the new paths that may be flown; return also whether a vehicle waits for clear air."""
    routes, paths = dict(memory.routes), dict(memory.paths)
    longest_s, blocked = memory.longest_s, False
    for number, path, route in zip(team, plan.paths, plan.routes, strict=True):
        vehicle = state.vehicles[number]
        if path is None or number not in state.our_numbers:
            continue  # others report their paths; theirs are planned for the sake of our vehicle
        if _nowhere(path) and _nowhere(vehicle.path):
            if vehicle.idle and (down := descent(state.setting, vehicle, path.begin_s)):
                state = give_path(state, vehicle, down)
            continue
        flown = replace(path, drift_m_s=state.setting.grid.drift_m_s)
        before = vehicle.order
        state = give_path(state, vehicle, flown, partly=True)
        given = state.vehicles[number].order
        if given is not before and isinstance(given, FlyPath):
            routes[number], paths[number] = route, flown
            longest_s = max(longest_s, flown.end_s - state.t_s)
        elif vehicle.idle and allowed(state.setting.fence, flown):
            blocked = True  # its air is reserved, which passes: no plan is stalled yet
        elif vehicle.idle:
            state = state.setting.team.leave_column(state, vehicle)
    stalled_s = 0.0 if blocked else memory.stalled_s
    memory = replace(memory, routes=routes, paths=paths, longest_s=longest_s, stalled_s=stalled_s)
    return state, memory, blocked


def _nowhere(path: Trajectory | None) -> bool:
    """Return whether a path leads nowhere, but for a step to its end."""
    return path is None or path.length_m < STEP_M


def give_up_rest(state: State) -> State:
    """Give up cells that cannot be decided; they keep their present state."""
    tree = state.tree
    if tree is None:
        open_ = state.setting.strategy.open_cells(state)
        return replace(state, exhausted=True, surveyed=True, undecided=open_)
    tree, given_up = left_out(tree, state.belief)
    return replace(state, tree=tree, undecided=state.undecided | given_up)
