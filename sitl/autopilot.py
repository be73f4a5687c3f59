"""What an ArduCopter decides: modes, arming, take-off, guided flight, return and landing.

It sees the world through an estimate of its position and moves it through `Body`. It speaks no
MAVLink: requests are method calls that return None or the reason for a refusal.
"""

from __future__ import annotations

import math
from dataclasses import replace

from sitl.battery import Battery
from sitl.control import Controller, Estimate, Limits
from sitl.modes import UNARMABLE, Mode, Phase, landing_speed, return_height
from sitl.params import Parameters
from sitl.physics import IDLE, Body, Command
from sitl.sensors import PositionError

_SPOOL_S = 2.5  # motors up to speed, before the climb
_CONTACT_S = 1.0  # standing for so long counts as landed
_ARRIVED_M = 0.2
_TURN_TO_TARGET_M = 2.0
_PREARM_SHARE = 0.8  # of the time to readiness: the prearm bit goes true before the position
_HOME_SHARE = 0.5

SEVERITY_CRITICAL, SEVERITY_INFO = 2, 6


class Autopilot:
    """One autopilot; `step` moves it on, the methods are what a pilot can ask for."""

    def __init__(
        self,
        body: Body,
        error: PositionError,
        battery: Battery,
        *,
        ready_after_s: float,
        max_speed_m_s: float,
        max_accel_m_s2: float,
    ) -> None:
        self.body = body
        self.error = error
        self.battery = battery
        self.parameters = Parameters()
        self.t_s = 0.0
        self.mode = Mode.STABILIZE
        self.phase = Phase.LANDED
        self.armed = False
        self.estimate = Estimate(body.east, body.north)
        self.home = (body.east, body.north, 0.0)
        self.target: tuple[float, float, float] | None = None
        self.velocity_target: tuple[float, float, float] | None = None
        self.texts: list[tuple[int, str]] = []
        self.mode_changed = False
        self.home_changed = False
        self._ready_after_s = ready_after_s
        self._airframe = (max_speed_m_s, max_accel_m_s2)
        self._limits = Limits.of(self.parameters, *self._airframe)
        self._speeds: dict[str, float] = {}
        self._limits_version = 0
        self._control = Controller()
        self._since_s = 0.0  # when the present phase began
        self._contact_s = 0.0
        self._velocity_until_s = 0.0
        self._hold = (body.east, body.north, 0.0)
        self._home_known = False

    # --- what it knows of itself ---------------------------------------------------------------

    @property
    def prearm_ok(self) -> bool:
        """The prearm bit of SYS_STATUS."""
        return self.t_s >= _PREARM_SHARE * self._ready_after_s and not self.body.crashed

    @property
    def position_ok(self) -> bool:
        """The navigation filter has an absolute position."""
        return self.t_s >= self._ready_after_s

    @property
    def home_known(self) -> bool:
        """Satellite navigation has a fix and home is set."""
        return self._home_known

    @property
    def airborne(self) -> bool:
        """Off the ground, as the autopilot sees it."""
        return self.phase not in (Phase.LANDED, Phase.SPOOL)

    # --- what can be asked for ------------------------------------------------------------------

    def arm(self, force: bool = False) -> str | None:
        """Start the motors; the reason for a refusal, or None."""
        if self.armed:
            return None
        if self.body.crashed:
            return "Arm: Crash detected"
        if self.battery.empty:
            return "Arm: Battery 1 low voltage failsafe"
        if not force:
            if not self.prearm_ok:
                return "PreArm: Gyros still settling"
            if not self.position_ok:
                return "PreArm: Need Position Estimate"
        if self.mode in UNARMABLE:
            return f"Arm: {self.mode.name} mode not armable"
        self.armed = self.body.motors_on = True
        self.home = (self.estimate.east, self.estimate.north, self.estimate.up)
        self.home_changed = True
        self._control.reset()
        self._enter(Phase.LANDED)
        self.texts.append((SEVERITY_INFO, "Arming motors"))
        return None

    def disarm(self, force: bool = False) -> str | None:
        """Stop the motors; in the air only by force, and then it falls."""
        if not self.armed:
            return None
        if self.airborne and not force:
            return "Disarm: vehicle is flying"
        self.armed = self.body.motors_on = False
        self.target = self.velocity_target = None
        self._enter(Phase.LANDED)
        self.texts.append((SEVERITY_INFO, "Disarming motors"))
        return None

    def set_mode(self, mode: Mode) -> str | None:
        """Change the mode; the heartbeat tells at once."""
        if mode == self.mode:
            return None
        failed = f"Mode change to {mode.name} failed: "
        if mode == Mode.AUTO:
            return failed + "no mission"
        if mode == Mode.STABILIZE and self.airborne:
            return failed + "no radio control"
        if mode not in (Mode.STABILIZE, Mode.LAND) and not self.position_ok:
            return failed + "requires position"
        self.mode = mode
        self.mode_changed = True
        self.target = self.velocity_target = None
        self._speeds.clear()
        self._limits_version = -1
        if self.phase == Phase.SPOOL:
            self._enter(Phase.LANDED)
        if self.airborne:
            self._control.yaw_target = None
            self._hold = self._stopping_point()
            if mode == Mode.LAND:
                self._enter(Phase.DESCEND)
            elif mode == Mode.RTL:
                self._begin_return()
            else:
                self._enter(Phase.FLY)
        return None

    def take_off(self, height_m: float) -> str | None:
        """Climb to `height_m` above home, in GUIDED and armed."""
        if self.mode != Mode.GUIDED or not self.armed or self.airborne or not height_m > 0.0:
            return "Takeoff refused"
        self._hold = (self.estimate.east, self.estimate.north, self.home[2] + height_m)
        if self.phase != Phase.SPOOL:
            self._enter(Phase.SPOOL)
        return None

    def go_to(
        self, east_m: float, north_m: float, up_m: float, yaw_rad: float | None = None
    ) -> bool:
        """A guided target; False when it is dropped (not GUIDED, not flying)."""
        if self.mode != Mode.GUIDED or not self.airborne:
            return False
        east, north = east_m - self.estimate.east, north_m - self.estimate.north
        if yaw_rad is not None:
            self._control.yaw_target = yaw_rad
        elif (
            math.hypot(east, north) > _TURN_TO_TARGET_M and self.parameters["WP_YAW_BEHAVIOR"] != 0
        ):
            self._control.yaw_target = math.atan2(east, north)
        self.target = self._hold = (east_m, north_m, up_m)
        self.velocity_target = None
        if self.phase == Phase.CLIMB:
            self._enter(Phase.FLY)
        return True

    def go_with(self, v_east: float, v_north: float, v_up: float) -> bool:
        """A guided velocity, m/s, kept for GUID_TIMEOUT; False when it is dropped."""
        if self.mode != Mode.GUIDED or not self.airborne:
            return False
        self.velocity_target = (v_east, v_north, v_up)
        self.target = None
        self._velocity_until_s = self.t_s + self.parameters["GUID_TIMEOUT"]
        if self.phase == Phase.CLIMB:
            self._enter(Phase.FLY)
        return True

    def set_speed(self, kind: str, speed_m_s: float) -> None:
        """Change "speed_m_s", "climb_m_s" or "descent_m_s" until the mode changes."""
        high = self._airframe[0] if kind == "speed_m_s" else 5.0
        self._speeds[kind] = max(0.1, min(high, speed_m_s))
        self._limits_version = -1

    def turn_to(self, yaw_rad: float) -> bool:
        """Turn the nose to a true bearing, flying in GUIDED."""
        if self.mode != Mode.GUIDED or not self.airborne:
            return False
        self._control.yaw_target = yaw_rad
        return True

    @property
    def yaw_goal(self) -> float:
        """The bearing that the nose is to have."""
        goal = self._control.yaw_target
        return self.body.yaw if goal is None else goal

    # --- time -----------------------------------------------------------------------------------

    def step(self, wind: tuple[float, float], dt_s: float) -> None:
        """One step of estimate, decision, control, physics and battery."""
        self.t_s += dt_s
        if not self._home_known and self.t_s >= _HOME_SHARE * self._ready_after_s:
            self._home_known = self.home_changed = True
        self.error.step(dt_s)
        self._look()
        if self.body.motors_on and self.battery.empty:
            self.body.motors_on = False
            self.texts.append((SEVERITY_CRITICAL, "Battery 1 is empty"))
        command = self._decide(dt_s)
        self.body.step(command, wind, dt_s)
        if self.armed and not self.body.motors_on and self.body.on_ground:
            self.disarm(force=True)

    def _look(self) -> None:
        body, error, now = self.body, self.error, self.estimate
        now.east, now.north = body.east + error.east, body.north + error.north
        now.up = body.up + error.up
        now.v_east, now.v_north = body.v_east + error.v_east, body.v_north + error.v_north
        now.v_up = body.v_up + error.v_up

    def _decide(self, dt_s: float) -> Command:
        phase = self.phase
        if phase == Phase.LANDED:
            if self.armed and (
                self.mode in (Mode.RTL, Mode.LAND)
                or self.t_s - self._since_s > self.parameters["DISARM_DELAY"]
            ):
                self.disarm()
            return IDLE
        if phase == Phase.SPOOL:
            if self.t_s - self._since_s < _SPOOL_S:
                return IDLE
            self._enter(Phase.CLIMB)
        self._contact_s = self._contact_s + dt_s if self.body.on_ground else 0.0
        if self._contact_s >= _CONTACT_S and phase not in (Phase.SPOOL, Phase.CLIMB):
            self._enter(Phase.LANDED)
            self._control.reset()
            return IDLE
        self._advance()
        return self._fly(dt_s)

    def _advance(self) -> None:
        """Phases that follow one another by themselves."""
        now, phase = self.estimate, self.phase
        high_enough = abs(now.up - self._hold[2]) < _ARRIVED_M
        if phase == Phase.CLIMB and high_enough:
            self._enter(Phase.FLY)
        elif phase == Phase.RTL_CLIMB and high_enough:
            self._hold = (self.home[0], self.home[1], self._hold[2])
            self._enter(Phase.RTL_RETURN)
        elif phase == Phase.RTL_RETURN:
            away = math.hypot(now.east - self._hold[0], now.north - self._hold[1])
            if away < 2 * _ARRIVED_M:
                self._enter(Phase.RTL_HOLD)
        elif phase == Phase.RTL_HOLD:
            if self.t_s - self._since_s >= self.parameters["RTL_LOIT_TIME"] / 1000.0:
                self._enter(Phase.DESCEND)
        elif self.velocity_target is not None and self.t_s >= self._velocity_until_s:
            self.velocity_target = None
            self._hold = self._stopping_point()

    def _fly(self, dt_s: float) -> Command:
        if self._limits_version != self.parameters.version:
            self._refresh_limits()
        now, limits, hold = self.estimate, self._limits, self._hold
        if self.velocity_target is not None:
            v_east, v_north, climb = self.velocity_target
            scale = min(1.0, limits.speed_m_s / max(1e-9, math.hypot(v_east, v_north)))
            velocity = (v_east * scale, v_north * scale)
            climb = max(-limits.descent_m_s, min(limits.climb_m_s, climb))
        else:
            velocity = self._control.velocity_towards(
                hold[0] - now.east, hold[1] - now.north, limits
            )
            climb = self._control.climb_towards(hold[2] - now.up, limits)
        if self.phase == Phase.DESCEND:
            climb = -landing_speed(self.parameters, limits, now.up - self.home[2])
        elif self.mode == Mode.LOITER:
            climb = -limits.descent_m_s  # no radio control: its throttle reads zero
        return self._control.command(now, self.body, velocity, climb, limits, dt_s)

    def _refresh_limits(self) -> None:
        self._limits = replace(Limits.of(self.parameters, *self._airframe), **self._speeds)
        self._limits_version = self.parameters.version

    def _stopping_point(self) -> tuple[float, float, float]:
        now = self.estimate
        lag_s = math.hypot(now.v_east, now.v_north) / (2.0 * self._limits.accel_m_s2) + 0.3
        up = now.up + now.v_up * abs(now.v_up) / (2.0 * self._limits.accel_z_m_s2)
        return now.east + now.v_east * lag_s, now.north + now.v_north * lag_s, up

    def _begin_return(self) -> None:
        east, north, up = self._hold
        away = math.hypot(east - self.home[0], north - self.home[1])
        height = return_height(self.parameters, away, up - self.home[2])
        self._hold = (east, north, self.home[2] + height)
        self._enter(Phase.RTL_CLIMB)

    def _enter(self, phase: Phase) -> None:
        self.phase = phase
        self._since_s = self.t_s
        self._contact_s = 0.0
