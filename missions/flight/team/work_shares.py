"""Work shares: tours past the rest of the map for each vehicle.

A plan is made for the vehicles that can fly it now. Without tours for all (`planning.sweep.tours`),
one vehicle would set out to map all that four others have found, and abandon that at every new
plan. So tours begin where each vehicle will be when its lanes are flown. The cells of other
vehicles are left out of the plan.

In a fleet, one member plans the tours: the lowest number of those that map and are in contact. It
assigns the parts, and reports their places. From then on a cell belongs to the vehicle whose place
is nearest. This holds for later cells as well. Every member with the same parts agrees on that. A
member out of contact keeps its part for as long as that should take it. A member that returns, is
down or is flown by its pilot has none. A member that has not received parts for `PARTS_VALID_S`
plans for all members that it is in contact with.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np

from missions.flight.state import Setting, State
from missions.flight.strategy.charting import flyer_of, in_map_layer
from missions.flight.vehicle_state import Allotment, Phase, VehicleState
from missions.planning.search.lanes import Lane, rest_ahead
from missions.planning.sweep.chart import Bits, Chart, KnownMap, nearest_place
from missions.planning.sweep.memo import tours_once
from missions.planning.sweep.open_work import OpenWork, TourMemory
from missions.planning.sweep.paths import CUT_M, Flyer, Tour, Tours, Waypoints
from missions.units import Cell, GridPoint

Delayed = dict[int, tuple[Flyer, float]]
"""Vehicles, and the time from the beginning of the tours until they map, s."""

SHARE_INTERVAL_S: Final = 4.0
"""Minimum time between two shares of the work, s."""
MIN_SHARE_GAIN_S: Final = 8.0
"""Minimum gain of a new share over the last one, s. A vehicle whose part changes flies there, and
knows later what the other has seen."""
PARTS_VALID_S: Final = 30.0
"""Validity of parts while their member is in contact and reports nothing new, s."""
PART_HELD_FACTOR: Final = 1.3
"""Time that a member out of contact keeps its part, as a multiple of the estimate."""
PART_HELD_SLACK_S: Final = 30.0
"""Additional time that it keeps its part, s."""
HEADING_LOOK_AHEAD_S: Final = 5.0
"""Time ahead at which the direction of a path is taken, s."""


# --- a service that commands all vehicles -------------------------------------------------------
def shared_out(state: State, work: OpenWork) -> tuple[TourMemory, Waypoints]:
    """Close others' cells in the chart, and lay tours if that is due.

    Returns the new memory, and waypoints for the team; none where the last plan continues."""
    known, team, memory, _ = work
    waypoints: Waypoints = ()
    numbers = frozenset(team)
    if state.t_s >= memory.laid_s + SHARE_INTERVAL_S or not numbers <= memory.team:
        everyone = _at_once(team) | _at_path_end(state, numbers)
        tours = _tours(state, work, everyone, memory.tours)
        laid = {} if tours is None else dict(zip(everyone, tours.waypoints, strict=True))
        others: frozenset[Cell] = frozenset()
        if tours is not None:
            waypoints = tours.waypoints[: len(team)]
            cells = (tours.mine >= len(team)).nonzero()[0]
            others = frozenset(known.chart.cell(int(index)) for index in cells)
        memory = TourMemory(state.t_s, numbers, laid, others)
    chart = known.chart
    chart.closed[[chart.index(cell) for cell in memory.others if chart.holds(cell)]] = 1
    return memory, waypoints


def _begin_s(state: State) -> float:
    """Return the time when tours that are planned now begin, s."""
    return round(state.t_s + 1.0, 3)


def _at_path_end(state: State, team: frozenset[int]) -> Delayed:
    """Return the vehicles that fly lanes, and how much later their tours begin, s."""
    found, begin_s = {}, _begin_s(state)
    for number, vehicle in sorted(state.vehicles.items()):
        returns = vehicle.return_reason is not None
        if number in team or not vehicle.lanes or returns or vehicle.path is None:
            continue
        delay_s = max(vehicle.path.end_s - begin_s, 0.0)
        low = in_map_layer(state.setting, vehicle)
        found[number] = flyer_of(state.setting, low, None, None, begin_s), delay_s
    return found


def _at_once(team: Mapping[int, Flyer]) -> Delayed:
    """Return the vehicles that can begin to map now."""
    return {number: (flyer, 0.0) for number, flyer in team.items()}


def _tours(
    state: State, work: OpenWork, everyone: Delayed, before: Mapping[int, Tour], **how: float
) -> Tours | None:
    """Lay a tour for each vehicle. `before` are the last tours, `how` are options of `tours_once`.
    None if too little is left to see."""
    votes, last = state.setting.mission.votes, tuple(before.get(n, ()) for n in everyone)
    flyers, delays_s = zip(*everyone.values(), strict=True)
    return tours_once(
        state.setting.plans, work.known, flyers, delays_s, votes.frames, votes.positive,
        _begin_s(state), work.decision, last, **how,  # type: ignore[arg-type]
    )  # fmt: skip


# --- members of a fleet -------------------------------------------------------------------------
def share_parts(mine: int, state: State, work: OpenWork) -> State:
    """Return the state with new parts, if our member lays them and they are due."""
    last, flyers = state.allotment, work.flyers
    if mine != min(flyers):
        return state
    before = {} if last is None else last.parts
    ours = last is not None and last.by == mine and flyers.keys() <= before.keys()
    if ours and last is not None and state.t_s < last.made_s + SHARE_INTERVAL_S:
        return state
    everyone = _at_once(flyers) | _later(state, frozenset(flyers))
    held = {n: part for n, part in before.items() if n not in everyone and _maps(state, n)}
    chart = work.known.chart
    open_ = chart.closed.copy()
    if held:
        chart.closed[_cells_nearest_to(chart, before, state, frozenset(held))] = 1
    cuts = {number: _tour(places) for number, places in before.items()}
    tours = _tours(state, work, everyone, cuts, least=1, keep_s=MIN_SHARE_GAIN_S)
    chart.closed[:] = open_
    if tours is None:
        return state
    laid = {
        number: tuple(GridPoint(x, y) for x, y, _ in tour)
        for number, tour in zip(everyone, tours.waypoints, strict=True)
    }
    return replace(state, allotment=Allotment(mine, state.t_s, {**held, **laid}))


def own_part(
    mine: int, state: State, chart: Chart, memory: TourMemory
) -> tuple[Bits | None, TourMemory, Waypoints]:
    """Close others' cells in a chart, while our vehicle keeps to its part.

    Returns the closed cells, None without a part; the memory; and the beginning of our plan, empty
    where the last one continues."""
    found = state.allotment
    if found is None or mine not in found.parts:
        return None, memory, ()
    if state.t_s >= found.made_s + PARTS_VALID_S:
        return None, memory, ()
    others = frozenset(n for n in found.parts if n != mine and _maps(state, n))
    theirs = _cells_nearest_to(chart, found.parts, state, others) & (chart.closed == 0)
    chart.closed[theirs] = 1
    tour = _tour(found.parts[mine])
    fresh = bool(tour) and found.made_s > memory.laid_s
    return theirs, replace(memory, laid_s=found.made_s), (tour,) if fresh else ()


def _tour(places: Sequence[GridPoint]) -> Tour:
    """Return observation points in the form of the tour planner."""
    return tuple((place.east_m, place.north_m, CUT_M) for place in places)


def mark_unreported(mine: int, state: State, known: KnownMap) -> bool:
    """Mark undecided cells that are seen from the places of our part; return whether there are any.
    Votes that decide nothing are not reported. The member that lays the parts may miss such cells,
    and no other vehicle observes them."""
    found, wanted = state.allotment, known.wanted
    if found is None or wanted is None:
        return False
    chart, any_ = known.chart, False
    low = in_map_layer(state.setting, state.vehicles[mine])
    seen = state.setting.kinematics(low.cruise_height_m, low.wind_m_s)
    reach_e, reach_n = seen.half_east_m / chart.cell_m, seen.half_north_m / chart.cell_m
    for place in found.parts.get(mine, ()):
        x, y = place.east_m / chart.cell_m, place.north_m / chart.cell_m
        for east in range(math.ceil(x - reach_e), math.floor(x + reach_e) + 1):
            for north in range(math.ceil(y - reach_n), math.floor(y + reach_n) + 1):
                cell = Cell(east, north)
                if chart.holds(cell) and state.belief.verdict(cell) is None:
                    index = chart.index(cell)
                    wanted[index], any_ = 1, any_ or not chart.closed[index]
    return any_


def held_until_s(state: State, vehicle: VehicleState, t_s: float) -> float:
    """Return when a member that is out of contact since `t_s` should have done its work, s."""
    setting = state.setting
    left_s, place = _lanes_left(setting, vehicle)
    found = state.allotment
    places = () if found is None else found.parts.get(vehicle.vehicle, ())
    if not places and not vehicle.lanes:
        return t_s
    way_m = sum(a.distance_to(b) for a, b in pairwise((place, *places, vehicle.pad)))
    low = in_map_layer(setting, vehicle)
    map_s = way_m / setting.path_speed_m_s(low.cruise_height_m, 0.0)
    return t_s + PART_HELD_SLACK_S + PART_HELD_FACTOR * (left_s + map_s)


def back_from_lanes_s(setting: Setting, vehicle: VehicleState, t_s: float) -> float:
    """Return when a member that is out of contact since `t_s` should be back from its lanes, s."""
    left_s, place = _lanes_left(setting, vehicle)
    speed_m_s = setting.path_speed_m_s(setting.heights.layer_m(setting, vehicle), 0.0)
    return t_s + left_s + place.distance_to(vehicle.pad) / speed_m_s


def _maps(state: State, number: int) -> bool:
    """Return whether a vehicle maps its part, or will when its lanes are flown."""
    vehicle = state.vehicles[number]
    if vehicle.phase is Phase.APART:
        return state.t_s < vehicle.held_until_s
    return vehicle.works


def _cells_nearest_to(
    chart: Chart, parts: Mapping[int, tuple[GridPoint, ...]], state: State, whose: frozenset[int]
) -> Bits:
    """Return the cells whose nearest place belongs to one of `whose`, of all that map."""
    mapping = tuple((n, places) for n, places in sorted(parts.items()) if _maps(state, n))
    half_east_m, half_north_m = state.setting.seen_whole_m(state.setting.mission.altitude_m(0))
    high = max(half_north_m, 0.1) / max(half_east_m, 0.1)
    nearest = nearest_place(mapping, chart.grid, high)
    return np.isin(nearest, sorted(whose))


def _later(state: State, team: frozenset[int]) -> Delayed:
    """Return the vehicles that map once their lanes are flown: where, and how much later, s."""
    setting, found = state.setting, {}
    for number, vehicle in sorted(state.vehicles.items()):
        if number in team or not vehicle.works:
            continue
        left_s, place = _lanes_left(setting, vehicle)
        low = replace(in_map_layer(setting, vehicle), order=None)
        flyer = flyer_of(setting, low, None, None, _begin_s(state))
        found[number] = replace(flyer, place=place), left_s
    return found


def _lanes_left(setting: Setting, vehicle: VehicleState) -> tuple[float, GridPoint]:
    """Return the time that a vehicle needs for lanes and layer change, s, and its place then."""
    high = replace(vehicle, cruise_altitude_m=setting.heights.layer_m(setting, vehicle))
    speed_m_s = setting.path_speed_m_s(high.cruise_height_m, 0.0)
    now_s = vehicle.tracked_s
    at, way_m = setting.grid.to_moving(vehicle.position, now_s), 0.0
    for k, lane in enumerate(vehicle.lanes):
        if k == 0 and vehicle.path is not None:
            path, begin_s = vehicle.path, vehicle.path.begin_s
            leads = path.place_at(begin_s), path.place_at(begin_s + HEADING_LOOK_AHEAD_S)
            ends: tuple[Lane, ...] = (rest_ahead(lane, at, *leads),)
        else:
            ends = (lane, (lane[1], lane[0]))
        start, end = min(ends, key=lambda way: at.distance_to(way[0]))
        way_m += at.distance_to(start) + start.distance_to(end)
        at = end
    down_m = max(vehicle.level_m - setting.mission.altitude_m(vehicle.vehicle - 1), 0.0)
    return way_m / speed_m_s + down_m / setting.energy.climb_m_s, at
