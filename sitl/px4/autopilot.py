"""The actions of a PX4: arming and modes, take-off, repositioning, missions, offboard flight."""

from __future__ import annotations

from sitl.body.physics import IDLE, Command
from sitl.copter.aircraft import Aircraft, Device
from sitl.copter.failsafes import CHARGE_CRITICAL, CRITICAL, INFO, WARNING
from sitl.copter.fence import names
from sitl.copter.modes import Phase
from sitl.copter.params import Parameters
from sitl.copter.route import Progress
from sitl.copter.trajectory import DelayedFollower, Setpoint, px4_speed
from sitl.px4.aiding import Ekf2Aiding, HomeCorrection
from sitl.px4.failsafes import Px4Failsafes, Setpoints
from sitl.px4.modes import BY_HAND, LEVEL, UNARMABLE, Px4Mode
from sitl.px4.params import TABLE, Px4Fence, px4_tuning

# A stream of places and velocities at 10 Hz was followed 0.33 s late (0.12 to 0.73 s, 90 % of the
# time), most in the first seconds of a path
_SETPOINT_DELAY_S, _FIRST_DELAY_S = 0.2, 0.7
_LIFTS_OFF_M = 0.3  # height of a setpoint above a vehicle on the ground that lets it take off
_OFFBOARD_CLIMB_M = 1.0
_HOME_SEED = 43

PartialPlace = tuple[float | None, float | None, float | None]
"""East, north, up; None for a free coordinate."""


class Px4Autopilot(Aircraft):
    """A PX4 multicopter."""

    mode: Px4Mode
    failsafes: Px4Failsafes
    aiding: Ekf2Aiding

    tune = staticmethod(px4_tuning)
    speed_law = staticmethod(px4_speed)
    first_item = 0

    def __init__(self, device: Device) -> None:
        parameters = Parameters(TABLE)
        aiding = Ekf2Aiding(device.body, device.error, parameters)
        follower = DelayedFollower(_SETPOINT_DELAY_S, _FIRST_DELAY_S)
        super().__init__(device, parameters, Px4Fence(), aiding, follower)
        parameters.preset("BAT1_CAPACITY", self.battery.capacity_mah)
        parameters.preset("MAV_SYS_ID", device.seed[1])
        self.mode = Px4Mode.HOLD
        self.failsafes = Px4Failsafes()
        self.setpoints = Setpoints()
        self.correction = HomeCorrection((*device.seed, _HOME_SEED), device.quirks.home_moves_m)
        self._after_disarming = self._intended = Px4Mode.HOLD
        self._take_off_to: PartialPlace = (None, None, None)  # asked for with NAV_TAKEOFF
        self._has_flown = False  # since it was armed
        self._climbs_first = False  # a mission that does not begin with a take-off
        self._hangs = False  # its return has nowhere to go
        self._complains_s = 0.0

    # --- what it knows of itself ---------------------------------------------------------------

    @property
    def intended(self) -> Px4Mode:
        """Last requested mode, whatever a failsafe does meanwhile."""
        return self._intended if self.failsafes.engaged else self.mode

    @property
    def in_mission(self) -> bool:
        """True if it is in AUTO.MISSION."""
        return self.mode == Px4Mode.MISSION

    @property
    def position_lost(self) -> bool:
        """True if nothing aids it, or the filter's accuracy has passed COM_POS_FS_EPH."""
        return self.error.unaided or self.position_poor

    @property
    def position_poor(self) -> bool:
        """True if the position by optical flow is worse than COM_POS_FS_EPH; below 0: never."""
        if self.aiding.absolute or not self.error.flow:
            return False
        limit_m = self.parameters["COM_POS_FS_EPH"]
        return 0.0 <= limit_m < self.error.accuracy_m

    @property
    def prearm_ok(self) -> bool:
        """True if the checks before arming pass."""
        return self.prearm_refusal() is None

    def prearm_refusal(self) -> str | None:
        """Return the objection of the checks before arming, or None."""
        if self.body.crashed:
            return "Preflight Fail: crash detected"
        if not self.position_ok:
            return "Preflight Fail: no global position"
        if self.parameters["NAV_DLL_ACT"] > 0.0 and not self.failsafes.is_station_connected(
            self.t_s, self.parameters
        ):
            return "Preflight Fail: No connection to the ground control station"
        if self.battery.empty or self.failsafes.charge_state >= CHARGE_CRITICAL:
            return "Preflight Fail: low battery"
        if self.mode == Px4Mode.OFFBOARD and not self.setpoints.fresh(self.t_s):
            return "Preflight Fail: no offboard signal"
        here = self.estimate.place
        if broken := self.fence.violations(self.parameters, here, here):
            return f"Preflight Fail: outside the geofence ({names(broken)})"
        return None

    # --- arming ---------------------------------------------------------------------------------

    def arm(self, force: bool = False) -> str | None:
        """Start the motors; in Takeoff and Mission it takes off with that."""
        if self.armed:
            return None
        if self.body.crashed or self.battery.empty:
            return f"Arming denied! {self.prearm_refusal()}"
        if not force:
            refusal = self.prearm_refusal() or self._mode_refusal(self.mode)
            if refusal is not None:
                return f"Arming denied! {refusal}"
            if self.mode in UNARMABLE:
                return f"Arming denied! Mode {self.mode.name} prevents arming"
        self._has_flown = False
        self._start_motors("Armed by external command")
        self._begin_mode()
        return None

    def disarm(self, force: bool = False) -> str | None:
        """Stop the motors; in the air only by force, and then it falls."""
        if not self.armed:
            return None
        if self.airborne and not force:
            return "Disarming denied! Not landed"
        self._stop_motors("external command")
        return None

    def _stop_motors(self, why: str) -> None:
        self.armed = self.body.motors_on = False
        self.target = None
        self.stop_stream()
        self._climbs_first = False
        self._take_off_to = (None, None, None)
        self.route.stop()
        self._enter(Phase.LANDED)
        self.failsafes.note_pilot()
        self.send_text(INFO, f"Disarmed by {why}")
        self._change(self._after_disarming)

    # --- modes ----------------------------------------------------------------------------------

    def set_mode(self, mode: Px4Mode) -> str | None:
        """Change the mode for the pilot. Disarmed it takes every mode, but does not arm in some."""
        if self.armed and (reason := self._mode_refusal(mode)) is not None:
            return f"{mode.name} not possible: {reason}"
        self.failsafes.note_pilot()
        if mode not in UNARMABLE:
            self._after_disarming = mode
        if mode != self.mode:
            self._change(mode)
        return None

    def fail_to(self, mode: Px4Mode) -> None:
        """Change the mode for a failsafe; without a position it lands."""
        if not self.position_ok:
            mode = Px4Mode.LAND
        if mode != self.mode:
            self._change(mode)

    def _mode_refusal(self, mode: Px4Mode) -> str | None:
        if mode in BY_HAND and not self.by_hand:
            return "no manual control"
        if mode not in (Px4Mode.LAND, *LEVEL) and not self.position_ok:
            return "no global position"
        if mode == Px4Mode.MISSION and self.route.total == 0:
            return "no valid mission"
        if mode == Px4Mode.OFFBOARD and not self.setpoints.fresh(self.t_s):
            return "no offboard signal"
        return None

    def _change(self, mode: Px4Mode) -> None:
        if mode == self.mode:
            return
        if self.in_mission:
            self.route.stop()
        self.mode = mode
        if not self.failsafes.engaged:
            self._intended = mode
        self._climbs_first = False
        self._leave_mode()
        if self.airborne:
            self._enter(Phase.FLY)
        if self.armed:
            self._begin_mode()

    def _begin_mode(self) -> None:
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

    def take_off(self, place: PartialPlace) -> str | None:
        """Execute NAV_TAKEOFF: up from here, or to a place, to a height or MIS_TAKEOFF_ALT.

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
            self.send_text(WARNING, "Already higher than takeoff altitude")
            return
        self.climb_to(up_m)
        if east is not None and north is not None:
            self.hold = (east, north, self.hold[2])

    @property
    def _usual_take_off_m(self) -> float:
        return self.home[2] + self.parameters.positive("MIS_TAKEOFF_ALT", 0.5, 80.0)

    # --- targets --------------------------------------------------------------------------------

    def reposition(self, place: PartialPlace, yaw_rad: float | None) -> str | None:
        """Execute DO_REPOSITION in Hold; None keeps a coordinate, or the heading.

        In another mode, or on the ground, it has no effect; the returned text is of a fence only.
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
        """Fly to a setpoint of the offboard stream; return False if it is dropped."""
        if self.mode != Px4Mode.OFFBOARD or not self.armed:
            return False
        if self.airborne:
            self.fly_to((east_m, north_m, up_m), self.yaw_goal if yaw_rad is None else yaw_rad)
        elif self.phase == Phase.LANDED and up_m > self.estimate.up + _LIFTS_OFF_M:
            self.climb_to(up_m)
        return True

    def go_along(self, setpoint: Setpoint, yaw_rad: float | None = None) -> bool:
        """Follow a velocity of the offboard stream; on the ground it takes off."""
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
        """Enter Mission, and arm (MISSION_START)."""
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
        """Return in RTL, also as an item of a mission.

        It hangs if the nearest rally point is in a frame of the kind INT (`navigator/rtl.cpp`,
        `setSafepointAsDestination`).
        """
        if self.mode == Px4Mode.RTL:
            self._hangs = self._nearest_return() in self.rally_unknown
            if not self._hangs:
                super().go_home()
        else:
            self._change(Px4Mode.RTL)
            self.route.reset()

    # --- time -----------------------------------------------------------------------------------

    def _watch_failsafes(self) -> None:
        self._correct_home()
        hangs = self._hangs and self.armed and self.mode == Px4Mode.RTL
        if hangs and self.t_s >= self._complains_s:
            self._complains_s = self.t_s + 1.0
            self.send_text(CRITICAL, "RTL: unsupported MAV_FRAME")
        self.failsafes.step(self)

    def _correct_home(self) -> None:
        east, north, up = self.home
        corrected = self.correction.home_up(self.t_s, up, airborne=self.airborne)
        if corrected != up:
            self.home = (east, north, corrected)
            self.home_changed = True

    def set_home(self, east_m: float, north_m: float, up_m: float) -> None:
        """Execute DO_SET_HOME; from then on home stays."""
        super().set_home(east_m, north_m, up_m)
        self.correction.end()

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
        if not self.armed:
            return
        name = "COM_DISARM_LAND" if self._has_flown else "COM_DISARM_PRFLT"
        delay_s = self.parameters[name]
        if delay_s > 0.0 and self.t_s - self._since_s > delay_s:
            if self.in_mission and self.route.progress == Progress.ACTIVE:
                self._after_disarming = Px4Mode.HOLD
            self._stop_motors("landing" if self._has_flown else "auto preflight disarming")
