"""Whether the ground of a mission can be followed, and what its crew should know of it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import shapely

from missions.errors import MissionFileError
from missions.geo.grid import Grid
from missions.geo.terrain import FOLLOW_M, Relief
from missions.mission.height_and_speed import LEAST_HEIGHT_M
from missions.mission.places import drawn
from missions.mission.schema import Mission
from missions.planning.sweep.strategies import ON_PATHS

STEEPEST: Final = 0.6
"""Steeper ground is not followed: targets on it would lie less than two metres apart."""
WORTH_TELLING: Final = 0.1
"""Cells that would be off by so much of their edge, were the ground taken as flat."""


def faults(mission: Mission, grid: Grid) -> Iterator[str]:
    """Why a mission cannot be flown over its ground."""
    follows, relief = mission.flight.height_above == "ground", mission.relief
    if follows and mission.terrain is None:
        yield (
            'flight.height_above = "ground": nothing says how high the ground is; add [terrain] '
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
    """Raise `MissionFileError` for a mission above ground that nobody has asked for yet."""
    if mission.flight.height_above == "ground" and mission.ground is None:
        raise MissionFileError(
            f'{source}: terrain.source = "autopilot": only `uavmap fly` asks an ArduPilot for the '
            'ground; here give terrain.dem = "FILE.tif"'
        )


def _beyond(mission: Mission, grid: Grid) -> Iterator[str]:
    """Heights that were kept for another fence: beyond them nobody knows the ground."""
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
    """Level flight from home that would come too near to higher ground."""
    layer_m = mission.altitude_m(0)
    if relief.highest_m > layer_m - LEAST_HEIGHT_M:
        yield (
            f"flight.altitude_m = {layer_m:g}: by terrain.dem the ground in the fence rises to "
            f"{relief.highest_m:.1f} m above the start, where {LEAST_HEIGHT_M:g} m of room are "
            'needed; set flight.height_above = "ground", or fly higher'
        )


def _layers_apart(mission: Mission, relief: Relief) -> Iterator[str]:
    """On a slope layers are nearer to each other, and on legs a vehicle may be above its layer."""
    team = mission.team
    if len(mission.vehicles) < 2:
        return
    lean = math.cos(math.atan(relief.steepest))
    needed_m = (team.separation_m + FOLLOW_M) / lean
    if team.layer_m < needed_m:
        yield (
            f"team.layer_m = {team.layer_m:g}: above a slope of {relief.steepest:.0%} layers must "
            f"lie {needed_m:.1f} m apart for team.separation_m = {team.separation_m:g}: there they "
            f"are nearer to each other, and on legs vehicles fly up to {FOLLOW_M:g} m higher; "
            f"raise it to {math.ceil(needed_m * 10.0) / 10.0:g}"
        )


def off_if_flat_m(mission: Mission, relief: Relief) -> float:
    """The error of cells at the edge of what frames judge, were the ground taken as flat.

    A point at the distance d is taken for one at d times height above ground over height above
    home.
    """
    layer_m, cell_m = mission.altitude_m(0), mission.grid.cell_m
    footprint = mission.camera.optics.footprint(layer_m)
    half_m = math.hypot(*footprint) / 2.0
    cross = mission.detector.view == "cross" and mission.strategy not in ON_PATHS
    reach_m = min(half_m, 1.5 * cell_m * math.sqrt(2.0)) if cross else half_m
    worst_m = max(abs(relief.highest_m), abs(relief.lowest_m))
    return reach_m * worst_m / layer_m


def warnings(mission: Mission) -> Iterator[str]:
    """Warn of ground that is taken as flat."""
    relief = mission.relief
    if relief is None or mission.flight.height_above == "ground":
        return
    off_m = off_if_flat_m(mission, relief)
    if off_m > WORTH_TELLING * mission.grid.cell_m:
        yield (
            f'flight.height_above = "home": the ground in the fence lies {relief.lowest_m:+.1f} to '
            f"{relief.highest_m:+.1f} m from the start, with slopes up to {relief.steepest:.0%}; "
            f"taken as flat, cells are off by up to {off_m:.1f} m, and pictures are finer or "
            'coarser; set it to "ground"'
        )
