"""Direct flights to the rest of the map, where the path planner finds no way.

The planner improves its plans by small changes, which seldom lead round a hole of the fence. So
when all vehicles wait and cells are still needed, one flies to the nearest observation point.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Final, NamedTuple

from missions.flight.path_orders import PLAN_LEAD_S, along_route
from missions.flight.state import Setting, State
from missions.flight.vehicle_state import VehicleState
from missions.geo.fence import route_length_m
from missions.geo.path_in_fence import allowed
from missions.geo.trajectory import Trajectory
from missions.planning.sweep.chart import KnownMap
from missions.planning.sweep.memo import valued
from missions.planning.sweep.paths import Tuning
from missions.units import Cell, GridPoint

MAX_ROUTES: Final = 12
"""Number of places, nearest first, that are tried for a route inside the fence."""


class Fetch(NamedTuple):
    """A direct flight to an observation point."""

    vehicle: int
    vantage: Cell
    path: Trajectory


def fetch(
    state: State, team: Mapping[int, VehicleState], known: KnownMap, tried: Collection[Cell]
) -> Fetch | None:
    """Return the shortest flight of a team to a needed cell, not to places that were tried."""
    needed, mission = _needed(state.setting, known), state.setting.mission
    found: list[tuple[float, int, Cell, tuple[GridPoint, ...]]] = []
    for number, vehicle in sorted(team.items()):
        places = _vantages(state, vehicle, known, needed, tried)
        for away_m, cell, place in places[:MAX_ROUTES]:
            if found and away_m >= found[0][0]:
                break
            route = state.setting.fence.route(vehicle.position, place)
            if route is not None:
                length_m = route_length_m(vehicle.position, route)
                found = sorted([*found, (length_m, number, cell, route)])
    for _, number, cell, route in found:
        path = along_route(state.setting, team[number], route, state.t_s + PLAN_LEAD_S)
        path = path.resting((mission.votes.frames + 1) * mission.camera.interval_s)
        if allowed(state.setting.fence, path):
            return Fetch(number, cell, path)
    return None


def _needed(setting: Setting, known: KnownMap) -> list[Cell]:
    """Return the undecided cells that have to be decided."""
    votes = setting.mission.votes
    worth, need, candidates, _ = valued(known, votes.frames, votes.positive)
    least_s = 0.5 * Tuning().penalty_s
    return [known.chart.cell(int(i)) for i in candidates if worth[i] * need[i] > least_s]


def _vantages(
    state: State,
    vehicle: VehicleState,
    known: KnownMap,
    needed: Collection[Cell],
    tried: Collection[Cell],
) -> list[tuple[float, Cell, GridPoint]]:
    """Return the observation points of needed cells: distance, cell below, place at arrival."""
    setting, grid, chart = state.setting, state.setting.grid, known.chart
    flown = setting.kinematics(vehicle.cruise_height_m, vehicle.wind_m_s)
    reach_e, reach_n = flown.reach(grid.cell_m)
    cells = {
        Cell(cell.east + i, cell.north + j)
        for cell in needed
        for i in range(-reach_e, reach_e + 1)
        for j in range(-reach_n, reach_n + 1)
    }
    places = []
    for cell in cells.difference(tried):
        if chart.holds(cell) and chart.allowed[chart.index(cell)]:
            now = grid.to_fixed(grid.centre_of(cell), state.t_s)
            by_s = state.t_s + PLAN_LEAD_S + vehicle.position.distance_to(now) / flown.speed_m_s
            place = grid.to_fixed(grid.centre_of(cell), by_s)
            places.append((vehicle.position.distance_to(place), cell, place))
    return sorted(places)
