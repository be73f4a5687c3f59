"""Whether a mission can be flown as a leapfrog: two vehicles, a marker, and height between them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from missions.mission.flyable import lean_rad
from missions.mission.schema import Mission
from missions.planning.leapfrog_geometry import TrackerView
from missions.planning.sweep.strategies import LEAPFROG

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
    return TrackerView(  # vfov in this form: `optics.vfov_rad` rounds otherwise
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


def faults(mission: Mission) -> Iterator[str]:
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
