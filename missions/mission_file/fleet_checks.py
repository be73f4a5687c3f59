"""What a mission needs so that each of its vehicles can have a service of its own."""

from __future__ import annotations

import itertools
import math

from missions.errors import MissionFileError
from missions.ground.columns import PAD_M, column_radius_m
from missions.ground.grid import Grid
from missions.mission_file.launch_pads import homes
from missions.mission_file.schema import Mission
from missions.units import GridPoint

STRATEGIES = ("swath", "survey")


def check_fleet(mission: Mission, source: str) -> None:
    """Raise `MissionFileError` for a mission that members cannot fly each by its own service."""
    if mission.strategy not in STRATEGIES:
        raise MissionFileError(
            f"{source}: strategy = {mission.strategy!r} needs one service for all vehicles; with "
            f"a service on each aircraft set it to {' or '.join(map(repr, STRATEGIES))}"
        )
    if key := _shared_layers(mission):
        raise MissionFileError(
            f"{source}: {key} has vehicles share a layer, and needs one service for all; with "
            "a service on each aircraft leave it out"
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


def with_pads_apart(mission: Mission) -> Mission:
    """A mission whose vehicles without a home stand in a row as far apart as a fleet's have to."""
    grid, gap_m = (
        Grid.at(mission.home, mission.grid.cell_m),
        math.ceil(_least_apart_m(mission) + 1.0),
    )
    placed = []
    for k, vehicle in enumerate(mission.vehicles):
        if k and vehicle.home is None:  # the first stands at the start
            place = grid.position(GridPoint(float(k * gap_m), 0.0))
            vehicle = vehicle.model_copy(update={"home": (place.lat_deg, place.lon_deg)})
        placed.append(vehicle)
    return mission.model_copy(update={"vehicles": tuple(placed)})


def _least_apart_m(mission: Mission) -> float:
    return column_radius_m(mission.team.separation_m) + mission.fence.margin_m + PAD_M


def _shared_layers(mission: Mission) -> str:
    """The key by which two vehicles of a mission fly in one layer; empty if there is none."""
    count = len(mission.vehicles)
    if mission.layer_number(count - 1) != count - 1:
        return "vehicles.layer"
    apart_m = mission.search.layer_m
    if mission.search.altitude_m is None or apart_m is None or count < 2:
        return ""
    return "search.layer_m" if apart_m < mission.team.layer_m else ""
