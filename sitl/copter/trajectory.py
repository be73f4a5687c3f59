"""A jerk-limited path to a target, as ArduCopter's guided flight shapes it.

The shaped point runs ahead as the limits allow; the vehicle follows it, and may for a while be
faster than the limit while it makes up for its lag, as the real one is.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from sitl.copter.control import Estimate, Limits, held, sqrt_controller

# Found by flying the legs of a recorded flight of the real one: 4, 5 and 20 m at 4 m/s
_BRAKING_SHARE = 0.8  # of the acceleration: the rest is for the jerk
_PLACE_SHARE, _SPEED_SHARE = 0.42, 0.85  # of jerk over acceleration, as gains


MOST_JERK_M_S3 = 20.0


def shaping_jerk(parameter: float) -> float:
    """PSC_JERK_XY, held to a range in which flying is possible."""
    return max(1.0, min(MOST_JERK_M_S3, parameter))


SpeedLaw = Callable[[float, float, float], float]
"""Speed at which to approach, by distance, acceleration and jerk: m/s, m, m/s^2, m/s^3."""


def copter_speed(distance_m: float, accel_m_s2: float, jerk_m_s3: float) -> float:
    """ArduCopter's.

    >>> round(copter_speed(4.0, 2.5, 5.0), 2)
    3.21
    """
    rate_1_s = jerk_m_s3 / accel_m_s2
    return sqrt_controller(distance_m, _PLACE_SHARE * rate_1_s, _BRAKING_SHARE * accel_m_s2)


def px4_speed(distance_m: float, accel_m_s2: float, jerk_m_s3: float) -> float:
    """PX4's: from which it stops with the acceleration ramped up and down again.

    Near the target it is proportional to the distance, with jerk / (2 accel) a second, so the last
    metre takes long.

    >>> round(px4_speed(4.0, 3.0, 4.0), 2), round(px4_speed(0.5, 3.0, 4.0), 2)
    (2.15, 0.32)
    """
    ramp_m_s = 4.0 * accel_m_s2 * accel_m_s2 / jerk_m_s3
    return 0.5 * (math.sqrt(ramp_m_s * ramp_m_s + 8.0 * accel_m_s2 * distance_m) - ramp_m_s)


class Shaper:
    """Place, velocity and acceleration of the point that is followed, metres and seconds."""

    def __init__(self, law: SpeedLaw = copter_speed) -> None:
        self._law = law
        self.active = False
        self._place = self._velocity = self._acceleration = (0.0, 0.0)

    def velocity_towards(
        self,
        target: tuple[float, float],
        now: Estimate,
        limits: Limits,
        jerk_m_s3: float,
        dt_s: float,
    ) -> tuple[float, float]:
        """Wanted velocity (east, north) of the vehicle; `active` tells whether it goes on."""
        if not self.active:
            self.active = True
            self._place, self._velocity = (now.east, now.north), (now.v_east, now.v_north)
            self._acceleration = (0.0, 0.0)
        east, north = self._place
        v_east, v_north = self._velocity
        a_east, a_north = self._acceleration
        rate_1_s = jerk_m_s3 / limits.accel_m_s2
        d_east, d_north = target[0] - east, target[1] - north
        distance = math.hypot(d_east, d_north)
        speed = min(limits.speed_m_s, self._law(distance, limits.accel_m_s2, jerk_m_s3))
        scale = speed / max(distance, 1e-9)
        gain_1_s = _SPEED_SHARE * rate_1_s
        wanted_east, wanted_north = held(
            gain_1_s * (d_east * scale - v_east),
            gain_1_s * (d_north * scale - v_north),
            limits.accel_m_s2,
        )
        j_east, j_north = held(wanted_east - a_east, wanted_north - a_north, jerk_m_s3 * dt_s)
        a_east, a_north = a_east + j_east, a_north + j_north
        v_east, v_north = v_east + a_east * dt_s, v_north + a_north * dt_s
        east, north = east + v_east * dt_s, north + v_north * dt_s
        self._place, self._velocity = (east, north), (v_east, v_north)
        self._acceleration = (a_east, a_north)
        return (
            v_east + limits.p_xy * (east - now.east),
            v_north + limits.p_xy * (north - now.north),
        )

    def stopping_point(self, limits: Limits, jerk_m_s3: float) -> tuple[float, float]:
        """Where (east, north) the path can come to rest without coming back."""
        a_east, a_north = self._acceleration
        # what is still gained until the acceleration is taken back
        gain_s = math.hypot(a_east, a_north) / (2.0 * jerk_m_s3)
        v_east, v_north = self._velocity[0] + a_east * gain_s, self._velocity[1] + a_north * gain_s
        braking = _BRAKING_SHARE * limits.accel_m_s2
        lag_s = math.hypot(v_east, v_north) / (2.0 * braking) + limits.accel_m_s2 / jerk_m_s3
        return self._place[0] + v_east * lag_s, self._place[1] + v_north * lag_s
