"""A flight over the mapped region, to photograph it again."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import shapely
from shapely.geometry import Point, Polygon

from missions.errors import OutputError
from missions.flight.state import Setting
from missions.mission.height_and_speed import footprint_over
from missions.mission.places import homes
from missions.mission.schema import Mission
from missions.mission.views import path_speed_m_s, rows_across
from missions.planning.search.lanes import Lane, along_east, lanes, tour_m
from missions.units import GridPoint
from uavmap.output.facts.flown_mission import DERIVED, FlownMission
from uavmap.output.facts.map_model import drift_m
from uavmap.output.formats.ground_station_plan import Pace, SearchFlight, flight_along

MARGIN_CELLS: Final = 1.0
"""Margin around the region for the error of the outline, in edges of a cell."""
_LOG: Final = logging.getLogger("uavmap.output")


def follow_up_flight(flown: FlownMission) -> SearchFlight:
    """Plan the flight of one vehicle over each part of the region, from its map height.

    It is the vehicle of these results; for a team, or recorded pictures, the first one. Lanes are
    as far apart as in a mission without a high search. Raises `OutputError`.
    """
    setting, mission = _alone(flown.setting), _from_map_height(flown.setting.mission)
    if mission.flight.height_above == "ground":
        raise OutputError(
            f'{flown.folder}: flight.height_above = "ground": the heights of a waypoint file are '
            "above home and do not follow the ground; fly the region again with `uavmap fly`"
        )
    parts = _parts(flown)
    if not parts:
        raise OutputError(
            f"{flown.folder}: has no region; export the results of a mission that has found one"
        )
    vehicle = (setting.member or 1) - 1
    height_m = mission.altitude_m(vehicle)
    speed_m_s = path_speed_m_s(mission, height_m)
    pace = Pace(height_m, speed_m_s, speed_m_s * mission.camera.interval_s)
    tour = _tour(setting, mission, parts, setting.grid.fixed(homes(mission)[vehicle]))
    flight = flight_along(setting, vehicle, tour, pace)
    if len(flight.left_out) == len(tour):
        raise OutputError(
            f"{flown.folder}: no lane over the region is inside the fence; nothing is written"
        )
    _report(flown, mission, flight, len(tour), pace)
    return flight


def _alone(setting: Setting) -> Setting:
    """Return the setting with the whole fence; that of a fleet's member lacks others' columns."""
    return replace(setting, fence=setting.whole_fence or setting.fence)


def _from_map_height(mission: Mission) -> Mission:
    """Return the mission without its high search."""
    search = mission.search.model_copy(update={"altitude_m": None})
    return mission.model_copy(update={"search": search})


def _parts(flown: FlownMission) -> list[Polygon]:
    """Return the parts of the region on the map, with the margin, without holes."""
    grid = flown.data.grid
    moved_m = drift_m(grid, flown.data.t_s)
    outline = shapely.transform(flown.extent.outline, lambda points: points + moved_m)
    around = outline.buffer(MARGIN_CELLS * grid.cell_m, join_style="mitre")
    return [Polygon(part.exterior) for part in shapely.get_parts(around) if not part.is_empty]


def _tour(
    setting: Setting, mission: Mission, parts: Sequence[Polygon], here: GridPoint
) -> list[Lane]:
    """Plan lanes over each part; the nearest part is flown next."""
    left, tour = list(parts), list[Lane]()
    while left:
        part = min(left, key=Point(here).distance)
        left.remove(part)
        ring = [GridPoint(float(x), float(y)) for x, y in part.exterior.coords[:-1]]
        ahead = along_east(ring)
        rows = rows_across(mission, setting.grid, east_ahead=ahead)
        block = tour_m(here, lanes(ring, setting.grid.cell_m, setting.fence, rows, ahead))[1]
        tour += block
        here = block[-1][1] if block else here
    return tour


def _report(
    flown: FlownMission, mission: Mission, flight: SearchFlight, number: int, pace: Pace
) -> None:
    grid, left_out = flown.data.grid, len(flight.left_out)
    footprint = footprint_over(mission, pace.height_m)
    apart_m = grid.cell_m * rows_across(mission, grid, east_ahead=True)
    pairs = (apart_m, footprint.across_m), (pace.every_m, footprint.along_m)
    across, along = (math.floor(100.0 * max(1.0 - m / side_m, 0.0)) for m, side_m in pairs)
    flown_lanes = "1 lane" if number - left_out == 1 else f"{number - left_out} lanes"
    _LOG.info(
        f"{flown_lanes} at {pace.height_m:g} m, at most {apart_m:g} m apart, a picture "
        f"each {pace.every_m:.1f} m; with the camera of the mission file, pictures overlap by at "
        f"least {across} % sideways and {along} % along a lane"
    )
    if left_out:
        _LOG.info(f"{left_out} lanes are left out: no path inside the fence leads to them")
    if flown.data.grid.drift_speed_m_s:
        _LOG.info("the region drifts: the lanes are over its place at the time of the map")
    if flown.plan.mission_source == DERIVED:
        _LOG.info(
            "start and fence are derived from the pictures; check that you may fly there, or "
            "replay the pictures with --mission"
        )
