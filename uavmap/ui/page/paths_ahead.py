"""The path ahead of each vehicle, for a page. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from shapely.geometry import LineString, Point

from missions.flight.state import Setting
from missions.flight.vehicle_state import Phase, VehicleState
from missions.geo.trajectory import Piece, Trajectory
from missions.orders import FlyPath, FlyTo, Order, ReturnToLaunch, Sweep
from missions.units import GridPoint

UNTIMED_S: Final = 1e9
"""Time of a point whose time of passage is unknown, s."""
MAX_POINTS: Final = 100
_CHORD_M: Final = 0.3
"""Maximum distance of an arc from its chords, m."""
_NEAR_M: Final = 4.0
"""Distance within which a vehicle is on a later leg of its route, m."""


class Ahead:
    """The paths ahead of the vehicles; a path changes only with its order."""

    def __init__(self, setting: Setting) -> None:
        self._setting = setting
        self._orders: dict[int, tuple[Order | None, int]] = {}

    def news(self, vehicle: VehicleState, t_s: float) -> list[float] | None:
        """Return the path of a vehicle at mission time `t_s`, if it has changed; else None.

        It is flat: mission time (s), east and north (m) of each point. It is empty for a vehicle
        without an order of ours.
        """
        order = vehicle.order if vehicle.phase is Phase.AIRBORNE and not vehicle.landed else None
        route = _route(vehicle, order, self._setting, t_s)
        begin = _begun(route, vehicle.position)
        before = self._orders.get(vehicle.vehicle)
        if before is not None and before[0] is order and before[1] == begin:
            return None
        self._orders[vehicle.vehicle] = (order, begin)
        if isinstance(order, FlyPath):
            return self._of_path(order.trajectory, t_s)
        flat = self._of_route(route[begin:], vehicle.position, t_s)
        if isinstance(order, FlyTo) and order.cell is not None:  # the cell drifts with the region
            flat[-2:] = self._setting.grid.centre_of(order.cell)
        return flat

    def _of_path(self, path: Trajectory, t_s: float) -> list[float]:
        times = [t for t in _times(path.pieces) if t > t_s]
        flat: list[float] = []
        for time_s in [*times, path.end_s][:MAX_POINTS]:
            place = self._setting.grid.to_moving(path.place_at(time_s), time_s)
            flat += (round(time_s, 1), round(place.east_m, 1), round(place.north_m, 1))
        return flat

    def _of_route(self, route: Sequence[GridPoint], here: GridPoint, t_s: float) -> list[float]:
        """Return the points in the moving frame at the times when the vehicle reaches them."""
        flat: list[float] = []
        for point in route[:MAX_POINTS]:
            t_s += here.distance_to(point) / self._setting.energy.speed_m_s
            here = point
            place = self._setting.grid.to_moving(point, t_s)
            flat += (UNTIMED_S, round(place.east_m, 1), round(place.north_m, 1))
        return flat


def _route(
    vehicle: VehicleState, order: Order | None, setting: Setting, t_s: float
) -> Sequence[GridPoint]:
    """Return the points of an order that is flown in legs, in the fixed frame."""
    if isinstance(order, Sweep):
        return (order.end,)
    if isinstance(order, ReturnToLaunch):
        return (vehicle.pad,)
    if not isinstance(order, FlyTo):
        return ()
    if order.cell is None:
        return order.route
    grid = setting.grid
    return (*order.route, grid.to_fixed(grid.centre_of(order.cell), t_s))


def _begun(route: Sequence[GridPoint], here: GridPoint) -> int:
    """Return the index of the next point: the end of the vehicle's present leg."""
    for end in range(len(route) - 1, 0, -1):
        if LineString(route[end - 1 : end + 1]).distance(Point(here)) < _NEAR_M:
            return end
    return 0


def _times(pieces: Sequence[Piece]) -> list[float]:
    """Return the times at which lines, arcs and their chords begin, s."""
    times = []
    for piece in pieces:
        bend = abs(piece.curvature_1_m)
        most_rad = 2.0 * math.acos(max(1.0 - _CHORD_M * bend, 0.0))
        chords = max(1, math.ceil(bend * piece.length_m / most_rad)) if bend else 1
        times += [piece.begin_s + piece.duration_s * k / chords for k in range(chords)]
    return times
