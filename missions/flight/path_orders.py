"""Giving a path that is flown without stopping, and taking it back: where it may lead, and when.

A path is given only if the fence allows all of it, and the air of its next
`missions.flight.airspace.needs.AHEAD_S` seconds is clear. That is checked again at every report,
and a vehicle brakes along its path before it meets air that another has reserved (`keep_clear`).
At every report `missions.flight.return_home` checks whether the energy lasts.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import LineString, Point
from shapely.ops import nearest_points

from missions.flight.airspace.airspace import Airspace
from missions.flight.setting import Setting
from missions.flight.state import Phase, State, VehicleState
from missions.geo.braking import braked, cut_short
from missions.geo.fence import Fence
from missions.geo.trajectory import LANE_CUTS_M, Trajectory, rounded_path
from missions.mission.views import path_speed_m_s
from missions.orders import FlyPath
from missions.units import GridPoint

NOTICE_S: Final = 1.0
"""A plan begins so long after it is made: what is streamed is up to 0.75 s ahead of its time."""
CORNER_CUT_M: Final = 0.005
"""Corners of the fence are not cut: a vehicle nearly stops there."""
ROUNDING_M: Final = 0.02
"""A path along the rim of the margin may miss it by so much."""
OUTSIDE_M: Final = 1.0
"""A path may begin so far outside of the margin, where a gust has blown the vehicle."""
INSIDE_S: Final = 4.0
"""... if it leads inside within this time, and on the way no farther out."""
DEPTH_M: Final = 1.5
"""Who is farther outside flies so far inside first."""
BEFORE_S: Final = (4.0, 6.0, 9.0, 13.0)
"""So long before a path would lead where the fence does not allow it, it is braked."""
WORTH_S: Final = 5.0
"""A path that has to be braked sooner is not begun."""
_STEP_S: Final = 0.25


def give_path(
    setting: Setting,
    state: State,
    vehicle: VehicleState,
    path: Trajectory,
    *,
    partly: bool = False,
) -> State:
    """Give a path if the fence allows it and its air is free; else what was flown is flown on.

    With `partly` one is flown as far as the fence allows it.
    """
    mission = setting.mission
    fits = allowed(setting.fence, path)
    if not fits and partly and (short := as_far_as_allowed(setting, path)) is not None:
        path, fits = short, True
    order = FlyPath(path, vehicle.cruise_height_m, setting.yaw_deg, mission.camera.interval_s)
    begins = vehicle if vehicle.path is not None else replace(vehicle, judged_s=path.begin_s)
    if fits and (given := Airspace(setting, state).reserve(begins, order)) is not None:
        return given
    return state.holding(vehicle) if vehicle.path is None else state


def as_far_as_allowed(setting: Setting, path: Trajectory) -> Trajectory | None:
    """A path that is not allowed as a whole, braked before it would lead where it is not.

    Plans are made anew every other second, so what matters is where a path leads next. Its last
    part is the way home as the planner sees it, past whatever stands around the pads: that is no
    reason not to fly the first part. None where that is not worth to be begun.
    """
    fence = setting.fence
    places = _places(path)
    inside = _inside(fence, places)
    first = int(inside.argmax())
    if not inside[first] or inside[first:].all():
        return None
    step_s = (path.end_s - path.begin_s) / (len(places) - 1)
    leaves_s = path.begin_s + step_s * (first + int((~inside[first:]).argmax()))
    for before_s in BEFORE_S:
        if leaves_s - before_s < path.begin_s + WORTH_S:
            break
        short = cut_short(path, leaves_s - before_s, setting.energy.accel_m_s2)
        if allowed(fence, short):
            return short
    return None


def through(
    setting: Setting,
    vehicle: VehicleState,
    points: list[GridPoint],
    corners: list[bool],
    begin_s: float,
    *,
    drifts: bool = False,
    cuts_m: Sequence[float] = LANE_CUTS_M,
) -> Trajectory:
    """A path from rest through some points, cut as far as the fence allows.

    `corners` says of each point whether it is a corner of the fence, which is not cut. What
    `drifts` is told in the frame of the region, else in the fixed one.
    """
    speed = path_speed_m_s(setting.mission, vehicle.cruise_height_m, vehicle.wind_m_s)
    drift_m_s = (0.0, 0.0)
    here = vehicle.position
    if drifts:
        grid = setting.grid
        drift_m_s = grid.drift_east_m_s, grid.drift_north_m_s
        here = grid.to_moving(here, begin_s)
    places = [here, *points]
    path = None
    for cut_m in (*cuts_m, CORNER_CUT_M):
        cuts = [CORNER_CUT_M, *(CORNER_CUT_M if corner else cut_m for corner in corners)]
        path = rounded_path(
            places,
            round(begin_s, 3),
            speed_m_s=speed,
            cut_m=cuts,
            accel_m_s2=setting.energy.accel_m_s2,
            drift_m_s=drift_m_s,
        )
        if allowed(setting.fence, path):
            break
    assert path is not None
    return path


def along_route(
    setting: Setting, vehicle: VehicleState, route: Sequence[GridPoint], begin_s: float
) -> Trajectory:
    """A path from rest along a way inside the fence, round the corners of which it leads."""
    corners = [True] * (len(route) - 1) + [False]
    return through(setting, vehicle, list(route), corners, begin_s)


def fly_route(
    setting: Setting, state: State, vehicle: VehicleState, route: Sequence[GridPoint]
) -> State:
    """Give an idle vehicle a path along a way inside the fence."""
    path = along_route(setting, vehicle, route, state.t_s + NOTICE_S)
    return give_path(setting, state, vehicle, path)


def allowed(fence: Fence, path: Trajectory) -> bool:
    """Whether the margin of the fence holds all of a path, at the time when it is flown.

    A vehicle may begin a little outside of it if it goes inside from there, and no farther out.
    """
    places = _places(path)
    inside = _inside(fence, places)
    if not inside.any():
        return False
    first = int(inside.argmax())
    if first and not _comes_in(fence, places[: first + 1]):
        return False
    if not bool(inside[first:].all()):
        return False
    if first + 1 == len(places):
        return True
    line = LineString(places[first:])
    return bool(shapely.covers(fence.shrunk(-ROUNDING_M), line))


def _places(path: Trajectory) -> list[GridPoint]:
    steps = max(1, round((path.end_s - path.begin_s) / _STEP_S))
    step_s = (path.end_s - path.begin_s) / steps
    return [path.place_at(path.begin_s + k * step_s) for k in range(steps + 1)]


def _inside(fence: Fence, places: list[GridPoint]) -> NDArray[np.bool_]:
    rim = fence.shrunk(-ROUNDING_M)
    return np.asarray(shapely.intersects_xy(rim, np.array(places)), dtype=np.bool_)


def _comes_in(fence: Fence, places: list[GridPoint]) -> bool:
    """Whether a path that begins outside of the margin goes straight in, inside of the fence."""
    if len(places) * _STEP_S > INSIDE_S or not all(map(fence.contains, places)):
        return False
    out_m = [float(fence.inner.distance(Point(place))) for place in places]
    return out_m[0] <= OUTSIDE_M and all(
        after <= before + ROUNDING_M for before, after in itertools.pairwise(out_m)
    )


def is_outside(fence: Fence, place: GridPoint) -> bool:
    """Whether a place is too far outside of the margin for a path to begin there."""
    return not fence.inner.dwithin(Point(place), OUTSIDE_M)


def come_inside(setting: Setting, state: State, vehicle: VehicleState) -> State | None:
    """Order a waiting vehicle back inside the margin; None where it is inside, or nearly so."""
    fence = setting.fence
    if not is_outside(fence, vehicle.position):
        return None
    deep = fence.shrunk(DEPTH_M)
    inside = fence.inner if shapely.is_empty(deep) else deep
    near = nearest_points(inside, Point(vehicle.position))[0]
    route = fence.route(vehicle.position, GridPoint(float(near.x), float(near.y)))
    if route is None:
        return None
    return Airspace(setting, state).reserve_or_wait(vehicle, vehicle.leg(route))


def keep_clear(setting: Setting, state: State) -> State:
    """Let those brake along their paths whose next seconds lead into air that others reserve."""
    for number in state.our_numbers:
        vehicle = state.vehicles[number]
        order = vehicle.order
        if vehicle.phase is not Phase.AIRBORNE or not isinstance(order, FlyPath):
            continue
        if order.trajectory.end_s <= state.t_s + NOTICE_S:
            continue
        if not Airspace(setting, state).is_clear(vehicle, order):
            state = brake(setting, state, vehicle, order)
    return state


def brake(setting: Setting, state: State, vehicle: VehicleState, order: FlyPath) -> State:
    """Let a vehicle come to rest along its path, unless it does so anyway."""
    path = order.trajectory
    stop = braked(path, max(path.begin_s, state.t_s + NOTICE_S), setting.energy.accel_m_s2)
    if stop.end_s >= path.end_s - 0.5:
        return state
    return state.with_vehicle(replace(vehicle, order=replace(order, trajectory=stop)))
