"""The autopilot's inner loops, from position and target to thrust and turn rate.

As in ArduCopter a square-root controller turns a distance into a speed from which the vehicle can
still stop. The speed is slewed at the permitted acceleration. A velocity loop with a slow estimate
of the disturbance (wind) turns it into thrust.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from sitl.body.physics import Body, Command

_VELOCITY_GAIN_1_S = 2.0
_CLIMB_GAIN_1_S = 3.0
WIND_TAU_S = 0.5
_YAW_GAIN_1_S = 2.0
_MAX_VERTICAL_M_S2 = 3.0
# The velocity loop and the tilt lag behind; braking planned a little softer than permitted
# leaves them the room.
_BRAKING_SHARE = 0.85


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits by the parameters, in SI units, within the capability of the airframe."""

    speed_m_s: float
    climb_m_s: float
    descent_m_s: float
    accel_m_s2: float
    accel_z_m_s2: float
    p_xy: float
    p_z: float
    yaw_rate_rad_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Tuning:
    """Lengths in metres, heights above home, times in seconds, speeds in m/s.

    `return_height_m` gives the height of the return path from a distance and a height.
    `landing_m_s` gives the descent rate of a landing from the present limits and a height.
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


def sqrt_controller(error: float, p_1_s: float, accel_m_s2: float) -> float:
    """Return the speed at which to approach over `error >= 0` metres and still stop.

    It is proportional near the target, with constant deceleration further out.

    >>> sqrt_controller(1.0, p_1_s=1.0, accel_m_s2=2.0)
    1.0
    >>> sqrt_controller(9.0, p_1_s=1.0, accel_m_s2=2.0)
    5.656854249492381
    """
    linear_m = accel_m_s2 / (p_1_s * p_1_s)
    if error <= linear_m:
        return p_1_s * error
    return math.sqrt(2.0 * accel_m_s2 * (error - 0.5 * linear_m))


def held(east: float, north: float, most: float) -> tuple[float, float]:
    """Limit the length of a vector."""
    length = math.hypot(east, north)
    if length <= most:
        return east, north
    return east * most / length, north * most / length


def _within(value: float, most: float) -> float:
    return most if value > most else -most if value < -most else value


@dataclass(slots=True)
class Estimate:
    """Position and velocity by the autopilot: metres and m/s (east, north, up)."""

    east: float = 0.0
    north: float = 0.0
    up: float = 0.0
    v_east: float = 0.0
    v_north: float = 0.0
    v_up: float = 0.0

    @property
    def place(self) -> tuple[float, float, float]:
        """East, north and up."""
        return self.east, self.north, self.up


class Controller:
    """State of the loops between two steps."""

    def __init__(self) -> None:
        self.yaw_target: float | None = None
        self.reset()

    def reset(self) -> None:
        """Forget all wanted motion: it is on the ground."""
        self._ref_east = self._ref_north = self._ref_up = 0.0
        self._wind_east = self._wind_north = 0.0
        self.yaw_target = None

    def velocity_towards(
        self, east_m: float, north_m: float, limits: Limits
    ) -> tuple[float, float]:
        """Return the horizontal velocity towards a target (east, north) metres away."""
        distance = math.hypot(east_m, north_m)
        if distance < 1e-6:
            return 0.0, 0.0
        braking = _BRAKING_SHARE * limits.accel_m_s2
        speed = min(limits.speed_m_s, sqrt_controller(distance, limits.p_xy, braking))
        return east_m / distance * speed, north_m / distance * speed

    def climb_towards(self, up_m: float, limits: Limits) -> float:
        """Return the climb rate towards a target `up_m` higher."""
        speed = sqrt_controller(abs(up_m), limits.p_z, 0.7 * limits.accel_z_m_s2)
        return min(limits.climb_m_s, speed) if up_m >= 0.0 else -min(limits.descent_m_s, speed)

    def command(
        self,
        now: Estimate,
        body: Body,
        velocity: tuple[float, float],
        climb_m_s: float,
        limits: Limits,
        dt_s: float,
        wind_tau_s: float = WIND_TAU_S,
    ) -> Command:
        """Return thrust and turn rate for a wanted velocity; `body` gives what an IMU measures.

        The loop compensates the force of the air after some `wind_tau_s`.
        """
        east, north, up = self._ref_east, self._ref_north, self._ref_up
        d_east, d_north = velocity[0] - east, velocity[1] - north
        step = math.hypot(d_east, d_north)
        room = limits.accel_m_s2 * dt_s
        if step > room:
            d_east *= room / step
            d_north *= room / step
        d_up = _within(climb_m_s - up, limits.accel_z_m_s2 * dt_s)
        self._ref_east, self._ref_north, self._ref_up = east, north, up = (
            east + d_east, north + d_north, up + d_up,
        )  # fmt: skip
        learn = -math.expm1(-dt_s / wind_tau_s)
        wind_east, wind_north = self._wind_east, self._wind_north
        self._wind_east = wind_east = wind_east + (body.drag_east - wind_east) * learn
        self._wind_north = wind_north = wind_north + (body.drag_north - wind_north) * learn
        lead = 1.0 / dt_s
        return Command(
            d_east * lead + _VELOCITY_GAIN_1_S * (east - now.v_east) - wind_east,
            d_north * lead + _VELOCITY_GAIN_1_S * (north - now.v_north) - wind_north,
            _within(d_up * lead + _CLIMB_GAIN_1_S * (up - now.v_up), _MAX_VERTICAL_M_S2),
            self._yaw_rate(body.heading, limits),
        )

    def _yaw_rate(self, yaw_rad: float, limits: Limits) -> float:
        if self.yaw_target is None:
            return 0.0
        error = math.remainder(self.yaw_target - yaw_rad, math.tau)
        return _within(_YAW_GAIN_1_S * error, limits.yaw_rate_rad_s)
