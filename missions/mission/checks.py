"""Rules between the values of a mission file, and a reader that checks all of them.

Names, vehicles and speeds are checked here, places and the fence in `missions.mission.places`,
wind, camera and battery in `missions.mission.flyable`. Every fault is a line with key, value and
remedy; all are reported at once.
"""

from __future__ import annotations

import difflib
import math
from collections import ChainMap
from collections.abc import Collection, Iterator
from typing import Any, Final

from missions.errors import MissionFileError
from missions.mission import flyable, places
from missions.mission.fleet_checks import tracker_view
from missions.mission.height_and_speed import terrain_faults
from missions.mission.schema import Mission, parse_fields
from missions.planning.stepwise import EXPLORERS
from missions.planning.sweep.strategies import LEAPFROG, ON_PATHS, SWATH

STRATEGIES: Final = ChainMap[str, Any](EXPLORERS, ON_PATHS)
"""All strategies by name, those that fly paths first; with those that register later."""
FLOWN: Final = ("swath", "survey", "rdfs", "horizon", "leapfrog")
"""Strategies for real aircraft; the others serve comparisons in papers, in simulation."""
_DETECTORS: Final = ("threshold", "paved")
"""Names of detectors where the caller states none; `vision.detectors` has the registry."""
MIN_REACH_M: Final = 1.5
"""Minimum half length of a hop, m: shorter ones take longer to start and stop than to fly."""
MIN_EDGE_PX: Final = 10.0
"""Minimum length of the marker's edge in the tracker's picture for reliable detection, px."""


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


def check(mission: Mission, source: str, *, detectors: Collection[str] = _DETECTORS) -> None:
    """Raise `MissionFileError`, with a line for each fault, for a mission that cannot be flown.

    The geometry is not checked while a place is far from the start or a polygon is invalid: lengths
    and areas then mean nothing.
    """
    where = list(places.positions_near(mission))
    # the height of the ground depends on the position of the fence
    placeless = bool(where) and mission.surveyed is not None
    faults = [
        *_names(mission, detectors),
        *(() if placeless else flyable.values(mission)),
        *_speed_and_layers(mission),
        *_leapfrog(mission),
        *_moving_ground(mission),
    ]
    if not where:
        grid = places.grid_of(mission)
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
    """Yield a fault of a drifting region with navigation by map: it would make satellites seem
    wrong."""
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


# --- two vehicles that observe each other -------------------------------------------------------
def _edge_px(mission: Mission) -> float:
    """Length of the marker's edge in the tracker's picture, px."""
    return mission.camera.optics.focal_px * mission.navigation.tag_m / mission.team.layer_m


def _leapfrog(mission: Mission) -> Iterator[str]:
    """Yield the faults of a leapfrog; for other strategies, keys that only a leapfrog uses."""
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
        return  # reported already
    try:
        reach_m = tracker_view(mission).reach_m
    except ValueError:
        reach_m = 0.0
    if reach_m < MIN_REACH_M:
        yield (
            f"team.layer_m = {layer_m:g}: from this height the tracker sees the mapper up to "
            f"{reach_m:.1f} m aside, with its lean in the wind; hops need {MIN_REACH_M:g} m; "
            f"raise it, or take a wider camera.hfov_deg"
        )
    if _edge_px(mission) < MIN_EDGE_PX:
        larger_m = math.ceil(100.0 * navigation.tag_m * MIN_EDGE_PX / _edge_px(mission)) / 100.0
        yield (
            f"navigation.tag_m = {navigation.tag_m:g}: from team.layer_m = {layer_m:g} m above it "
            f"has {_edge_px(mission):.1f} pixels in a picture, and is read from {MIN_EDGE_PX:g} "
            f"on; take a marker of {larger_m:g} m, or a lower layer"
        )
