"""Who of a fleet is to map what: one member lays it out for all that it hears, all keep to it.

Were each to plan for all, everybody would have others do what they know nothing of, and several
would map the same outline. So the one with the lowest number of those who map and hear each other
lays tours for all of them, as one service would (`missions.flight.strategy.touring`), and tells
them. From then on a cell is of the vehicle whose place is the nearest to it, also one that nobody
knew of when the tours were laid: each cell is somebody's, and everybody who was told the same sees
that alike. Each plans its own path past what is its own.

Who is out of contact is taken to map its part for as long as that should take it. Whoever returns,
is down or is its pilot's has none: what was near to its places is nearest to another's. Who was
told nothing for `KNOWN_S` by one who should tell plans for all that it hears.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from missions.flight.setting import Setting
from missions.flight.state import Allotment, Phase, State, VehicleState
from missions.flight.strategy.flyers import flyer_of, kinematics
from missions.flight.strategy.interface import OpenWork, TourMemory
from missions.flight.strategy.touring import at_once, tours_of
from missions.geo.trajectory import Trajectory
from missions.planning.search.lanes import Lane
from missions.planning.sweep.chart import Chart, Ints, Known
from missions.units import Cell, GridPoint

if TYPE_CHECKING:
    from missions.planning.sweep.paths import Flyer
    from missions.planning.sweep.tours import Tour, Waypoints

EVERY_S: Final = 4.0
"""Between two decisions on who is to map what."""
KEEP_S: Final = 8.0
"""A share-out is gone on with unless another takes less time by so much: who changes its part flies
there, and knows later what the other has seen."""
KNOWN_S: Final = 30.0
"""So long what one has told holds, while it is heard and tells nothing new."""
SLOW_TIMES: Final = 1.3
"""So many times as long as it should take it who is out of contact is left what it was to do..."""
SPARE_S: Final = 30.0
"""... and so much longer."""
AHEAD_S: Final = 5.0
"""So far ahead it is seen which way a path leads."""

Bits = NDArray[np.bool_]
Parts = tuple[tuple[int, tuple[GridPoint, ...]], ...]


def share_parts(mine: int, setting: Setting, state: State, work: OpenWork) -> State:
    """The state with what is left to map laid out anew, if that is ours to do, and is due."""
    last, flyers = state.allotment, work.flyers
    if mine != min(flyers):
        return state
    before = {} if last is None else last.parts
    ours = last is not None and last.by == mine and flyers.keys() <= before.keys()
    if ours and last is not None and state.t_s < last.made_s + EVERY_S:
        return state
    begin_s = round(state.t_s + 1.0, 3)
    everyone = at_once(flyers) | _later(setting, state, frozenset(flyers), begin_s)
    held = {n: part for n, part in before.items() if n not in everyone and _maps(state, n)}
    chart = work.known.chart
    open_ = chart.closed.copy()
    if held:
        chart.closed[_of(setting, chart, before, state, frozenset(held))] = 1
    cuts = {number: _tour(places) for number, places in before.items()}
    tours = tours_of(
        setting, work.known, everyone, begin_s, work.decision, cuts, least=1, keep_s=KEEP_S
    )
    chart.closed[:] = open_
    if tours is None:
        return state
    laid = {
        number: tuple(GridPoint(x, y) for x, y, _ in tour)
        for number, tour in zip(everyone, tours.waypoints, strict=True)
    }
    return replace(state, allotment=Allotment(mine, state.t_s, {**held, **laid}))


def own_part(
    mine: int, setting: Setting, state: State, chart: Chart, memory: TourMemory
) -> tuple[Bits | None, TourMemory, Waypoints]:
    """Close what others are to map in a chart, for as long as ours keeps to its part.

    Returns:
        The cells that were closed, None where there is no part to keep to; what is to be remembered
        of it; and what a plan for ours may begin with, none where the last one goes on.
    """
    found = state.allotment
    if found is None or mine not in found.parts:
        return None, memory, ()
    if state.t_s >= found.made_s + KNOWN_S:
        return None, memory, ()
    others = frozenset(n for n in found.parts if n != mine and _maps(state, n))
    theirs = _of(setting, chart, found.parts, state, others) & (chart.closed == 0)
    chart.closed[theirs] = 1
    tour = _tour(found.parts[mine])
    fresh = bool(tour) and found.made_s > memory.laid_s
    return theirs, replace(memory, laid_s=found.made_s), (tour,) if fresh else ()


def _tour(places: Sequence[GridPoint]) -> Tour:
    """Places to see something from as the planner of tours has them."""
    from missions.planning.sweep.tours import CUT_M  # noqa: PLC0415 - numba takes a second to load

    return tuple((place.east_m, place.north_m, CUT_M) for place in places)


def mark_unreported(mine: int, setting: Setting, state: State, known: Known) -> bool:
    """Have seen from the places told to ours what there is undecided; whether there is any.

    Votes that decide nothing are not told: whoever has laid out the parts may miss what ours takes
    for seen, and nobody else will look.
    """
    found, wanted = state.allotment, known.wanted
    if found is None or wanted is None:
        return False
    chart, any_ = known.chart, False
    low = setting.heights.as_mapping(setting, state.vehicles[mine])
    seen = kinematics(setting, low)
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


def held_until_s(setting: Setting, state: State, vehicle: VehicleState, t_s: float) -> float:
    """Until when one that has just gone out of contact should have done what it was to do."""
    left_s, place = _lanes_left(setting, vehicle)
    found = state.allotment
    places = () if found is None else found.parts.get(vehicle.vehicle, ())
    if not places and not vehicle.lanes:
        return t_s
    way_m = sum(a.distance_to(b) for a, b in pairwise((place, *places, vehicle.pad)))
    low = setting.heights.as_mapping(setting, vehicle)
    map_s = way_m / setting.path_speed_m_s(low.cruise_height_m, 0.0)
    return t_s + SPARE_S + SLOW_TIMES * (left_s + map_s)


def back_from_lanes_s(setting: Setting, vehicle: VehicleState, t_s: float) -> float:
    """When one that has just gone out of contact should be back over its pad, its lanes flown."""
    left_s, place = _lanes_left(setting, vehicle)
    speed_m_s = setting.path_speed_m_s(setting.heights.layer_m(setting, vehicle), 0.0)
    return t_s + left_s + place.distance_to(vehicle.pad) / speed_m_s


def _maps(state: State, number: int) -> bool:
    """Whether a vehicle maps what is its own, or will when its lanes are flown."""
    vehicle = state.vehicles[number]
    if vehicle.phase is Phase.APART:
        return state.t_s < vehicle.held_until_s
    return vehicle.works


def _of(
    setting: Setting,
    chart: Chart,
    parts: Mapping[int, tuple[GridPoint, ...]],
    state: State,
    whose: frozenset[int],
) -> Bits:
    """Which cells have the place of one of those given as the nearest, of all who map."""
    mapping = tuple((n, places) for n, places in sorted(parts.items()) if _maps(state, n))
    half_east_m, half_north_m = setting.seen_whole_m(setting.mission.altitude_m(0))
    high = max(half_north_m, 0.1) / max(half_east_m, 0.1)
    nearest = _nearest(mapping, chart.grid, high)
    return np.isin(nearest, sorted(whose))


@lru_cache(maxsize=16)
def _nearest(mapping: Parts, grid: tuple[int, int, int, int, float], high: float) -> Ints:
    """By cell of a window of the grid whose place is the nearest, 0 where there is none.

    Distances are as a picture is, which is `high` times as high as it is wide.
    """
    west, south, columns, rows, cell_m = grid
    who = np.zeros(columns * rows, np.int64)
    least = np.full((rows, columns), np.inf)
    east = (np.arange(columns) + west) * cell_m
    north = (np.arange(rows) + south) * cell_m
    whose = who.reshape(rows, columns)
    for number, places in mapping:
        for place in places:
            away = np.maximum(
                np.abs(east - place.east_m)[None, :], np.abs(north - place.north_m)[:, None] / high
            )
            nearer = away < least
            least[nearer] = away[nearer]
            whose[nearer] = number
    return who


def _later(
    setting: Setting, state: State, team: frozenset[int], begin_s: float
) -> dict[int, tuple[Flyer, float]]:
    """Those who will map once their lanes are flown: where that will be, and when, from now."""
    found = {}
    for number, vehicle in sorted(state.vehicles.items()):
        if number in team or not vehicle.works:
            continue
        left_s, place = _lanes_left(setting, vehicle)
        low = replace(setting.heights.as_mapping(setting, vehicle), order=None)
        flyer = flyer_of(setting, low, None, None, begin_s)
        found[number] = replace(flyer, place=place), left_s
    return found


def _lanes_left(setting: Setting, vehicle: VehicleState) -> tuple[float, GridPoint]:
    """How long a vehicle will still fly lanes and change its layer, and where it will be then."""
    high = replace(vehicle, cruise_altitude_m=setting.heights.layer_m(setting, vehicle))
    speed_m_s = setting.path_speed_m_s(high.cruise_height_m, 0.0)
    now_s = vehicle.tracked_s
    at, way_m = setting.grid.to_moving(vehicle.position, now_s), 0.0
    for k, lane in enumerate(vehicle.lanes):
        if k == 0 and vehicle.path is not None:
            ends: tuple[Lane, ...] = (_ahead(at, vehicle.path, lane),)
        else:
            ends = (lane, (lane[1], lane[0]))
        start, end = min(ends, key=lambda way: at.distance_to(way[0]))
        way_m += at.distance_to(start) + start.distance_to(end)
        at = end
    down_m = max(vehicle.level_m - setting.mission.altitude_m(vehicle.vehicle - 1), 0.0)
    return way_m / speed_m_s + down_m / setting.energy.climb_m_s, at


def _ahead(at: GridPoint, path: Trajectory, lane: Lane) -> Lane:
    """What is left of the lane that is flown, towards where the path leads."""
    begin, ahead = path.place_at(path.begin_s), path.place_at(path.begin_s + AHEAD_S)
    east_m, north_m = ahead.east_m - begin.east_m, ahead.north_m - begin.north_m
    along = [
        east_m * (end.east_m - at.east_m) + north_m * (end.north_m - at.north_m) for end in lane
    ]
    return (at, lane[0] if along[0] > along[1] else lane[1])
