"""Requirements on a mission for a team: a service for each vehicle, or a leapfrog of two."""

from __future__ import annotations

import itertools
import math
from typing import Final

from missions.errors import MissionFileError
from missions.geo.columns import PAD_M, column_radius_m
from missions.mission.flyable import lean_rad
from missions.mission.height_and_speed import MIN_HEIGHT_M
from missions.mission.places import grid_of, homes
from missions.mission.schema import Mission, VehicleSection
from missions.mission.sections import AUTO
from missions.planning.leapfrog_geometry import TrackerView
from missions.units import GridPoint

SWAY_RAD: Final = math.radians(3.0)
"""Tilt of a hovering vehicle besides its lean into the wind, rad."""


def tracker_view(mission: Mission) -> TrackerView:
    """Return the tracker's view of the mapper. Raises `ValueError` if it cannot see it."""
    optics = mission.camera.optics
    half = math.tan(optics.hfov_rad / 2.0) * optics.height_px / optics.width_px
    return TrackerView(  # not by `optics.focal_px`, which rounds differently
        hfov_rad=optics.hfov_rad,
        vfov_rad=2.0 * math.atan(half),
        above_m=mission.altitude_m(1) - mission.altitude_m(0),
        separation_m=mission.team.separation_m,
        tag_m=mission.navigation.tag_m,
        tilt_rad=lean_rad(mission) + SWAY_RAD,
    )


STRATEGIES = ("swath", "survey")


def check_fleet(mission: Mission, source: str) -> None:
    """Raise `MissionFileError` for a mission that members with a service each cannot fly."""
    if mission.strategy not in STRATEGIES:
        raise MissionFileError(
            f"{source}: strategy = {mission.strategy!r} needs one service for all vehicles; with "
            f"a service on each aircraft set it to {' or '.join(map(repr, STRATEGIES))}"
        )
    if (lowest_m := mission.altitude_m(0)) < MIN_HEIGHT_M:
        raise MissionFileError(
            f"{source}: with a service on each aircraft each vehicle has a layer of its own; of "
            f"{len(mission.vehicles)} that lie team.layer_m = {mission.team.layer_m:g} apart the "
            f"lowest is at {lowest_m:g} m, and {MIN_HEIGHT_M:g} m are needed; fly fewer vehicles"
        )
    grid = grid_of(mission)
    pads = [grid.fixed(place) for place in homes(mission)]
    least_m = _least_apart_m(mission)
    for (i, one), (j, other) in itertools.combinations(enumerate(pads, start=1), 2):
        if one.distance_to(other) < least_m:
            raise MissionFileError(
                f"{source}: the pads of vehicles {i} and {j} are {one.distance_to(other):.1f} m "
                f"apart; with a service on each aircraft they need {least_m:.0f} m, for each "
                "keeps the air over its pad to itself: set vehicles[].home"
            )


def with_vehicles(mission: Mission, count: int) -> Mission:
    """Return the mission with `count` vehicles: its first ones, and more without an entry."""
    spare = tuple(VehicleSection() for _ in range(count - len(mission.vehicles)))
    return mission.model_copy(update={"vehicles": (mission.vehicles + spare)[:count]})


def with_own_air(mission: Mission) -> Mission:
    """Return the mission as a fleet flies it: pads apart, and a layer of its own for every member.

    One service separates vehicles that share a layer (`vehicles.layer`, `search.layer_m`). Members
    out of contact cannot. Their layers lie below the highest one of the mission.
    """
    mission = with_pads_apart(mission)
    last, apart_m = len(mission.vehicles) - 1, mission.team.layer_m
    changes: dict[str, object] = {}
    if mission.layer_number(last) != last:
        vehicles = tuple(v.model_copy(update={"layer": None}) for v in mission.vehicles)
        changes["vehicles"] = vehicles
        if mission.flight.altitude_m != AUTO:
            lowest_m = round(mission.altitude_m(last) - last * apart_m, 6)
            changes["flight"] = mission.flight.model_copy(update={"altitude_m": lowest_m})
    search_m = mission.search.layer_m
    if mission.search.altitude_m is not None and search_m is not None and search_m < apart_m:
        changes["search"] = mission.search.model_copy(update={"layer_m": None})
    return mission.model_copy(update=changes)


def with_pads_apart(mission: Mission) -> Mission:
    """Return the mission with vehicles without a home in a row, as far apart as a fleet needs."""
    grid = grid_of(mission)
    gap_m = math.ceil(_least_apart_m(mission) + 1.0)
    placed = []
    for k, vehicle in enumerate(mission.vehicles):
        if k and vehicle.home is None:  # the first is at the start
            place = grid.position(GridPoint(float(k * gap_m), 0.0))
            vehicle = vehicle.model_copy(update={"home": (place.lat_deg, place.lon_deg)})
        placed.append(vehicle)
    return mission.model_copy(update={"vehicles": tuple(placed)})


def _least_apart_m(mission: Mission) -> float:
    return column_radius_m(mission.team.separation_m) + mission.fence.margin_m + PAD_M
