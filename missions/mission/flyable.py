"""Checks whether a mission can be flown: wind, camera, battery, and ground to search.

`values` and `search` yield faults that refuse the mission; `warnings` are for its crew.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import shapely
from shapely.geometry import LineString, Point
from shapely.geometry.base import BaseGeometry
from shapely.ops import nearest_points, unary_union

from missions.geo.fence import Fence, route_length_m
from missions.geo.grid import Grid
from missions.mission.energy import CLIMB_SPEED_M_S, MIN_HEADWAY_M_S, energy_model
from missions.mission.height_and_speed import (
    altitude_reason,
    footprint_over,
    home_height_faults,
    layer_faults,
    picture_warnings,
    search_layer_faults,
    terrain_warnings,
)
from missions.mission.places import drawn, far_homes, holes_named, homes
from missions.mission.schema import Mission, positions
from missions.mission.sections import AUTO
from missions.mission.views import G_M_S2
from missions.planning.search.lanes import LANE_CELLS, Lane, lanes
from missions.units import GridPoint

SEEN_SHARE = 0.9
"""Minimum part of a cell that a frame must show to judge it."""
POSITION_ERROR_M = 0.8
"""Distance of an observation from the middle of its cell: 0.7 m at arrival, plus drift, m."""
SETTLING_S = 2.0
"""Time of an observation besides its frames, s."""

# drag of a small multicopter, by its mass: it leans 4 degrees at 3.6 m/s and 26 at 12 m/s
_DRAG_LINEAR_1_S = 0.10
_DRAG_QUADRATIC_1_M = 0.025
_SMALLEST_LOSS_M2 = 1.0
_TOUCH_M = 0.01


# --- values ----------------------------------------------------------------------------------
def values(mission: Mission) -> Iterator[str]:
    """Yield faults of wind, height and camera."""
    too_strong = [*_wind(mission), *layer_faults(mission), *search_layer_faults(mission)]
    too_strong += home_height_faults(mission)
    yield from too_strong or _camera(mission)


def _wind(mission: Mission) -> Iterator[str]:
    wind_m_s, limit_m_s = mission.wind.speed_m_s, mission.flight.max_airspeed_m_s
    if limit_m_s - wind_m_s < MIN_HEADWAY_M_S:
        yield (
            f"wind.speed_m_s = {wind_m_s:g}: against it an airframe that holds "
            f"flight.max_airspeed_m_s = {limit_m_s:g} does not come home; fly in less than "
            f"{max(limit_m_s - MIN_HEADWAY_M_S, 0.0):g} m/s of wind, or raise "
            "flight.max_airspeed_m_s if the airframe holds more"
        )


def lean_rad(mission: Mission) -> float:
    """Return the lean of the camera while the vehicle hovers in the wind of the mission, rad.

    It leans more only while it brakes, for a second or two. An observation takes frames until all
    cells have votes.
    """
    if mission.camera.mounting == "gimbal":
        return 0.0
    wind_m_s = mission.wind.speed_m_s
    drag_m_s2 = (_DRAG_LINEAR_1_S + _DRAG_QUADRATIC_1_M * wind_m_s) * wind_m_s
    return math.atan(drag_m_s2 / G_M_S2)


def _camera(mission: Mission) -> Iterator[str]:
    """Yield a fault if a frame shows too little of a cell and its neighbours to vote on them.

    The nearest edge of the picture decides. Yaw costs nothing more: a turned picture first lacks
    corners of a neighbour, which are not needed.
    """
    camera, cell_m = mission.camera, mission.grid.cell_m
    height_m = mission.altitude_m(0)
    across_m, along_m = footprint_over(mission, height_m)
    half_rad, lean = math.atan(min(across_m, along_m) / 2 / height_m), lean_rad(mission)
    reach_m = height_m * math.tan(max(half_rad - lean, 0.0)) - POSITION_ERROR_M
    need_m = (0.5 + SEEN_SHARE) * cell_m
    if reach_m >= need_m:
        yield from _pose_error(mission, min(across_m, along_m))
        return
    remedies = []
    if half_rad > lean:
        enough_m = (need_m + POSITION_ERROR_M) / math.tan(half_rad - lean)
        remedies.append(_higher(mission, enough_m))
    wider_rad = math.atan((need_m + POSITION_ERROR_M) / height_m) + lean
    rise = 0.0 if mission.ground is None or mission.relief is None else mission.relief.steepest
    seen_uphill = 1.0 - rise * math.tan(wider_rad)  # the inverse of the reduction by a slope
    if wider_rad < math.radians(85) and seen_uphill > 0.0:
        level_m = camera.optics.footprint(height_m)
        ratio = level_m.across_m / level_m.short_m
        hfov_deg = math.degrees(2 * math.atan(math.tan(wider_rad) / seen_uphill * ratio))
        if hfov_deg < 170:
            remedies.append(f"use a camera of hfov_deg {_up(hfov_deg)}")
    if (smaller_m := math.floor(reach_m / (0.5 + SEEN_SHARE) * 10 + 1e-9) / 10) > 0:
        remedies.append(f"shrink grid.cell_m to {smaller_m:g}")
    slope = ""
    if mission.ground is not None and mission.relief is not None:
        slope = f" uphill on {mission.relief.steepest:.0%}"
    leaning = f"leaning {math.degrees(lean):.1f} degrees into the wind and " if lean > 0 else ""
    yield (
        f"camera.hfov_deg = {camera.hfov_deg:g}: from {height_m:g} m a frame shows "
        f"{across_m:.1f} m x {along_m:.1f} m{slope}; {leaning}{POSITION_ERROR_M:g} m off its place "
        f"it reaches {max(reach_m, 0.0):.1f} m to its nearest edge, but to judge 3 x 3 cells of "
        f"{cell_m:g} m it needs {need_m:.1f} m; {', or '.join(remedies)}"
    )


def _pose_error(mission: Mission, short_m: float) -> Iterator[str]:
    error_m, cell_m = mission.camera.pose_error_m, mission.grid.cell_m
    if short_m - 2 * error_m < cell_m:
        yield (
            f"camera.pose_error_m = {error_m:g}: from {mission.altitude_m(0):g} m a frame shows "
            f"{short_m:.1f} m, which less such an error at either edge holds no cell of "
            f"{cell_m:g} m; lower it, or fly higher"
        )


def _higher(mission: Mission, lowest_m: float) -> str:
    if mission.flight.altitude_m != AUTO:
        return f"raise flight.altitude_m to {_up(lowest_m)}"
    top_m = lowest_m + mission.altitude_m(len(mission.vehicles) - 1) - mission.altitude_m(0)
    if altitude_reason(mission) == "fence.ceiling_m":
        return f"raise fence.ceiling_m to {_up(top_m + mission.highest_ground_m)}"
    pixels = mission.camera.optics.pixels_per_cell(top_m + 0.1, mission.grid.cell_m)
    return f"lower camera.pixels_per_cell to {math.floor(pixels)}"


def _up(value: float) -> str:
    return f"{math.ceil(value * 10 - 1e-9) / 10:g}"


# --- the search ------------------------------------------------------------------------------
@dataclass(frozen=True, slots=True)
class SearchArea:
    """The lanes that can be reached inside the fence, and the rest of the box."""

    lanes: tuple[Lane, ...]
    box_m2: float
    cut_off_m2: float


def search_area(mission: Mission, grid: Grid) -> SearchArea:
    """Return the part of the box that can be searched."""
    cell_m = mission.grid.cell_m
    box = drawn(mission.search.box, grid)
    corners = [grid.fixed(place) for place in positions(mission.search.box)]
    fence = fence_of(mission, grid)
    pads = [Point(grid.fixed(place)) for place in homes(mission)]
    parts = shapely.get_parts(fence.inner)
    # a part of the fence is connected: a route leads from anywhere in it to everywhere in it
    near = [part for part in parts if any(part.dwithin(pad, _TOUCH_M) for pad in pads)]
    flown = tuple(
        lane
        for lane in lanes(corners, cell_m, fence)
        if any(part.dwithin(LineString(lane), _TOUCH_M) for part in near)
    )
    around = box.envelope.buffer(1000.0, join_style="mitre")
    no_fence = Fence.from_rings([GridPoint(*xy) for xy in around.exterior.coords[:-1]], [], 0.0)
    free = lanes(corners, cell_m, no_fence)
    lost = _judged(free, cell_m).intersection(box).difference(_judged(flown, cell_m))
    return SearchArea(flown, box.area, lost.area)


def fence_of(mission: Mission, grid: Grid) -> Fence:
    """Return the fence of a mission, in ground metres."""
    return Fence.from_rings(
        [grid.fixed(place) for place in positions(mission.fence.polygon)],
        [[grid.fixed(place) for place in positions(hole)] for hole in mission.fence.holes],
        mission.fence.margin_m,
    )


def _judged(flown: tuple[Lane, ...], cell_m: float) -> BaseGeometry:
    """Return the ground that frames along lanes judge: the cell below and its neighbours."""
    reach_m = LANE_CELLS / 2 * cell_m
    return unary_union([LineString(lane).buffer(reach_m, cap_style="square") for lane in flown])


def search(mission: Mission, grid: Grid) -> Iterator[str]:
    """Yield the faults of a search without any lane that can be flown."""
    if not search_area(mission, grid).lanes:
        yield (
            f"search.box: fence.margin_m ({mission.fence.margin_m:g}) and {holes_named(mission)} "
            "leave no "
            "part of it that a vehicle can fly over; move the box, widen the fence or lower the "
            "margin"
        )
    if not list(_wind(mission)) and not list(layer_faults(mission)):
        yield from _battery(mission, grid)


def _battery(mission: Mission, grid: Grid) -> Iterator[str]:
    battery, energy = mission.battery, energy_model(mission)
    box = drawn(mission.search.box, grid)
    worst_wh, worst = 0.0, ""
    for i, place in enumerate(homes(mission)):
        home = grid.fixed(place)
        near_m, layer_m = float(box.distance(Point(home))), mission.top_altitude_m(i)
        needed_wh = energy.sortie_wh(near_m, near_m, layer_m, look_s(mission)) - energy.reserve_wh
        nearest = GridPoint(*nearest_points(box, Point(home))[0].coords[0])
        needed_wh += energy.relief_wh(_ups_and_downs_m(mission, home, (nearest,)))
        if needed_wh > worst_wh:
            worst_wh = needed_wh
            worst = (
                f"vehicles[{i}] takes {needed_wh:.1f} Wh to climb to {layer_m:g} m, look at the "
                f"nearest point of search.box, {near_m:.0f} m away, come home and land"
            )
    usable_wh = battery.capacity_wh - energy.reserve_wh
    if worst_wh <= usable_wh:
        return
    remedies = f"raise battery.capacity_wh to {_up(worst_wh / (1.0 - battery.reserve))}"
    share = math.floor((1.0 - worst_wh / battery.capacity_wh) * 100 + 1e-9) / 100
    if share > 0:
        remedies += f" or lower battery.reserve to {share:g}"
    yield (
        f"battery.capacity_wh = {battery.capacity_wh:g}: without battery.reserve = "
        f"{battery.reserve:g} there are {usable_wh:.1f} Wh to fly with, but {worst}; {remedies}"
    )


def look_s(mission: Mission) -> float:
    """Return the time that a vehicle hovers over a cell, about, s."""
    return SETTLING_S + mission.votes.frames * mission.camera.interval_s


# --- what the crew should know ---------------------------------------------------------------
@dataclass(frozen=True, slots=True)
class FarthestCorner:
    """The corner of the box that costs a vehicle (from 0) most energy, and that energy."""

    vehicle: int
    away_m: float
    sortie_wh: float


def farthest_corner(mission: Mission, grid: Grid) -> FarthestCorner:
    """Return the costliest corner of the box for any vehicle."""
    energy, fence = energy_model(mission), fence_of(mission, grid)
    found = []
    for i, place in enumerate(homes(mission)):
        home = grid.fixed(place)
        for corner in positions(mission.search.box):
            point = grid.fixed(corner)
            route = fence.route(home, point) or (point,)
            away_m = route_length_m(home, route)
            cost_wh = energy.sortie_wh(away_m, away_m, mission.top_altitude_m(i), look_s(mission))
            cost_wh += energy.relief_wh(_ups_and_downs_m(mission, home, route))
            found.append(FarthestCorner(i, away_m, cost_wh))
    return max(found, key=lambda corner: corner.sortie_wh)


def _ups_and_downs_m(mission: Mission, home: GridPoint, route: tuple[GridPoint, ...]) -> float:
    """Return the ups and downs of a way, there and back, as metres of climbing."""
    if mission.ground is None:
        return 0.0
    way, speed_m_s = (home, *route), mission.flight.speed_m_s
    return 2.0 * mission.ground.ups_and_downs_m(way, speed_m_s, CLIMB_SPEED_M_S)


def warnings(mission: Mission, grid: Grid) -> list[str]:
    """Return properties of a checked mission that will show in its map."""
    found = list(far_homes(mission, grid))
    area = search_area(mission, grid)
    if area.cut_off_m2 >= _SMALLEST_LOSS_M2:
        found.append(
            f"search.box: {area.cut_off_m2:.0f} m2 of its {area.box_m2:.0f} m2 cannot be "
            f"searched: fence.margin_m ({mission.fence.margin_m:g}) or {holes_named(mission)} cut "
            "them off; "
            "widen the fence or lower the margin if they matter"
        )
    corner = farthest_corner(mission, grid)
    if corner.sortie_wh > mission.battery.capacity_wh:
        found.append(
            f"battery.capacity_wh = {mission.battery.capacity_wh:g}: the corner of search.box that "
            f"is farthest from vehicles[{corner.vehicle}], {corner.away_m:.0f} m, costs "
            f"{corner.sortie_wh:.1f} Wh with the reserve: it will not be reached"
        )
    found.extend(picture_warnings(mission))
    found.extend(terrain_warnings(mission))
    if mission.sim.sensor_noise == 0.0 and not mission.camera.noiseless:
        found.append(
            "sim.sensor_noise = 0: pictures that are uniform or repeat are taken for those of a "
            "dead camera; in a simulation set camera.noiseless = true"
        )
    return found
