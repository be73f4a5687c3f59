"""Photographs over ground that is not flat: their heights are above the place of take-off."""

from __future__ import annotations

from dataclasses import replace

from missions.flight.setting import Setting
from missions.units import Pose


def above_ground(pose: Pose, setting: Setting) -> Pose:
    """A pose whose height is above the ground below, of one whose height is above the start.

    The same where the ground is flat. Whoever took the photographs took off at the mission's start.
    """
    if setting.ground is None:
        return pose
    ground_m = setting.ground.height_m(setting.grid.fixed(pose.position))
    start_m = setting.ground.height_m(setting.grid.fixed(setting.mission.home))
    return replace(pose, height_m=pose.height_m - (ground_m - start_m))
