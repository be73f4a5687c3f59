"""What a mission needs for a team: a service for each vehicle, or a leapfrog of two."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Final

from missions.errors import MissionFileError
from missions.geo.columns import PAD_M, column_radius_m
from missions.geo.grid import Grid
from missions.mission.flyable import lean_rad
from missions.mission.height_and_speed import LEAST_HEIGHT_M
from missions.mission.places import homes
from missions.mission.schema import Mission, VehicleSection
from missions.mission.sections import AUTO
from missions.planning.leapfrog_geometry import TrackerView
from missions.planning.sweep.strategies import LEAPFROG
from missions.units import GridPoint

LEAST_REACH_M: Final = 1.5
"""Hops of twice this length take more time to begin and to end than to fly."""
LEAST_EDGE_PX: Final = 10.0
"""Of the marker from the tracker: what is found in every picture."""
SWAY_RAD: Final = math.radians(3.0)
"""How far a hovering vehicle tilts beside its lean into the wind."""


def tracker_view(mission: Mission) -> TrackerView:
    """What the tracker sees of the mapper. Raises `ValueError` where that is nothing."""
    optics = mission.camera.optics
    half = math.tan(optics.hfov_rad / 2.0) * optics.height_px / optics.width_px
    return TrackerView(  # not by `optics.focal_px`, which rounds otherwise
        hfov_rad=optics.hfov_rad,
        vfov_rad=2.0 * math.atan(half),
        above_m=mission.altitude_m(1) - mission.altitude_m(0),
        separation_m=mission.team.separation_m,
        tag_m=mission.navigation.tag_m,
        tilt_rad=lean_rad(mission) + SWAY_RAD,
    )


def edge_px(mission: Mission) -> float:
    """How long an edge of the marker is in the tracker's picture."""
    return mission.camera.optics.focal_px * mission.navigation.tag_m / mission.team.layer_m


def leapfrog_faults(mission: Mission) -> Iterator[str]:
    """Why a mission cannot be flown so; nothing for other strategies."""
    navigation, layer_m = mission.navigation, mission.team.layer_m
    if mission.strategy != LEAPFROG.name:
        if navigation.gnss_loss == "leapfrog":
            yield (
                f'navigation.gnss_loss = "leapfrog" is for strategy = "leapfrog", not '
                f'{mission.strategy!r}; set gnss_loss = "map", or that strategy'
            )
        return
    if navigation.gnss_loss == "leapfrog" and navigation.watch:
        yield (
            'navigation.watch = true: with gnss_loss = "leapfrog" places are held against the '
            "other vehicle, and not against pictures of the ground; leave it out"
        )
    if len(mission.vehicles) != 2:
        yield (
            f'strategy = "leapfrog": {len(mission.vehicles)} vehicles; it takes exactly two, a '
            "mapper and a tracker: write two [[vehicles]], or give --vehicles 2"
        )
        return
    for key, wrong in (
        ("search.altitude_m", mission.search.altitude_m is not None),
        ("drift.speed_m_s", mission.drift.speed_m_s > 0.0),
    ):
        if wrong:
            yield (
                f'{key}: strategy = "leapfrog" maps ground that rests, from one height; leave it '
                "out"
            )
    if layer_m <= mission.team.separation_m:
        return  # told already
    try:
        reach_m = tracker_view(mission).reach_m
    except ValueError:
        reach_m = 0.0
    if reach_m < LEAST_REACH_M:
        yield (
            f"team.layer_m = {layer_m:g}: so far above the mapper the tracker sees it up to "
            f"{reach_m:.1f} m aside only, beside what it leans in the wind, and hops need "
            f"{LEAST_REACH_M:g} m; raise it, or take a wider camera.hfov_deg"
        )
    if edge_px(mission) < LEAST_EDGE_PX:
        larger_m = math.ceil(100.0 * navigation.tag_m * LEAST_EDGE_PX / edge_px(mission)) / 100.0
        yield (
            f"navigation.tag_m = {navigation.tag_m:g}: from team.layer_m = {layer_m:g} m above it "
            f"has {edge_px(mission):.1f} pixels in a picture, and is read from {LEAST_EDGE_PX:g} "
            f"on; take a marker of {larger_m:g} m, or a lower layer"
        )


STRATEGIES = ("swath", "survey")


def check_fleet(mission: Mission, source: str) -> None:
    """Raise `MissionFileError` for a mission that members cannot fly each by its own service."""
    if mission.strategy not in STRATEGIES:
        raise MissionFileError(
            f"{source}: strategy = {mission.strategy!r} needs one service for all vehicles; with "
            f"a service on each aircraft set it to {' or '.join(map(repr, STRATEGIES))}"
        )
    if (lowest_m := mission.altitude_m(0)) < LEAST_HEIGHT_M:
        raise MissionFileError(
            f"{source}: with a service on each aircraft everybody has a layer of its own; of "
            f"{len(mission.vehicles)} that lie team.layer_m = {mission.team.layer_m:g} apart the "
            f"lowest is at {lowest_m:g} m, and {LEAST_HEIGHT_M:g} m are needed; fly fewer vehicles"
        )
    grid = Grid.at(mission.home, mission.grid.cell_m)
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
    """Return the mission with so many vehicles: its first ones, and more without an entry."""
    spare = tuple(VehicleSection() for _ in range(count - len(mission.vehicles)))
    return mission.model_copy(update={"vehicles": (mission.vehicles + spare)[:count]})


def with_own_air(mission: Mission) -> Mission:
    """Return the mission as a fleet flies it: pads apart, and a layer of its own for every member.

    One service keeps vehicles that share a layer (`vehicles.layer`, `search.layer_m`) apart in it;
    members out of contact cannot. Their layers lie below the highest one of the mission.
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
    """The mission with vehicles without a home in a row, as far apart as a fleet needs."""
    grid = Grid.at(mission.home, mission.grid.cell_m)
    gap_m = math.ceil(_least_apart_m(mission) + 1.0)
    placed = []
    for k, vehicle in enumerate(mission.vehicles):
        if k and vehicle.home is None:  # the first stands at the start
            place = grid.position(GridPoint(float(k * gap_m), 0.0))
            vehicle = vehicle.model_copy(update={"home": (place.lat_deg, place.lon_deg)})
        placed.append(vehicle)
    return mission.model_copy(update={"vehicles": tuple(placed)})


def _least_apart_m(mission: Mission) -> float:
    return column_radius_m(mission.team.separation_m) + mission.fence.margin_m + PAD_M
