"""Homes of a team: the mission gives their heights, and receivers may contradict it.

Two receivers on level ground differ by metres, so layers are never counted from what they report.
A difference beyond their stated errors that would eat the separation of two layers keeps the team
on the ground: then the mission is wrong, or a receiver is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from missions.flight.setting import Setting
from missions.mission.places import home_heights_m
from missions.units import PadHeight
from uavmap.runner.preflight.finding import Finding, bad, ok, warn

SIGMAS = 3.0
"""How many standard deviations two receivers may differ by."""


def pad_heights(setting: Setting, pads: Mapping[int, PadHeight]) -> dict[int, Finding]:
    """Compare the height of each home with the mission's, relative to that of the first vehicle.

    Args:
        setting: The mission's.
        pads: What the receivers of vehicles that stand on the ground report, by number.

    Returns:
        A finding for every vehicle but the first: bad and binding where the receivers contradict
        the mission by more than their stated errors and the room between two layers.
    """
    if len(pads) < 2:
        return {}
    given_m, team = home_heights_m(setting.mission), setting.mission.team
    room_m = team.layer_m - team.separation_m
    first, *others = sorted(pads)
    found = {}
    for number in others:
        reported_m = pads[number].amsl_m - pads[first].amsl_m
        wanted_m = given_m[number - 1] - given_m[first - 1]
        error_m = SIGMAS * math.hypot(pads[first].sigma_m, pads[number].sigma_m)
        text = f"{reported_m:+.1f} m from vehicle {first}'s by the receivers, +-{error_m:.1f} m"
        wanted = f"{wanted_m:+.1f} m by the mission"
        remedy = (
            f"measure it and set vehicles[{number - 1}].home_height_m, or wait for better fixes"
        )
        off_m = abs(reported_m - wanted_m)
        if off_m <= error_m:
            found[number] = ok("home height", f"{text}; {wanted}")
        elif off_m <= room_m:
            found[number] = warn("home height", text, wanted, remedy)
        else:
            found[number] = bad("home height", text, wanted, remedy, binding=True)
    return found
