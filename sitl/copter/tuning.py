"""How the parameters of an autopilot say that it flies, whatever their names and units are."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from sitl.copter.control import Limits, sqrt_controller
from sitl.copter.params import Parameters

_LOWEST_RETURN_M = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Tuning:
    """Lengths in metres, heights above home, times in seconds, speeds in m/s.

    `return_height_m` gives the height of the way home from a distance and a height,
    `landing_m_s` the descent of a landing by what the limits are now and at a height.
    """

    limits: Limits
    jerk_m_s3: float  # of a shaped path; 0: as directly as it can
    turns_nose: bool  # towards a far target
    arrival_m: float  # at which a waypoint counts as reached
    return_height_m: Callable[[float, float], float]
    landing_m_s: Callable[[Limits, float], float]
    return_speed_m_s: float = 0.0  # 0: as any other
    return_hover_s: float  # above home before it comes down
    return_final_m: float  # height at which a return ends; 0: on the ground
    rally_within_m: float = 0.0  # how far away a rally point may be; 0: anywhere
    rally_or_home: bool = True  # home is a place to return to although there are rally points
    mission_restarts: bool = False  # one that was left begins anew


def copter_tuning(parameters: Parameters) -> Tuning:
    """ArduCopter's.

    >>> tuning = copter_tuning(Parameters())
    >>> tuning.return_height_m(100.0, 12.0), tuning.return_height_m(4.5, 12.0)
    (15.0, 13.5)
    >>> tuning.landing_m_s(tuning.limits, 3.0)
    0.5
    """
    get = parameters.positive
    return Tuning(
        limits=Limits(
            speed_m_s=get("WPNAV_SPEED", 10, 5000) / 100,
            climb_m_s=get("WPNAV_SPEED_UP", 10, 1000) / 100,
            descent_m_s=get("WPNAV_SPEED_DN", 10, 500) / 100,
            accel_m_s2=get("WPNAV_ACCEL", 50, 500) / 100,
            accel_z_m_s2=get("WPNAV_ACCEL_Z", 50, 200) / 100,
            p_xy=get("PSC_POSXY_P", 0.5, 2.0),
            p_z=get("PSC_POSZ_P", 0.5, 2.0),
            yaw_rate_rad_s=math.radians(get("ATC_SLEW_YAW", 500, 9000) / 100),
        ),
        jerk_m_s3=parameters["PSC_JERK_XY"],
        turns_nose=parameters["WP_YAW_BEHAVIOR"] != 0,
        arrival_m=get("WPNAV_RADIUS", 5, 1000) / 100.0,
        return_height_m=partial(_return_height, parameters),
        landing_m_s=partial(_landing_speed, parameters),
        return_speed_m_s=parameters["RTL_SPEED"] / 100.0,
        return_hover_s=parameters["RTL_LOIT_TIME"] / 1000.0,
        return_final_m=parameters["RTL_ALT_FINAL"] / 100.0,
        rally_within_m=1000.0 * parameters["RALLY_LIMIT_KM"],
        rally_or_home=bool(parameters["RALLY_INCL_HOME"]),
        mission_restarts=parameters["MIS_RESTART"] != 0.0,
    )


def _return_height(parameters: Parameters, away_m: float, height_m: float) -> float:
    """RTL_ALT, less inside a cone over home, and at least RTL_CLIMB_MIN higher than it is."""
    wanted = parameters["RTL_ALT"] / 100.0
    slope = parameters["RTL_CONE_SLOPE"]
    if slope > 0.0:
        wanted = min(wanted, max(_LOWEST_RETURN_M, away_m * slope))
    return max(height_m + max(0.0, parameters["RTL_CLIMB_MIN"] / 100.0), wanted)


def _landing_speed(parameters: Parameters, limits: Limits, height_m: float) -> float:
    """Slow below LAND_ALT_LOW, braking towards it above."""
    slow = parameters.positive("LAND_SPEED", 30, 200) / 100.0
    above_m = height_m - parameters["LAND_ALT_LOW"] / 100.0
    if above_m <= 0.0:
        return slow
    speed = sqrt_controller(above_m, limits.p_z, limits.accel_z_m_s2)
    fast = parameters["LAND_SPEED_HIGH"] / 100.0
    return max(slow, min(fast if fast > 0.0 else limits.descent_m_s, speed))
