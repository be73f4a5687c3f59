"""A stream of setpoints, and how an autopilot follows it: place and velocity, or velocity alone.

ArduCopter shapes what it is given with limits on acceleration and jerk: a velocity is answered
accel / jerk (0.5 s by default) late, a place is drawn to with half of that rate. So a stream on a
curve is followed without a lag when its velocity is told 0.5 s ahead of its place. PX4 flies a
setpoint as it is, some time after it was sent.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

from sitl.copter.control import WIND_TAU_S, Estimate, Limits, held, sqrt_controller
from sitl.copter.fence import Place

_PLACE_SHARE, _PLACE_BRAKING = 0.5, 0.5  # of jerk over acceleration, and of the acceleration
_SETTLES_S = 4.0
_CORRECTION_M_S = 10.0  # at most so fast a place is drawn to


class Setpoint(NamedTuple):
    """Metres and m/s (east, north, up); without a place only the velocity counts."""

    place: Place | None
    velocity: Place


def _cornered(
    along: tuple[float, float], accel: tuple[float, float], most: float
) -> tuple[float, float]:
    """An acceleration of at most `most`: of speeding up and turning, turning comes first.

    Of braking and turning, braking does.
    """
    length = math.hypot(*accel)
    speed = math.hypot(*along)
    if length <= most or speed < 1e-6:
        return held(*accel, most)
    east, north = along[0] / speed, along[1] / speed
    forward = accel[0] * east + accel[1] * north
    across = accel[0] * -north + accel[1] * east
    if forward > 0.0:
        across = max(-most, min(most, across))
        forward = min(forward, math.sqrt(most * most - across * across))
    else:
        forward = max(-most, forward)
        room = math.sqrt(most * most - forward * forward)
        across = max(-room, min(room, across))
    return forward * east - across * north, forward * north + across * east


class ShapedFollower:
    """ArduCopter's: place, velocity and acceleration of the point that is followed.

    After `wind_tau_s` the loop below makes up for what the air does.
    """

    # A real one at 6 m/s, at 6 m/s in a wind of 3.6, and at 10 m/s is within 0.54, 0.60 and 0.94 m
    # of its plan in 95 % of the time; with this one within 0.45, 0.51 and 0.87
    wind_tau_s = 3.0

    def __init__(self, jerk_m_s3: Callable[[], float]) -> None:
        self._jerk_m_s3 = jerk_m_s3
        self._active = False
        self._place = self._velocity = self._acceleration = (0.0, 0.0)
        self._target = (0.0, 0.0)

    def hear(self, setpoint: Setpoint, now_s: float) -> None:
        """From here its place moves on with its velocity."""
        if setpoint.place is not None:
            self._target = setpoint.place[:2]

    def stop(self) -> None:
        """It begins anew where the vehicle will be then."""
        self._active = False

    def velocity(
        self, setpoint: Setpoint, now: Estimate, limits: Limits, now_s: float, dt_s: float
    ) -> tuple[float, float]:
        """Of the point, and towards it."""
        jerk_m_s3 = self._jerk_m_s3()
        if not self._active:
            self._active = True
            self._place, self._velocity = (now.east, now.north), (now.v_east, now.v_north)
            self._acceleration = (0.0, 0.0)
        rate_1_s = jerk_m_s3 / limits.accel_m_s2
        v_east, v_north = self._velocity
        wanted_east, wanted_north = setpoint.velocity[:2]
        if setpoint.place is not None:
            to_east, to_north = self._target[0] - self._place[0], self._target[1] - self._place[1]
            distance = math.hypot(to_east, to_north)
            braking = _PLACE_BRAKING * limits.accel_m_s2
            speed = min(
                _CORRECTION_M_S, sqrt_controller(distance, _PLACE_SHARE * rate_1_s, braking)
            )
            scale = speed / max(distance, 1e-9)
            wanted_east, wanted_north = (
                wanted_east + to_east * scale, wanted_north + to_north * scale,
            )  # fmt: skip
            self._target = (
                self._target[0] + setpoint.velocity[0] * dt_s,
                self._target[1] + setpoint.velocity[1] * dt_s,
            )
        error_east, error_north = wanted_east - v_east, wanted_north - v_north
        error = math.hypot(error_east, error_north)
        scale = sqrt_controller(error, rate_1_s, jerk_m_s3) / max(error, 1e-9)
        accel = _cornered(
            self._velocity, (error_east * scale, error_north * scale), limits.accel_m_s2
        )
        a_east, a_north = self._acceleration
        j_east, j_north = held(accel[0] - a_east, accel[1] - a_north, jerk_m_s3 * dt_s)
        self._acceleration = a_east, a_north = a_east + j_east, a_north + j_north
        self._velocity = v_east, v_north = v_east + a_east * dt_s, v_north + a_north * dt_s
        (east, north), p_1_s = self._place, limits.p_xy
        self._place = (east + v_east * dt_s, north + v_north * dt_s)
        return v_east + p_1_s * (east - now.east), v_north + p_1_s * (north - now.north)


class DelayedFollower:
    """PX4's: each setpoint as it is, some time after it came; its place moves on meanwhile.

    At the beginning of a stream that is `first_s`, in the end `delay_s`.
    """

    wind_tau_s = WIND_TAU_S

    def __init__(self, delay_s: float, first_s: float) -> None:
        self._delay_s, self._first_s = delay_s, first_s
        self._begun_s = 0.0
        self._coming: deque[tuple[float, Setpoint]] = deque()
        self._flown: tuple[float, Setpoint] | None = None

    def hear(self, setpoint: Setpoint, now_s: float) -> None:
        """It counts in a while; the first of a stream at once."""
        if self._flown is None:
            self._flown, self._begun_s = (now_s, setpoint), now_s
        more = math.exp(-(now_s - self._begun_s) / _SETTLES_S)
        delay_s = self._delay_s + (self._first_s - self._delay_s) * more
        self._coming.append((now_s + delay_s, setpoint))

    def stop(self) -> None:
        """What is under way counts no more."""
        self._coming.clear()
        self._flown = None

    def velocity(
        self, setpoint: Setpoint, now: Estimate, limits: Limits, now_s: float, dt_s: float
    ) -> tuple[float, float]:
        """Of the setpoint that counts by now, and towards its place."""
        now_s -= dt_s  # the estimate is that before this step
        while self._coming and self._coming[0][0] <= now_s:
            self._flown = self._coming.popleft()
        since_s, flown = self._flown or (now_s, setpoint)
        place, (v_east, v_north, _) = flown
        if place is None:
            return v_east, v_north
        age_s = now_s - since_s
        return (
            v_east + limits.p_xy * (place[0] + v_east * age_s - now.east),
            v_north + limits.p_xy * (place[1] + v_north * age_s - now.north),
        )


Follower: TypeAlias = ShapedFollower | DelayedFollower
"""How setpoints become the wanted velocity of the vehicle."""
