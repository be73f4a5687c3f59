"""Flight of an autopilot to a place, and along a stream of setpoints.

A path to a place is limited in jerk: a shaped point runs ahead within the limits, and the vehicle
follows it. While it makes up for its lag it may exceed the limit, as the real one does.

A setpoint has a place and a velocity, or a velocity alone. ArduCopter shapes it with limits on
acceleration and jerk. It follows a velocity accel / jerk (0.5 s by default) late, and approaches a
place at half of that rate. It follows a curve without a lag if the velocity is sent 0.5 s ahead of
the place. PX4 flies a setpoint as it is, some time after it was sent.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

from sitl.copter.control import WIND_TAU_S, Estimate, Limits, held, sqrt_controller
from sitl.copter.fence import Place

# Found by flying the legs of a recorded flight of the real one: 4, 5 and 20 m at 4 m/s
_BRAKING_SHARE = 0.8  # of the acceleration: the rest is for the jerk
_PLACE_SHARE, _SPEED_SHARE = 0.42, 0.85  # of jerk over acceleration, as gains


MAX_JERK_M_S3 = 20.0


def shaping_jerk(parameter: float) -> float:
    """Return PSC_JERK_XY, limited to a range in which flying is possible."""
    return max(1.0, min(MAX_JERK_M_S3, parameter))


SpeedLaw = Callable[[float, float, float], float]
"""Speed at which to approach, by distance, acceleration and jerk: m/s, m, m/s^2, m/s^3."""


def copter_speed(distance_m: float, accel_m_s2: float, jerk_m_s3: float) -> float:
    """Return ArduCopter's speed.

    >>> round(copter_speed(4.0, 2.5, 5.0), 2)
    3.21
    """
    rate_1_s = jerk_m_s3 / accel_m_s2
    return sqrt_controller(distance_m, _PLACE_SHARE * rate_1_s, _BRAKING_SHARE * accel_m_s2)


def px4_speed(distance_m: float, accel_m_s2: float, jerk_m_s3: float) -> float:
    """Return PX4's speed, from which it stops with the acceleration ramped up and down again.

    Near the target it is proportional to the distance, jerk / (2 accel) a second.

    >>> round(px4_speed(4.0, 3.0, 4.0), 2), round(px4_speed(0.5, 3.0, 4.0), 2)
    (2.15, 0.32)
    """
    ramp_m_s = 4.0 * accel_m_s2 * accel_m_s2 / jerk_m_s3
    return 0.5 * (math.sqrt(ramp_m_s * ramp_m_s + 8.0 * accel_m_s2 * distance_m) - ramp_m_s)


class _ShapedPoint:
    """Place, velocity and acceleration of the shaped point, metres and seconds."""

    def __init__(self) -> None:
        self.active = False
        self._place = self._velocity = self._acceleration = (0.0, 0.0)

    def _begin(self, now: Estimate) -> None:
        """Start at the vehicle's place, unless the path continues."""
        if not self.active:
            self.active = True
            self._place, self._velocity = (now.east, now.north), (now.v_east, now.v_north)
            self._acceleration = (0.0, 0.0)

    def _advance(
        self, wanted_m_s2: tuple[float, float], jerk_m_s3: float, dt_s: float
    ) -> tuple[float, float]:
        """Approach an acceleration by the jerk, and move on; return the velocity."""
        a_east, a_north = self._acceleration
        wanted_east, wanted_north = wanted_m_s2
        j_east, j_north = held(wanted_east - a_east, wanted_north - a_north, jerk_m_s3 * dt_s)
        self._acceleration = a_east, a_north = a_east + j_east, a_north + j_north
        (v_east, v_north), (east, north) = self._velocity, self._place
        self._velocity = v_east, v_north = v_east + a_east * dt_s, v_north + a_north * dt_s
        self._place = (east + v_east * dt_s, north + v_north * dt_s)
        return self._velocity


class Shaper(_ShapedPoint):
    """The path to a place."""

    def __init__(self, law: SpeedLaw) -> None:
        super().__init__()
        self._law = law

    def velocity_towards(
        self,
        target: tuple[float, float],
        now: Estimate,
        limits: Limits,
        jerk_m_s3: float,
        dt_s: float,
    ) -> tuple[float, float]:
        """Return the vehicle's wanted velocity (east, north); `active`: the path continues."""
        self._begin(now)
        (east, north), (v_east, v_north) = self._place, self._velocity
        rate_1_s = jerk_m_s3 / limits.accel_m_s2
        d_east, d_north = target[0] - east, target[1] - north
        distance = math.hypot(d_east, d_north)
        speed = min(limits.speed_m_s, self._law(distance, limits.accel_m_s2, jerk_m_s3))
        scale = speed / max(distance, 1e-9)
        gain_1_s = _SPEED_SHARE * rate_1_s
        wanted = held(
            gain_1_s * (d_east * scale - v_east),
            gain_1_s * (d_north * scale - v_north),
            limits.accel_m_s2,
        )
        v_east, v_north = self._advance(wanted, jerk_m_s3, dt_s)
        east, north = self._place
        return (
            v_east + limits.p_xy * (east - now.east),
            v_north + limits.p_xy * (north - now.north),
        )

    def stopping_point(self, limits: Limits, jerk_m_s3: float) -> tuple[float, float]:
        """Return where (east, north) the path can come to rest without coming back."""
        a_east, a_north = self._acceleration
        # what is still gained until the acceleration is taken back
        gain_s = math.hypot(a_east, a_north) / (2.0 * jerk_m_s3)
        v_east, v_north = self._velocity[0] + a_east * gain_s, self._velocity[1] + a_north * gain_s
        braking = _BRAKING_SHARE * limits.accel_m_s2
        lag_s = math.hypot(v_east, v_north) / (2.0 * braking) + limits.accel_m_s2 / jerk_m_s3
        return self._place[0] + v_east * lag_s, self._place[1] + v_north * lag_s


# of jerk over acceleration, and of the acceleration
_STREAM_PLACE_SHARE, _STREAM_BRAKING = 0.5, 0.5
_SETTLES_S = 4.0
_CORRECTION_M_S = 10.0  # at most so fast a place is drawn to


class Setpoint(NamedTuple):
    """Metres and m/s (east, north, up); without a place only the velocity counts."""

    place: Place | None
    velocity: Place


def _cornered(
    along: tuple[float, float], accel: tuple[float, float], most: float
) -> tuple[float, float]:
    """Limit an acceleration: turning comes before speeding up, braking before turning."""
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


class ShapedFollower(_ShapedPoint):
    """ArduCopter's.

    After `wind_tau_s` the loop below compensates the force of the air.
    """

    # At 6 m/s, at 6 m/s in a wind of 3.6, and at 10 m/s a real one is within 0.54, 0.60 and 0.94 m
    # of its plan in 95 % of the time. This one is within 0.45, 0.51 and 0.87 m.
    wind_tau_s = 3.0

    def __init__(self, jerk_m_s3: Callable[[], float]) -> None:
        super().__init__()
        self._jerk_m_s3 = jerk_m_s3
        self._target = (0.0, 0.0)

    def accept(self, setpoint: Setpoint, now_s: float) -> None:
        """Take a setpoint, whose place moves on with its velocity."""
        if setpoint.place is not None:
            self._target = setpoint.place[:2]

    def stop(self) -> None:
        """End the stream; the next begins where the vehicle is then."""
        self.active = False

    def velocity(
        self, setpoint: Setpoint, now: Estimate, limits: Limits, now_s: float, dt_s: float
    ) -> tuple[float, float]:
        """Return the velocity of the point, and towards it."""
        self._begin(now)
        jerk_m_s3 = self._jerk_m_s3()
        rate_1_s = jerk_m_s3 / limits.accel_m_s2
        v_east, v_north = self._velocity
        wanted_east, wanted_north = setpoint.velocity[:2]
        if setpoint.place is not None:
            to_east, to_north = self._target[0] - self._place[0], self._target[1] - self._place[1]
            distance = math.hypot(to_east, to_north)
            braking = _STREAM_BRAKING * limits.accel_m_s2
            speed = min(
                _CORRECTION_M_S, sqrt_controller(distance, _STREAM_PLACE_SHARE * rate_1_s, braking)
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
        (east, north), p_1_s = self._place, limits.p_xy
        v_east, v_north = self._advance(accel, jerk_m_s3, dt_s)
        return v_east + p_1_s * (east - now.east), v_north + p_1_s * (north - now.north)


class DelayedFollower:
    """PX4's: each setpoint as it is, delayed; its place moves on meanwhile.

    The delay is `first_s` at the beginning of a stream and approaches `delay_s`.
    """

    wind_tau_s = WIND_TAU_S

    def __init__(self, delay_s: float, first_s: float) -> None:
        self._delay_s, self._first_s = delay_s, first_s
        self._begun_s = 0.0
        self._coming: deque[tuple[float, Setpoint]] = deque()
        self._flown: tuple[float, Setpoint] | None = None

    def accept(self, setpoint: Setpoint, now_s: float) -> None:
        """Take a setpoint, delayed; the first of a stream counts at once."""
        if self._flown is None:
            self._flown, self._begun_s = (now_s, setpoint), now_s
        more = math.exp(-(now_s - self._begun_s) / _SETTLES_S)
        delay_s = self._delay_s + (self._first_s - self._delay_s) * more
        self._coming.append((now_s + delay_s, setpoint))

    def stop(self) -> None:
        """End the stream, and drop the delayed setpoints."""
        self._coming.clear()
        self._flown = None

    def velocity(
        self, setpoint: Setpoint, now: Estimate, limits: Limits, now_s: float, dt_s: float
    ) -> tuple[float, float]:
        """Return the velocity of the present setpoint, and towards its place."""
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
"""Conversion of setpoints to the wanted velocity of the vehicle."""
