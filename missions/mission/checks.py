"""What must hold between the values of a mission file, and a reader that checks it all.

Names, vehicles and speeds are checked here, places and the fence in `missions.mission.places`,
wind, camera and battery in `missions.mission.flyable`. Every fault is a line with key, value and
remedy; all are reported at once.
"""

from __future__ import annotations

import difflib
from collections import ChainMap
from collections.abc import Collection, Iterator
from typing import Any, Final

from missions.errors import MissionFileError
from missions.geo.grid import Grid
from missions.mission import flyable, places
from missions.mission.fleet_checks import leapfrog_faults
from missions.mission.height_and_speed import terrain_faults
from missions.mission.schema import Mission, parse_fields
from missions.planning.stepwise import EXPLORERS
from missions.planning.sweep.strategies import ON_PATHS, SWATH

STRATEGIES: Final = ChainMap[str, Any](EXPLORERS, ON_PATHS)
"""All strategies by name, those that fly paths first; with those that register later."""
FLOWN: Final = ("swath", "survey", "rdfs", "horizon", "leapfrog")
"""Strategies for real aircraft; the others serve comparisons in papers, in simulation."""
DETECTORS = ("threshold", "paved")


def parse_mission(text: str, source: str) -> Mission:
    """Parse and check the TOML of a mission file, which messages call `source`.

    Raises `MissionFileError` with a line for each fault.
    """
    mission = parse_fields(text, source)
    check(mission, source)
    return mission


def with_strategy(mission: Mission, strategy: str) -> Mission:
    """Return the mission with another strategy, without the keys of [search] for `swath` alone."""
    search = mission.search
    if strategy != SWATH.name and search.find == "all":
        plain = {"find": "first", "altitude_m": None, "layer_m": None}
        search = search.model_copy(update=plain)
    return mission.model_copy(update={"strategy": strategy, "search": search})


def check(mission: Mission, source: str, *, detectors: Collection[str] = DETECTORS) -> None:
    """Raise `MissionFileError`, with a line for each fault, for a mission that cannot be flown.

    While a place is not near the start, or a polygon is none, lengths and areas mean nothing, and
    the geometry is not checked.
    """
    where = list(places.positions_near(mission))
    # how high the ground is depends on where the fence is
    placeless = bool(where) and mission.surveyed is not None
    faults = [
        *_names(mission, detectors),
        *(() if placeless else flyable.values(mission)),
        *_speed_and_layers(mission),
        *leapfrog_faults(mission),
        *_moving_ground(mission),
    ]
    if not where:
        grid = Grid.at(mission.home, mission.grid.cell_m)
        where = list(places.polygons(mission, grid)) or [
            *places.inside_fence(mission, grid),
            *places.homes_apart(mission, grid),
            *places.prior_faults(mission, grid),
        ]
        if not where:
            faults += terrain_faults(mission, grid)
            where = list(flyable.search(mission, grid))
    if faults or where:
        raise MissionFileError("\n".join(f"{source}: {fault}" for fault in [*where, *faults]))


def _moving_ground(mission: Mission) -> Iterator[str]:
    """A region that drifts is ground that moves: by it satellites would seem to lie."""
    if mission.navigation.watches and mission.drift.speed_m_s > 0.0:
        key = "watch = true" if mission.navigation.watch else 'gnss_loss = "map"'
        yield (
            f"navigation.{key} does not go with drift.speed_m_s = {mission.drift.speed_m_s:g}: a "
            "vehicle finds its way by pictures of ground that stands still; take gnss_loss = "
            '"rtl" or "land", and leave watch out'
        )


# --- single values ---------------------------------------------------------------------------
def _names(mission: Mission, detectors: Collection[str]) -> Iterator[str]:
    for key, name, known in (
        ("strategy", mission.strategy, STRATEGIES),
        ("detector.name", mission.detector.name, detectors),
    ):
        if name not in known:
            near = difflib.get_close_matches(name, list(known), n=1)
            guess = f"did you mean {near[0]!r}? " if near else ""
            yield f"{key} = {name!r}: unknown; {guess}known: {', '.join(sorted(known))}"
    if mission.search.find == "all" and mission.strategy != SWATH.name:
        yield (
            f'search.find = "all" is for strategy = "swath", not {mission.strategy!r}; '
            'leave it out, or set strategy = "swath"'
        )


def _speed_and_layers(mission: Mission) -> Iterator[str]:
    if mission.drift.speed_m_s >= mission.flight.speed_m_s:
        yield (
            f"drift.speed_m_s = {mission.drift.speed_m_s:g}: the region must drift slower than "
            f"the vehicles fly; raise flight.speed_m_s ({mission.flight.speed_m_s:g})"
        )
    team, vehicles = mission.team, mission.vehicles
    if len(vehicles) > 1 and team.layer_m <= team.separation_m:
        yield (
            f"team.layer_m = {team.layer_m:g}: layers must lie further apart than "
            f"team.separation_m ({team.separation_m:g}), for what vehicles waver in height"
        )
    seen: dict[str, int] = {}
    for i, vehicle in enumerate(vehicles):
        if vehicle.url is not None and (first := seen.setdefault(vehicle.url, i)) != i:
            yield (
                f"vehicles[{i}].url = {vehicle.url!r}: also the URL of vehicles[{first}]; "
                "give every vehicle its own"
            )
