"""What a PX4 flies: take-off, repositioning, missions, offboard flight."""

from __future__ import annotations

import math

from sitl.body.physics import IDLE, Command
from sitl.copter.aircraft import SEVERITY_CRITICAL
from sitl.copter.mission_items import Item
from sitl.copter.modes import Phase
from sitl.copter.route import Progress
from sitl.copter.trajectory import Setpoint
from sitl.px4.commander import LASTS_S, Commander, Wish
from sitl.px4.modes import LEVEL, Px4Mode

_WARNING = 4
_LIFTS_OFF_M = 0.3  # a setpoint so far above a vehicle on the ground lets it take off
_OFFBOARD_CLIMB_M = 1.0


class Px4Autopilot(Commander):
    """A PX4 multicopter."""

    def _begin_mode(self) -> None:
        """What the mode does of itself, armed."""
        mode = self.mode
        if mode == Px4Mode.TAKEOFF:
            self._begin_take_off()
        elif mode == Px4Mode.MISSION:
            self._begin_mission()
        elif self.airborne and mode == Px4Mode.LAND:
            self.land()
        elif self.airborne and mode == Px4Mode.RTL:
            self.go_home()

    # --- take-off -------------------------------------------------------------------------------

    def take_off(self, place: Wish) -> str | None:
        """NAV_TAKEOFF: up from here, or to a place, to a height or MIS_TAKEOFF_ALT.

        Arming may come later.
        """
        if self.armed and (reason := self._mode_refusal(Px4Mode.TAKEOFF)) is not None:
            return f"Takeoff denied! {reason}"
        self._take_off_to = place
        if self.mode != Px4Mode.TAKEOFF:
            self.set_mode(Px4Mode.TAKEOFF)
        elif self.armed and not self.airborne:
            self._begin_take_off()
        return None

    def _begin_take_off(self) -> None:
        self.set_speed("climb_m_s", self.parameters.positive("MPC_TKO_SPEED", 0.5, 5.0))
        (east, north, up_m), self._take_off_to = self._take_off_to, (None, None, None)
        if up_m is None:
            up_m = self._usual_take_off_m
        if up_m <= self.estimate.up:
            self.say(_WARNING, "Already higher than takeoff altitude")
            return
        self.climb_to(up_m)
        if east is not None and north is not None:
            self.hold = (east, north, self.hold[2])

    @property
    def _usual_take_off_m(self) -> float:
        return self.home[2] + self.parameters.positive("MIS_TAKEOFF_ALT", 0.5, 80.0)

    # --- targets --------------------------------------------------------------------------------

    def reposition(self, place: Wish, yaw_rad: float | None) -> str | None:
        """DO_REPOSITION in Hold; None leaves a coordinate, or the heading, as it is.

        In another mode, or on the ground, nothing comes of it; the text is for a fence only.
        """
        if self.mode != Px4Mode.HOLD or not self.airborne:
            return None
        east, north, up = (
            old if new is None else new for new, old in zip(place, self.hold, strict=True)
        )
        if self.fence.violations(self.parameters, self.home, (east, north, up)):
            return "Reposition is outside geofence"
        self.fly_to((east, north, up), self.yaw_goal if yaw_rad is None else yaw_rad)
        return None

    def go_to(
        self, east_m: float, north_m: float, up_m: float, yaw_rad: float | None = None
    ) -> bool:
        """A setpoint of the offboard stream; False when it is dropped (another mode, disarmed)."""
        if self.mode != Px4Mode.OFFBOARD or not self.armed:
            return False
        if self.airborne:
            self.fly_to((east_m, north_m, up_m), self.yaw_goal if yaw_rad is None else yaw_rad)
        elif self.phase == Phase.LANDED and up_m > self.estimate.up + _LIFTS_OFF_M:
            self.climb_to(up_m)
        return True

    def go_along(self, setpoint: Setpoint, yaw_rad: float | None = None) -> bool:
        """A velocity of the offboard stream, with or without a place; on the ground it starts."""
        place, velocity = setpoint
        if place is not None and not self.airborne:
            return self.go_to(*place, yaw_rad)
        if self.mode != Px4Mode.OFFBOARD or not self.armed:
            return False
        if not self.airborne:
            if self.phase == Phase.LANDED and velocity[2] > 0.0:
                self.climb_to(self.estimate.up + _OFFBOARD_CLIMB_M)
            return True
        if place is not None and yaw_rad is None:
            yaw_rad = self.yaw_goal
        self.follow(setpoint, self.t_s + self.parameters["COM_OF_LOSS_T"], yaw_rad)
        return True

    # --- missions -------------------------------------------------------------------------------

    def start_mission(self) -> str | None:
        """MISSION_START: into Mission, and armed."""
        if self.route.total == 0:
            return "Mission start denied! No valid mission"
        return self.set_mode(Px4Mode.MISSION) or self.arm()

    def _begin_mission(self) -> None:
        if self.airborne or self.route.begins_with_takeoff:
            self.route.begin(self)
            return
        self._climbs_first = True
        self.climb_to(self._usual_take_off_m)

    def mission_done(self) -> None:
        """Hold; on the ground the motors stop soon."""
        self.route.reset()
        self._after_disarming = Px4Mode.HOLD
        self._change(Px4Mode.HOLD)

    def go_home(self) -> None:
        """A mission's return is the mode's.

        It hangs where the nearest rally point is in a frame of the kind INT (`navigator/rtl.cpp`,
        `setSafepointAsDestination`).
        """
        if self.mode == Px4Mode.RTL:
            self._hangs = self._nearest_return() in self.rally_unknown
            if not self._hangs:
                super().go_home()
        else:
            self._change(Px4Mode.RTL)
            self.route.reset()

    def enable_fence(self, on: bool) -> None:
        """Without effect: GF_ACTION says whether there is one."""

    def count_items(self, kind: int, items: list[Item]) -> None:
        """No parameter counts them."""

    # --- time -----------------------------------------------------------------------------------

    def _watch_failsafes(self) -> None:
        self._correct_home()
        hangs = self._hangs and self.armed and self.mode == Px4Mode.RTL
        if hangs and self.t_s >= self._complains_s:
            self._complains_s = self.t_s + 1.0
            self.say(SEVERITY_CRITICAL, "RTL: unsupported MAV_FRAME")
        self.failsafes.step(self)

    def _correct_home(self) -> None:
        """For a while after take-off the height of home follows a better estimate of it."""
        if not self.airborne:
            self._flies_since_s = None
            return
        if self._flies_since_s is None:
            self._flies_since_s, self._home_up = self.t_s, self.home[2]
        up = self._home_up + self.correction.height_m(self.t_s - self._flies_since_s)
        if up != self.home[2] and self.t_s - self._flies_since_s <= LASTS_S:
            self.home = (self.home[0], self.home[1], up)
            self.home_changed = True

    def set_home(self, east_m: float, north_m: float, up_m: float) -> None:
        """DO_SET_HOME: from then on it stays."""
        super().set_home(east_m, north_m, up_m)
        self._home_up = up_m
        self._flies_since_s = -math.inf

    def _decide(self, dt_s: float) -> Command:
        if self.in_mission and self.armed:
            if self._climbs_first and self.phase == Phase.FLY:
                self._climbs_first = False
                self.route.begin(self)
            self.route.step(self)
        if self.phase == Phase.LANDED:
            self._disarm_in_time()
            return IDLE
        if not self._pass_phases(dt_s):
            return IDLE
        self._has_flown = self._has_flown or self.airborne
        if self.mode == Px4Mode.TAKEOFF and self.phase == Phase.FLY:
            follows = self.parameters["COM_TAKEOFF_ACT"] == 1.0 and self.route.total > 0
            self._after_disarming = Px4Mode.MISSION if follows else Px4Mode.HOLD
            reached = self.hold
            self._change(self._after_disarming)
            if not follows:
                self.hold = reached
        return self._fly(dt_s, position=self.position_ok and self.mode not in LEVEL)

    def _disarm_in_time(self) -> None:
        """After a landing, or when nothing comes of arming."""
        if not self.armed:
            return
        name = "COM_DISARM_LAND" if self._has_flown else "COM_DISARM_PRFLT"
        delay_s = self.parameters[name]
        if delay_s > 0.0 and self.t_s - self._since_s > delay_s:
            if self.in_mission and self.route.progress == Progress.ACTIVE:
                self._after_disarming = Px4Mode.HOLD
            self._stop_motors("landing" if self._has_flown else "auto preflight disarming")
