"""What a PX4 decides: modes, arming, take-off, repositioning, missions, offboard flight."""

from __future__ import annotations

from sitl.aircraft import SEVERITY_INFO, Aircraft
from sitl.battery import Battery
from sitl.fence import names
from sitl.items import Item
from sitl.modes import Phase
from sitl.params import Parameters
from sitl.physics import IDLE, Body, Command
from sitl.px4.failsafes import CRITICAL, Px4Failsafes
from sitl.px4.fence import Px4Fence
from sitl.px4.modes import BY_HAND, UNARMABLE, Px4Mode
from sitl.px4.offboard import Setpoints
from sitl.px4.params import TABLE
from sitl.px4.tuning import Px4Tuning
from sitl.route import Progress
from sitl.sensors import PositionError

SEVERITY_WARNING = 4
_LIFTS_OFF_M = 0.3  # a setpoint so far above a vehicle on the ground lets it take off
_OFFBOARD_CLIMB_M = 1.0

Wish = tuple[float | None, float | None, float | None]
"""East, north, up; None where it is left open."""


class Px4Autopilot(Aircraft):
    """A PX4 multicopter."""

    mode: Px4Mode
    failsafes: Px4Failsafes

    def __init__(
        self,
        body: Body,
        error: PositionError,
        battery: Battery,
        *,
        system_id: int,
        ready_after_s: float,
        max_speed_m_s: float,
        max_accel_m_s2: float,
    ) -> None:
        parameters = Parameters(TABLE)
        super().__init__(
            body,
            error,
            battery,
            parameters,
            Px4Tuning(parameters),
            Px4Fence(),
            first_item=0,
            ready_after_s=ready_after_s,
            max_speed_m_s=max_speed_m_s,
            max_accel_m_s2=max_accel_m_s2,
        )
        parameters.preset("BAT1_CAPACITY", battery.capacity_mah)
        parameters.preset("MAV_SYS_ID", system_id)
        self.mode = Px4Mode.HOLD
        self.failsafes = Px4Failsafes()
        self.setpoints = Setpoints()
        self._after_disarming = Px4Mode.HOLD
        self._take_off_to: Wish = (None, None, None)  # asked for with NAV_TAKEOFF
        self._has_flown = False  # since it was armed
        self._climbs_first = False  # a mission that does not begin with a take-off

    # --- what it knows of itself ---------------------------------------------------------------

    @property
    def in_mission(self) -> bool:
        """AUTO.MISSION."""
        return self.mode == Px4Mode.MISSION

    @property
    def prearm_ok(self) -> bool:
        """The prearm bit of SYS_STATUS: the checks pass."""
        return self.prearm_refusal() is None

    def prearm_refusal(self) -> str | None:
        """What the checks before arming object to, or None."""
        if self.body.crashed:
            return "Preflight Fail: crash detected"
        if not self.position_ok:
            return "Preflight Fail: no global position"
        if self.battery.empty or self.failsafes.charge_state >= CRITICAL:
            return "Preflight Fail: low battery"
        now = self.estimate
        here = (now.east, now.north, now.up)
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
        self.armed = self.body.motors_on = True
        self._has_flown = False
        self.home = (self.estimate.east, self.estimate.north, self.estimate.up)
        self.home_changed = True
        self._control.reset()
        self._enter(Phase.LANDED)
        self.say(SEVERITY_INFO, "Armed by external command")
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
        self.target = self.velocity_target = None
        self._climbs_first = False
        self._take_off_to = (None, None, None)
        self.route.stop()
        self._enter(Phase.LANDED)
        self.failsafes.taken_over()
        self.say(SEVERITY_INFO, f"Disarmed by {why}")
        self._change(self._after_disarming)

    # --- modes ----------------------------------------------------------------------------------

    def set_mode(self, mode: Px4Mode) -> str | None:
        """The pilot's wish. Disarmed every mode can be chosen, and arming looks at it."""
        if self.armed and (reason := self._mode_refusal(mode)) is not None:
            return f"{mode.name} not possible: {reason}"
        self.failsafes.taken_over()
        if mode not in UNARMABLE:
            self._after_disarming = mode
        if mode != self.mode:
            self._change(mode)
        return None

    def fail_to(self, mode: Px4Mode) -> None:
        """A failsafe's; without a position it comes down where it is."""
        if not self.position_ok:
            mode = Px4Mode.LAND
        if mode != self.mode:
            self._change(mode)

    def _mode_refusal(self, mode: Px4Mode) -> str | None:
        if mode in BY_HAND:
            return "no manual control"
        if mode != Px4Mode.LAND and not self.position_ok:
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
        self.mode_changed = True
        self.target = self.velocity_target = None
        self._climbs_first = False
        self._speeds.clear()
        self._limits_version = -1
        if self.phase == Phase.SPOOL:
            self._enter(Phase.LANDED)
        if self.airborne:
            self._control.yaw_target = None
            self.hold = self._stopping_point()
            self._enter(Phase.FLY)
        if self.armed:
            self._begin_mode()

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
            self.say(SEVERITY_WARNING, "Already higher than takeoff altitude")
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

    def go_with(self, v_east: float, v_north: float, v_up: float) -> bool:
        """A velocity of the offboard stream, m/s; False when it is dropped."""
        if self.mode != Px4Mode.OFFBOARD or not self.armed:
            return False
        if not self.airborne:
            if self.phase == Phase.LANDED and v_up > 0.0:
                self.climb_to(self.estimate.up + _OFFBOARD_CLIMB_M)
            return True
        self.velocity_target = (v_east, v_north, v_up)
        self.target = None
        self._velocity_until_s = self.t_s + self.parameters["COM_OF_LOSS_T"]
        if self.phase == Phase.CLIMB:
            self._enter(Phase.FLY)
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
        """A mission's return is the mode's."""
        if self.mode == Px4Mode.RTL:
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
        self.failsafes.step(self)

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
        return self._fly(dt_s, position=self.position_ok)

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
