"""The device: a point mass on a tilting thrust, in moving air, above the ground.

Axes are true east, true north and up, metres from the world's origin. The ground below is level;
over a slope the caller sets its height (`Body.ground`). The body has no messages, modes or targets:
its input is thrust, turn rate and time.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from sitl.body.sensors import AttitudeError

GRAVITY_M_S2 = 9.80665
MAX_STEP_S = 0.05

_TILT_TAU_S = 0.15
_THRUST_TAU_S = 0.1
_YAW_TAU_S = 0.15
# Drag of a small quadcopter: 0.7 m/s^2 (four degrees of tilt) in a wind of 3.6 m/s
_DRAG_LINEAR_1_S = 0.10
_DRAG_QUADRATIC_1_M = 0.025
_SURVIVABLE_IMPACT_M_S = 2.0
# A motor that gives less than this share cannot be made up for: the body tumbles
_CONTROLLABLE_SHARE = 0.5
_FULL_THRUST_M_S2 = 2.0 * GRAVITY_M_S2
_TUMBLE_SINK_M_S2, _TUMBLE_RATE_RAD_S = 0.6 * GRAVITY_M_S2, 10.0


class Command(NamedTuple):
    """The autopilot's command to the motors.

    `east_m_s2`, `north_m_s2`: horizontal thrust, which tilts the body. `up_m_s2`: thrust over
    weight. `yaw_rate_rad_s`: clockwise from above.
    """

    east_m_s2: float
    north_m_s2: float
    up_m_s2: float
    yaw_rate_rad_s: float


IDLE = Command(0.0, 0.0, -GRAVITY_M_S2, 0.0)


class Body:
    """A multicopter's true state, advanced by `step`.

    Semi-implicit Euler: velocities first, positions with the new velocities. All first-order
    lags use their exact decay, so any step up to `MAX_STEP_S` is stable.
    """

    def __init__(
        self,
        east_m: float,
        north_m: float,
        yaw_rad: float,
        max_tilt_rad: float,
        ground_m: float = 0.0,
        attitude_error: AttitudeError | None = None,
    ) -> None:
        self.east, self.north, self.up = east_m, north_m, ground_m
        self.ground = ground_m
        self.v_east = self.v_north = self.v_up = 0.0
        self.thrust_east = self.thrust_north = 0.0
        self.thrust_east_rate = self.thrust_north_rate = 0.0  # m/s^3, in the last step
        self.thrust_up = -GRAVITY_M_S2
        self.drag_east = self.drag_north = 0.0
        self.air_speed_m_s = 0.0
        self.yaw, self.yaw_rate = yaw_rad % math.tau, 0.0
        self.max_tilt_m_s2 = GRAVITY_M_S2 * math.tan(max_tilt_rad)
        self.motors_on = False
        self.on_ground = True
        self.crashed = False
        self.motor_share = 1.0  # of its thrust that the weakest motor gives
        self.compass_rad = 0.0  # what the compass reads too much
        self.attitude_error = attitude_error or AttitudeError([0], 0.0, 0.0)
        self._lag_step_s = 0.0  # the length of step for which the shares of the lags hold
        self._tilt_share = self._thrust_share = self._yaw_share = 0.0

    @property
    def heading(self) -> float:
        """Bearing by the compass, 0 to 2 pi."""
        return (self.yaw + self.off_rad) % math.tau

    @property
    def off_rad(self) -> float:
        """Error of the heading, radians."""
        return self.compass_rad + self.attitude_error.heading

    @property
    def estimated_roll_pitch(self) -> tuple[float, float]:
        """Roll and pitch by the autopilot, radians."""
        roll, pitch = self.roll_pitch
        return roll + self.attitude_error.roll, pitch + self.attitude_error.pitch

    @property
    def roll_pitch(self) -> tuple[float, float]:
        """Roll (right side down) and pitch (nose up), radians, from the thrust's tilt."""
        return _roll_pitch(self.thrust_east, self.thrust_north, self.yaw)

    def turned(self, after_s: float) -> tuple[float, float, float]:
        """Return roll, pitch and yaw a little later at the present rates, radians."""
        yaw = self.yaw + self.yaw_rate * after_s
        east = self.thrust_east + self.thrust_east_rate * after_s
        north = self.thrust_north + self.thrust_north_rate * after_s
        return *_roll_pitch(east, north, yaw), yaw

    def step(self, command: Command, wind: tuple[float, float], dt_s: float) -> None:
        """Advance by `dt_s` (at most `MAX_STEP_S`) in `wind` m/s (east, north)."""
        if not self.motors_on or self.crashed:
            command = IDLE
        elif self.off_rad != 0.0:
            command = self._misled(command)
        if self.motors_on and self.motor_share < 1.0:
            command = self._weakened(command)
        self._turn(command, dt_s)
        if self.on_ground and self.thrust_up <= 0.0:
            # standing: the ground carries and holds it
            self.v_east = self.v_north = self.v_up = 0.0
            self.drag_east = self.drag_north = self.air_speed_m_s = 0.0
            return
        v_east, v_north, v_up = self.v_east, self.v_north, self.v_up
        air_east, air_north = wind[0] - v_east, wind[1] - v_north
        self.air_speed_m_s = air_speed = math.hypot(air_east, air_north)
        drag = _DRAG_LINEAR_1_S + _DRAG_QUADRATIC_1_M * air_speed
        self.drag_east, self.drag_north = drag_east, drag_north = drag * air_east, drag * air_north
        self.v_east = v_east = v_east + (self.thrust_east + drag_east) * dt_s
        self.v_north = v_north = v_north + (self.thrust_north + drag_north) * dt_s
        fall_drag = (_DRAG_LINEAR_1_S + _DRAG_QUADRATIC_1_M * abs(v_up)) * v_up
        self.v_up = v_up = v_up + (self.thrust_up - fall_drag) * dt_s
        self.east += v_east * dt_s
        self.north += v_north * dt_s
        self.up = up = self.up + v_up * dt_s
        if up <= self.ground:
            self._touch()
        else:
            self.on_ground = False

    def _misled(self, command: Command) -> Command:
        sin, cos = math.sin(self.off_rad), math.cos(self.off_rad)
        east, north, up, yaw_rate = command
        return Command(east * cos - north * sin, north * cos + east * sin, up, yaw_rate)

    def _weakened(self, command: Command) -> Command:
        """Limit the thrust to that of a weak motor and its opposite, or let the body tumble."""
        if self.motor_share < _CONTROLLABLE_SHARE:
            tilt = self.max_tilt_m_s2
            return Command(
                tilt * math.sin(self.yaw),
                tilt * math.cos(self.yaw),
                -_TUMBLE_SINK_M_S2,
                _TUMBLE_RATE_RAD_S,
            )
        most = _FULL_THRUST_M_S2 * (1.0 + self.motor_share) / 2.0 - GRAVITY_M_S2
        return command._replace(up_m_s2=min(command.up_m_s2, most))

    def _turn(self, command: Command, dt_s: float) -> None:
        if dt_s != self._lag_step_s:
            self._lag_step_s = dt_s
            self._tilt_share = -math.expm1(-dt_s / _TILT_TAU_S)
            self._thrust_share = -math.expm1(-dt_s / _THRUST_TAU_S)
            self._yaw_share = -math.expm1(-dt_s / _YAW_TAU_S)
        east, north, up, yaw_rate = command
        wanted = math.hypot(east, north)
        if wanted > self.max_tilt_m_s2:
            east *= self.max_tilt_m_s2 / wanted
            north *= self.max_tilt_m_s2 / wanted
        tilt = self._tilt_share
        east_step, north_step = (east - self.thrust_east) * tilt, (north - self.thrust_north) * tilt
        self.thrust_east += east_step
        self.thrust_north += north_step
        self.thrust_east_rate, self.thrust_north_rate = east_step / dt_s, north_step / dt_s
        self.thrust_up += (up - self.thrust_up) * self._thrust_share
        self.yaw_rate += (yaw_rate - self.yaw_rate) * self._yaw_share
        if not (self.on_ground and self.thrust_up <= 0.0):
            self.yaw = (self.yaw + self.yaw_rate * dt_s) % math.tau

    def _touch(self) -> None:
        if self.v_up < -_SURVIVABLE_IMPACT_M_S:
            self.crashed = True
        self.up = self.ground
        self.v_east = self.v_north = self.v_up = 0.0
        self.thrust_east = self.thrust_north = 0.0
        self.thrust_east_rate = self.thrust_north_rate = 0.0
        self.on_ground = True


def _roll_pitch(east_m_s2: float, north_m_s2: float, yaw_rad: float) -> tuple[float, float]:
    """Return the tilt that gives a horizontal thrust."""
    sin_yaw, cos_yaw = math.sin(yaw_rad), math.cos(yaw_rad)
    forward = north_m_s2 * cos_yaw + east_m_s2 * sin_yaw
    right = east_m_s2 * cos_yaw - north_m_s2 * sin_yaw
    pitch = -math.atan2(forward, GRAVITY_M_S2)
    return math.atan2(right * math.cos(pitch), GRAVITY_M_S2), pitch
