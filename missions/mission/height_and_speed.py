"""Limits of height and speed of a vehicle whose pictures are to be evidence.

Height: the detector needs `camera.pixels_per_cell`, the law sets `fence.ceiling_m`; both hold for
the highest layer.

Speed: while the shutter is open the picture moves over the sensor (`camera.max_blur_px`). A cell
needs `votes.frames` frames, `camera.interval_s` apart, while it is wholly in the picture. A region
that drifts towards the vehicle lowers both limits.

Ground: whether it can be followed, and warnings for the crew.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import shapely

from missions.errors import MissionFileError
from missions.geo.footprint import Footprint
from missions.geo.grid import Grid
from missions.geo.terrain import FOLLOW_M, Relief
from missions.mission.places import drawn
from missions.mission.schema import Mission
from missions.mission.sections import AUTO
from missions.planning.sweep.strategies import LEAPFROG, ON_PATHS

MIN_HEIGHT_M = 3.0
"""Minimum height of a layer above the pad of its vehicle, m."""
CLIMB_M_S = 1.2
"""Rate uphill and downhill, m/s; by default an ArduCopter and a PX4 descend at 1.5 m/s."""


# --- height ----------------------------------------------------------------------------------
def altitude_reason(mission: Mission) -> str:
    """Return the key of the mission file that sets the height of the layers."""
    if mission.flight.altitude_m != AUTO:
        return "flight.altitude_m"
    fine_m = mission.camera.optics.height_m(mission.grid.cell_m, mission.camera.pixels_per_cell)
    room_m = mission.fence.ceiling_m - mission.highest_ground_m
    return "camera.pixels_per_cell" if fine_m <= room_m else "fence.ceiling_m"


def layer_faults(mission: Mission) -> Iterator[str]:
    """Yield faults of layers that are too high or too low, for any camera."""
    last = mission.layer_number(len(mission.vehicles) - 1)
    lowest_m, top_m = mission.altitude_m(0), mission.altitude_m(len(mission.vehicles) - 1)
    ceiling_m, team = mission.fence.ceiling_m, mission.team
    if mission.flight.altitude_m == AUTO:
        if lowest_m < MIN_HEIGHT_M:
            yield (
                f'flight.altitude_m = "auto": {altitude_reason(mission)} sets the highest layer to '
                f"{top_m:g} m{_over_hills(mission)}; {last} layers of team.layer_m = "
                f"{team.layer_m:g} below it the lowest is at {lowest_m:g} m, and "
                f"{MIN_HEIGHT_M:g} m are needed; fly fewer vehicles, or raise what sets it"
            )
    elif top_m > ceiling_m - mission.highest_ground_m:
        layers = f", {last} layers of {team.layer_m:g} m above it," if last else ""
        yield (
            f"flight.altitude_m = {lowest_m:g}: the highest layer{layers} is at {top_m:g} m"
            f"{_over_hills(mission)}, above fence.ceiling_m = {ceiling_m:g}; fly lower, or raise "
            "the ceiling if you may"
        )


def home_height_faults(mission: Mission) -> Iterator[str]:
    """Yield homes so high above the start that their layer is too near to them."""
    for i, vehicle in enumerate(mission.vehicles):
        layer_m, home_m = mission.altitude_m(i), vehicle.home_height_m
        if mission.ground is None and home_m and layer_m - home_m < MIN_HEIGHT_M:
            yield (
                f"vehicles[{i}].home_height_m = {home_m:g}: its layer, {layer_m:g} m above the "
                f"start, is less than {MIN_HEIGHT_M:g} m above its home; raise flight.altitude_m"
            )


def search_layer_faults(mission: Mission) -> Iterator[str]:
    """Yield layers of the search that are not above all those of the map, or too high."""
    lowest_m, last = mission.search_altitude_m(0), len(mission.vehicles) - 1
    if lowest_m is None:
        return
    given = mission.search.altitude_m
    named = "search.altitude_m = " + (f'"{AUTO}"' if given == AUTO else f"{given:g}")
    if mission.search.find != "all":
        yield f'{named}: is for search.find = "all"; set that, or leave this out'
        return
    if mission.flight.height_above == "ground":
        yield f'{named}: is above flat ground; leave it out, or set flight.height_above = "home"'
        return
    top_m, map_m = mission.search_altitude_m(last) or lowest_m, mission.altitude_m(last)
    if lowest_m < map_m + mission.team.layer_m - 1e-6:
        yield (
            f"{named}: the lowest layer of the search is at {lowest_m:g} m, and has to be "
            f"team.layer_m = {mission.team.layer_m:g} above the highest of the map, {map_m:g} m; "
            "search higher (search.altitude_m, or a lower search.pixels_per_cell), map lower, or "
            "leave it out"
        )
    if top_m > mission.fence.ceiling_m - mission.highest_ground_m:
        yield (
            f"{named}: the highest layer of the search is at {top_m:g} m{_over_hills(mission)}, "
            f"above fence.ceiling_m = {mission.fence.ceiling_m:g}; search lower, or raise the "
            "ceiling if you may"
        )


def _over_hills(mission: Mission) -> str:
    if mission.highest_ground_m <= 0.0:
        return ""
    return f" above ground that rises {mission.highest_ground_m:.1f} m above the start"


def footprint_over(mission: Mission, height_m: float) -> Footprint:
    """Return the certain footprint of a level picture from `height_m`: less uphill.

    It is reduced by the steepest slope in the fence.
    """
    across_m, along_m = mission.camera.optics.footprint(height_m)
    if mission.ground is None or mission.relief is None:
        return Footprint(across_m, along_m)
    rise = mission.relief.steepest / (2.0 * height_m)
    return Footprint(across_m / (1.0 + rise * across_m), along_m / (1.0 + rise * along_m))


# --- speed -----------------------------------------------------------------------------------
@dataclass(frozen=True, slots=True)
class SpeedLimits:
    """The limits of the speed over ground at one height, all in m/s and at least 0."""

    flight_m_s: float
    blur_m_s: float
    frames_m_s: float
    """Limit for a cell to be wholly in `votes.frames` frames, m/s."""
    headway_m_s: float
    climb_m_s: float = math.inf
    """Limit by the climb and descent rates over the steepest ground, m/s."""

    @property
    def least_m_s(self) -> float:
        """Lowest of the limits, m/s; 0 if no speed is low enough: the picture shows no cell
        whole."""
        return min(self._by_key.values())

    @property
    def reason(self) -> str:
        """Key of the mission file that sets the lowest limit."""
        return min(self._by_key, key=self._by_key.__getitem__)

    @property
    def _by_key(self) -> dict[str, float]:
        return {
            "flight.speed_m_s": self.flight_m_s,
            "flight.max_airspeed_m_s, less wind.speed_m_s": self.headway_m_s,
            "the steepest ground": self.climb_m_s,
            "camera.max_blur_px": self.blur_m_s,
            "votes.frames": self.frames_m_s,
        }


def speed_limits(mission: Mission, height_m: float) -> SpeedLimits:
    """Return the limits of a vehicle that takes pictures from `height_m` above the ground.

    Frames are counted along the shorter side of the picture. A distance of k intervals holds at
    least k of them, whenever the first is taken.
    """
    camera, drift_m_s = mission.camera, mission.drift.speed_m_s
    relief = None if mission.ground is None else mission.relief
    steepest = 0.0 if relief is None else relief.steepest
    blur_m = camera.max_blur_px * camera.optics.gsd_m(height_m)
    side_m = footprint_over(mission, height_m).short_m - 2.0 * camera.pose_error_m
    seen_s = mission.votes.frames * camera.interval_s
    return SpeedLimits(
        mission.flight.speed_m_s,
        max(blur_m / camera.exposure_s - drift_m_s, 0.0),
        max((side_m - mission.grid.cell_m) / seen_s - drift_m_s, 0.0),
        headway_m_s(mission, mission.wind.speed_m_s),
        CLIMB_M_S / steepest if steepest > 0.0 else math.inf,
    )


def headway_m_s(mission: Mission, wind_m_s: float) -> float:
    """Return the ground speed straight against a wind, at least 0, m/s."""
    return max(mission.flight.max_airspeed_m_s - wind_m_s, 0.0)


# --- both ------------------------------------------------------------------------------------
def picture_warnings(mission: Mission) -> Iterator[str]:
    """Warnings of pictures that will be coarse, or blurred in a search at full speed."""
    # of a leapfrog only the lower one maps
    mapping = 1 if mission.strategy == LEAPFROG.name else len(mission.vehicles)
    lowest_m, top_m = mission.altitude_m(0), mission.altitude_m(mapping - 1)
    camera, cell_m, speed_m_s = mission.camera, mission.grid.cell_m, mission.flight.speed_m_s
    pixels = camera.optics.pixels_per_cell(top_m, cell_m)
    if pixels < camera.pixels_per_cell:
        yield (
            f"camera.pixels_per_cell = {camera.pixels_per_cell:g}: from the highest layer, "
            f"{top_m:g} m, a cell of {cell_m:g} m has {pixels:.1f} pixels; fly lower, or lower "
            "this if the detector does with fewer"
        )
    blurred_px = speed_m_s * camera.exposure_s / camera.optics.gsd_m(lowest_m)
    if blurred_px > camera.max_blur_px:
        yield (
            f"flight.speed_m_s = {speed_m_s:g}: from {lowest_m:g} m a picture of "
            f"camera.exposure_s = {camera.exposure_s:g} is blurred by {blurred_px:.1f} px, more "
            f"than camera.max_blur_px = {camera.max_blur_px:g}; fly slower or expose for a shorter "
            "time"
        )


# --- ground that is not flat -----------------------------------------------------------------
STEEPEST: Final = 0.6
"""Maximum slope that is followed: on steeper ground targets would be less than 2 m apart."""
FLAT_GROUND_WARNING_SHARE: Final = 0.1
"""Error of cells by flat ground, as a share of their edge, from which on a warning is due."""


def terrain_faults(mission: Mission, grid: Grid) -> Iterator[str]:
    """Yield faults of a mission over its ground."""
    follows, relief = mission.flight.height_above == "ground", mission.relief
    if follows and mission.terrain is None:
        yield (
            'flight.height_above = "ground": the height of the ground is unknown; add [terrain] '
            'with dem = "FILE.tif", a GeoTIFF beside the mission file, or source = "autopilot"'
        )
    if relief is None:
        return
    yield from _beyond(mission, grid)
    if not follows:
        yield from _into_the_ground(mission, relief)
        return
    if relief.steepest > STEEPEST:
        place = grid.position(relief.steepest_at)
        yield (
            f"terrain.dem: the ground in the fence rises by {relief.steepest:.0%} near "
            f"{place.lat_deg:.6f}, {place.lon_deg:.6f}; up to {STEEPEST:.0%} is followed. Draw the "
            "fence around it, or take a terrain model (bare ground) if this is one of surfaces"
        )
    yield from _layers_apart(mission, relief)


def refuse_unknown_ground(mission: Mission, source: str) -> None:
    """Raise `MissionFileError` for a mission above ground that is not known yet."""
    if mission.flight.height_above == "ground" and mission.ground is None:
        raise MissionFileError(
            f'{source}: terrain.source = "autopilot": only `uavmap fly` asks an ArduPilot for the '
            'ground; here give terrain.dem = "FILE.tif"'
        )


def _beyond(mission: Mission, grid: Grid) -> Iterator[str]:
    """Yield the part of the fence beyond the known heights, which were kept for another fence."""
    known = mission.surveyed
    if known is None:
        return
    rows, columns = known.heights_m.shape
    east_m = known.west_m + known.step_m * (columns - 1)
    north_m = known.south_m + known.step_m * (rows - 1)
    fence = drawn(mission.fence.polygon, grid)
    beyond = fence.difference(shapely.box(known.west_m, known.south_m, east_m, north_m))
    if beyond.area > 1.0:
        yield (
            f"terrain.dem: its heights do not reach over {beyond.area:.0f} m2 of fence.polygon; "
            'name the GeoTIFF again (dem = "FILE.tif"), or draw the fence smaller'
        )


def _into_the_ground(mission: Mission, relief: Relief) -> Iterator[str]:
    layer_m = mission.altitude_m(0)
    if relief.highest_m > layer_m - MIN_HEIGHT_M:
        yield (
            f"flight.altitude_m = {layer_m:g}: by terrain.dem the ground in the fence rises to "
            f"{relief.highest_m:.1f} m above the start, where {MIN_HEIGHT_M:g} m of room are "
            'needed; set flight.height_above = "ground", or fly higher'
        )


def _layers_apart(mission: Mission, relief: Relief) -> Iterator[str]:
    """Yield a fault of layers over a slope: they are closer, and vehicles may be above their
    layer."""
    team = mission.team
    if len(mission.vehicles) < 2:
        return
    lean = math.cos(math.atan(relief.steepest))
    needed_m = (team.separation_m + FOLLOW_M) / lean
    if team.layer_m < needed_m:
        yield (
            f"team.layer_m = {team.layer_m:g}: above a slope of {relief.steepest:.0%} layers must "
            f"lie {needed_m:.1f} m apart for team.separation_m = {team.separation_m:g}; the slope "
            f"brings them nearer, and on legs vehicles fly up to {FOLLOW_M:g} m higher; "
            f"raise it to {math.ceil(needed_m * 10.0) / 10.0:g}"
        )


def off_if_flat_m(mission: Mission, relief: Relief) -> float:
    """Return the error of cells at the edge of a frame if the ground were taken as flat, m.

    A point at distance d appears at d times height above ground over height above home.
    """
    layer_m, cell_m = mission.altitude_m(0), mission.grid.cell_m
    footprint = mission.camera.optics.footprint(layer_m)
    half_m = math.hypot(*footprint) / 2.0
    cross = mission.detector.view == "cross" and mission.strategy not in ON_PATHS
    reach_m = min(half_m, 1.5 * cell_m * math.sqrt(2.0)) if cross else half_m
    worst_m = max(abs(relief.highest_m), abs(relief.lowest_m))
    return reach_m * worst_m / layer_m


def terrain_warnings(mission: Mission) -> Iterator[str]:
    """Warn of ground that is taken as flat."""
    relief = mission.relief
    if relief is None or mission.flight.height_above == "ground":
        return
    off_m = off_if_flat_m(mission, relief)
    if off_m > FLAT_GROUND_WARNING_SHARE * mission.grid.cell_m:
        yield (
            f'flight.height_above = "home": the ground in the fence lies {relief.lowest_m:+.1f} to '
            f"{relief.highest_m:+.1f} m from the start, with slopes up to {relief.steepest:.0%}; "
            f"taken as flat, cells are off by up to {off_m:.1f} m, and pictures are finer or "
            'coarser; set it to "ground"'
        )
