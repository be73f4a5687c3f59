"""From a decision to motion: phases of a flight, speeds, the hold position."""

from __future__ import annotations

import math
from dataclasses import replace
from enum import IntEnum
from typing import ClassVar, NamedTuple

from sitl.body.physics import Body, Command
from sitl.copter.control import WIND_TAU_S, Controller, Estimate, Tuning
from sitl.copter.fence import Place
from sitl.copter.modes import Mode, Phase
from sitl.copter.params import Parameters
from sitl.copter.trajectory import Follower, Setpoint, Shaper, shaping_jerk

_SPOOL_S = 2.5  # motors up to speed, before the climb
_CONTACT_S = 1.0  # time on the ground that counts as landed
_ARRIVED_M = 0.2
_TURN_TO_TARGET_M = 2.0
_CHASE_SHARE = 2.0

# looking up a member in its class costs more than its use here
_LANDED, _SPOOL, _CLIMB, _FLY = Phase.LANDED, Phase.SPOOL, Phase.CLIMB, Phase.FLY
_RTL_CLIMB, _RTL_RETURN, _RTL_HOLD = Phase.RTL_CLIMB, Phase.RTL_RETURN, Phase.RTL_HOLD
_DESCEND = Phase.DESCEND
_BY_THROTTLE = (Mode.LOITER, Mode.POSHOLD, Mode.ALT_HOLD)
_STANDING = (_LANDED, _SPOOL)


class Airframe(NamedTuple):
    """Limits of the airframe, whatever the parameters: m/s, m/s^2, s from boot.

    `stick`: the pilot's radio control is on.
    """

    max_speed_m_s: float
    max_accel_m_s2: float
    ready_after_s: float
    stick: bool


class Motion:
    """The present motion; the autopilot on top of it decides."""

    tune: ClassVar[staticmethod[[Parameters], Tuning]]
    """The parameters as one record."""
    speed_law: ClassVar[staticmethod[[float, float, float], float]]
    mode: IntEnum

    def __init__(
        self, body: Body, airframe: Airframe, parameters: Parameters, follower: Follower
    ) -> None:
        self.body = body
        self.parameters = parameters
        self.t_s = 0.0
        self.phase = Phase.LANDED
        self.estimate = Estimate(body.east, body.north, body.up)
        self.home: Place = (body.east, body.north, body.up)
        self.rally: tuple[Place, ...] = ()
        self.rally_unknown: frozenset[Place] = frozenset()
        """Rally points in a frame that a return does not support."""
        self.target: Place | None = None
        self.stream: Setpoint | None = None
        self.hold: Place = self.home
        self.radio_lost = False  # set by a fault
        self._airframe = airframe
        self._tuned_version = -1
        self._speeds: dict[str, float] = {}
        self._refresh_limits()
        self._control = Controller()
        self._shaper = Shaper(self.speed_law)
        self._since_s = 0.0  # when the present phase began
        self._contact_s = 0.0
        self._follower = follower
        self._stream_until_s = 0.0
        self._return_to = self.home

    @property
    def tuning(self) -> Tuning:
        """Present parameters."""
        if self._tuned_version != self.parameters.version:
            self._tuned_version = self.parameters.version
            self._tuning = self.tune(self.parameters)
        return self._tuning

    @property
    def airborne(self) -> bool:
        """True if it is off the ground by its own estimate."""
        return self.phase not in _STANDING

    @property
    def by_hand(self) -> bool:
        """True if the pilot's radio control is on; its sticks are centred."""
        return self._airframe.stick and not self.radio_lost

    @property
    def yaw_goal(self) -> float:
        """Commanded bearing of the nose."""
        goal = self._control.yaw_target
        return self.body.heading if goal is None else goal

    @property
    def turned(self) -> bool:
        """True if the nose is within 2 degrees of its bearing."""
        return abs(math.remainder(self.yaw_goal - self.body.heading, math.tau)) < math.radians(2.0)

    def distance_to(self, place: Place) -> float:
        """Return the metres between the estimate and a place."""
        return math.dist(self.estimate.place, place)

    # --- what can be flown ----------------------------------------------------------------------

    def climb_to(self, up_m: float) -> None:
        """Take off, or climb from the present position, to a height over the plane."""
        if self.airborne:
            east, north, up = self._stopping_point()
            self.hold = (east, north, max(up_m, up))
            self._enter(_CLIMB)
            return
        self.hold = (self.estimate.east, self.estimate.north, up_m)
        if self.phase is not _SPOOL:
            self._enter(_SPOOL)

    def fly_to(self, place: Place, yaw_rad: float | None = None) -> None:
        """Fly to a place and stay; the nose turns to a far one."""
        east, north = place[0] - self.estimate.east, place[1] - self.estimate.north
        if yaw_rad is not None:
            self._control.yaw_target = yaw_rad
        elif math.hypot(east, north) > _TURN_TO_TARGET_M and self.tuning.turns_nose:
            self._control.yaw_target = math.atan2(east, north)
        self.stop_stream()
        self.target = self.hold = place
        if self.airborne and self.phase is not _FLY:
            self._enter(_FLY)

    def follow(self, setpoint: Setpoint, until_s: float, yaw_rad: float | None = None) -> None:
        """Fly a setpoint of a stream; stop after `until_s` without another one."""
        if yaw_rad is not None:
            self._control.yaw_target = yaw_rad
        v_east, v_north, v_up = setpoint.velocity
        scale = min(1.0, self._airframe.max_speed_m_s / max(1e-9, math.hypot(v_east, v_north)))
        setpoint = Setpoint(setpoint.place, (v_east * scale, v_north * scale, v_up))
        if yaw_rad is None and self.tuning.turns_nose and scale * math.hypot(v_east, v_north) > 1.0:
            self._control.yaw_target = math.atan2(v_east, v_north)
        self.target = None
        self.stream, self._stream_until_s = setpoint, until_s
        self._follower.accept(setpoint, self.t_s)
        if self.phase is not _FLY:
            self._enter(_FLY)

    def stop_stream(self) -> None:
        """End the stream of setpoints."""
        if self.stream is not None:
            self.stream = None
            self._follower.stop()

    def stay(self) -> None:
        """Stop here, in the air."""
        self.target = None
        self.stop_stream()
        self.hold = self._stopping_point()
        self._enter(_FLY)

    def land(self) -> None:
        """Descend on the hold position."""
        self.target = None
        if self.airborne:
            self._enter(_DESCEND)

    def go_home(self) -> None:
        """Climb to the return height, fly home or to the nearest rally point, and land."""
        self.target = None
        east, north, up = self.hold
        self._return_to = self._nearest_return()
        away = math.hypot(east - self._return_to[0], north - self._return_to[1])
        height = self.tuning.return_height_m(away, up - self.home[2])
        self.hold = (east, north, max(self.home[2] + height, self._return_to[2]))
        if speed := self.tuning.return_speed_m_s:
            self.set_speed("speed_m_s", speed)
        self._enter(_RTL_CLIMB)

    def face(self, yaw_rad: float) -> None:
        """Turn the nose to a true bearing."""
        self._control.yaw_target = yaw_rad

    def set_speed(self, kind: str, speed_m_s: float) -> None:
        """Change "speed_m_s", "climb_m_s" or "descent_m_s" until the mode changes."""
        high = self._airframe.max_speed_m_s if kind == "speed_m_s" else 5.0
        self._speeds[kind] = max(0.1, min(high, speed_m_s))
        self._limits_version = -1

    # --- inside ---------------------------------------------------------------------------------

    def _nearest_return(self) -> Place:
        now, limit_m = self.estimate, self.tuning.rally_within_m

        def away(place: Place) -> float:
            return math.hypot(place[0] - now.east, place[1] - now.north)

        near = [p for p in self.rally if limit_m <= 0.0 or away(p) <= limit_m]
        if not near or self.tuning.rally_or_home:
            near.append(self.home)
        return min(near, key=away)

    def _pass_phases(self, dt_s: float) -> bool:
        """Pass to the phases that follow by themselves; return False while the motors idle."""
        if self.phase is _SPOOL:
            if self.t_s - self._since_s < _SPOOL_S:
                return False
            self._enter(_CLIMB)
        stands = self.body.on_ground and not self.body.crashed  # a wreck never counts as landed
        self._contact_s = self._contact_s + dt_s if stands else 0.0
        if self._contact_s >= _CONTACT_S and self.phase is not _CLIMB:
            self._enter(_LANDED)
            self._control.reset()
            self._shaper.active = False
            return False
        self._advance()
        return True

    def _advance(self) -> None:
        now, phase = self.estimate, self.phase
        high_enough = abs(now.up - self.hold[2]) < _ARRIVED_M
        if phase is _CLIMB and high_enough:
            self._enter(_FLY)
        elif phase is _RTL_CLIMB and high_enough:
            self.hold = (self._return_to[0], self._return_to[1], self.hold[2])
            self._enter(_RTL_RETURN)
        elif phase is _RTL_RETURN:
            away = math.hypot(now.east - self.hold[0], now.north - self.hold[1])
            if away < 2 * _ARRIVED_M:
                self._enter(_RTL_HOLD)
        elif phase is _RTL_HOLD:
            if self.t_s - self._since_s >= self.tuning.return_hover_s:
                self._end_return()
        elif self.stream is not None and self.t_s >= self._stream_until_s:
            self.stream = Setpoint(self.stream.place, (0.0, 0.0, 0.0))
            self._stream_until_s = math.inf

    def _end_return(self) -> None:
        final_m = self.tuning.return_final_m
        if final_m > 0.0:
            self.hold = (self.hold[0], self.hold[1], self.home[2] + final_m)
            self._enter(_FLY)
        else:
            self._enter(_DESCEND)

    def _fly(self, dt_s: float, *, position: bool) -> Command:
        """Return thrust and turn rate; without a position it keeps level and drifts in the wind."""
        if self._limits_version != self.parameters.version:
            self._refresh_limits()
        now, limits, hold = self.estimate, self._limits, self.hold
        jerk_m_s3 = self.tuning.jerk_m_s3
        if self.stream is not None or jerk_m_s3 <= 0.0 or not position:
            self._shaper.active = False
        if self.stream is not None:
            velocity = self._follower.velocity(self.stream, now, limits, self.t_s, dt_s)
            climb = self.stream.velocity[2]
            if self.stream.place is not None:
                climb += self._control.climb_towards(self.stream.place[2] - now.up, limits)
            climb = max(-limits.descent_m_s, min(limits.climb_m_s, climb))
        else:
            if jerk_m_s3 > 0.0 and position:
                velocity = self._shaper.velocity_towards(
                    (hold[0], hold[1]), now, limits, shaping_jerk(jerk_m_s3), dt_s
                )
            else:
                velocity = self._control.velocity_towards(
                    hold[0] - now.east, hold[1] - now.north, limits
                )
            climb = self._control.climb_towards(hold[2] - now.up, limits)
        if self.phase is _DESCEND:
            climb = -self.tuning.landing_m_s(limits, now.up - self.home[2])
        elif self.mode in _BY_THROTTLE and not self.by_hand:
            climb = -limits.descent_m_s  # no radio control: its throttle reads zero
        chase = self._chase if self._shaper.active or self.stream is not None else limits
        tau_s = WIND_TAU_S if self.stream is None else self._follower.wind_tau_s
        command = self._control.command(now, self.body, velocity, climb, chase, dt_s, tau_s)
        if position:
            return command
        self.hold = (now.east, now.north, hold[2])  # no return to its earlier place
        return command._replace(east_m_s2=0.0, north_m_s2=0.0)

    def _refresh_limits(self) -> None:
        limits = self.tuning.limits
        held: dict[str, float] = {
            "speed_m_s": min(self._airframe.max_speed_m_s, limits.speed_m_s),
            "accel_m_s2": min(self._airframe.max_accel_m_s2, limits.accel_m_s2),
        }
        self._limits = replace(limits, **(held | self._speeds))
        # what follows a shaped path needs more than the path itself uses
        self._chase = replace(self._limits, accel_m_s2=_CHASE_SHARE * self._limits.accel_m_s2)
        self._limits_version = self.parameters.version

    def _stopping_point(self) -> Place:
        now = self.estimate
        up = now.up + now.v_up * abs(now.v_up) / (2.0 * self._limits.accel_z_m_s2)
        if self._shaper.active:
            jerk_m_s3 = shaping_jerk(self.tuning.jerk_m_s3)
            return (*self._shaper.stopping_point(self._limits, jerk_m_s3), up)
        lag_s = math.hypot(now.v_east, now.v_north) / (2.0 * self._limits.accel_m_s2) + 0.3
        return now.east + now.v_east * lag_s, now.north + now.v_north * lag_s, up

    def _enter(self, phase: Phase) -> None:
        self.phase = phase
        self._since_s = self.t_s
        self._contact_s = 0.0
