"""The decisions of an ArduCopter: modes, arming, take-off, guided flight, missions, failsafes."""

from __future__ import annotations

from sitl.ardupilot.aiding import Ek3Aiding
from sitl.ardupilot.failsafes import ArduPilotFailsafes
from sitl.body.physics import IDLE, Command
from sitl.copter.aircraft import Aircraft, Device
from sitl.copter.failsafes import CRITICAL, INFO
from sitl.copter.fence import Fence, names
from sitl.copter.mission_items import FENCE, MISSION, RALLY, Item
from sitl.copter.modes import LEVEL, UNARMABLE, Mode, Phase
from sitl.copter.params import Parameters, copter_tuning
from sitl.copter.route import Progress
from sitl.copter.trajectory import (
    MAX_JERK_M_S3,
    Setpoint,
    ShapedFollower,
    copter_speed,
    shaping_jerk,
)

_LANDED, _AUTO = Phase.LANDED, Mode.AUTO  # looked up once, not at every step
_ARM_IN_AUTO, _TAKE_OFF_IN_AUTO = 1, 2  # AUTO_OPTIONS
_PREARM_EVERY_S = 30.0  # interval at which a vehicle that cannot arm reports why
_TOTALS = {MISSION: "MIS_TOTAL", FENCE: "FENCE_TOTAL", RALLY: "RALLY_TOTAL"}


class Autopilot(Aircraft):
    """An ArduCopter."""

    mode: Mode
    failsafes: ArduPilotFailsafes

    tune = staticmethod(copter_tuning)
    speed_law = staticmethod(copter_speed)
    first_item = 1

    def __init__(self, device: Device) -> None:
        parameters = Parameters()
        aiding = Ek3Aiding(device.body, device.error, parameters)
        # PSC_JERK_XY of 0 leaves it to what the vehicle can do
        follower = ShapedFollower(lambda: shaping_jerk(parameters["PSC_JERK_XY"] or MAX_JERK_M_S3))
        super().__init__(device, parameters, Fence(), aiding, follower)
        self.mode = Mode.STABILIZE
        self.failsafes = ArduPilotFailsafes()
        self.parameters.preset("BATT_CAPACITY", self.battery.capacity_mah)
        if device.quirks.camera == "autopilot":
            self.parameters.preset("CAM1_TYPE", 1)
        self._next_prearm_s = _PREARM_EVERY_S
        self._mission_started = False  # on the ground, AUTO waits for MISSION_START
        self._submode = ""  # of GUIDED: which kind of target is flown

    @property
    def in_mission(self) -> bool:
        """True if it is in AUTO."""
        return self.mode == Mode.AUTO

    # --- what can be asked for ------------------------------------------------------------------

    def arm(self, force: bool = False) -> str | None:
        """Start the motors; return the reason for a refusal, or None."""
        if self.armed:
            return None
        if (refusal := self._arm_refusal(force)) is not None:
            return refusal
        self._start_motors("Arming motors")
        if self.mode == Mode.AUTO and self._takes_off_in_auto and self.route.begins_with_takeoff:
            self._mission_started = True
            self.route.begin(self)
        return None

    @property
    def _takes_off_in_auto(self) -> bool:
        return bool(int(self.parameters["AUTO_OPTIONS"]) & _TAKE_OFF_IN_AUTO)

    def _arm_refusal(self, force: bool) -> str | None:
        if self.body.crashed:
            return "Arm: Crash detected"
        if self.battery.empty or (self.failsafes.charge_state > 1 and not force):
            return "Arm: Battery 1 low voltage failsafe"
        checks = not force and self.parameters["ARMING_CHECK"] != 0.0
        if checks and (refusal := self.prearm_refusal()) is not None:
            return refusal
        auto = self.mode == Mode.AUTO and int(self.parameters["AUTO_OPTIONS"]) & _ARM_IN_AUTO
        if self.mode in UNARMABLE and not auto:
            return f"Arm: {self.mode.name} mode not armable"
        return None

    def prearm_refusal(self) -> str | None:
        """Return what the checks before arming object to, or None."""
        if not self.prearm_ok:
            return (
                "PreArm: GPS 1: Bad fix" if self.satellites_lost else "PreArm: Gyros still settling"
            )
        if not self.position_ok:
            return "PreArm: Need Position Estimate"
        if self.battery.voltage_v < self.parameters["BATT_ARM_VOLT"]:
            return "PreArm: Battery 1 below minimum arming voltage"
        here = self.estimate.place
        if broken := self.fence.violations(self.parameters, here, here, low=False):
            return f"PreArm: vehicle outside {names(broken)} fence"
        return None

    def disarm(self, force: bool = False) -> str | None:
        """Stop the motors; in the air only by force, and then it falls."""
        if not self.armed:
            return None
        if self.airborne and not force:
            return "Disarm: vehicle is flying"
        self.armed = self.body.motors_on = False
        self.target = None
        self.stop_stream()
        self.route.reset()
        self._mission_started = False
        self._enter(Phase.LANDED)
        self.send_text(INFO, "Disarming motors")
        return None

    def set_mode(self, mode: Mode) -> str | None:
        """Change the mode; the heartbeat reports it at once."""
        if mode == self.mode:
            return None
        if (reason := self._mode_refusal(mode)) is not None:
            return f"Mode change to {mode.name} failed: {reason}"
        if self.mode == Mode.AUTO:
            self.route.stop()
        self.mode = mode
        self._submode = ""
        self._leave_mode()
        if self.airborne:
            if mode == Mode.LAND:
                self.land()
            elif mode == Mode.RTL:
                self.go_home()
            else:
                self._enter(Phase.FLY)
        if mode == Mode.AUTO:
            self._mission_started = self.airborne or self._takes_off_in_auto
            if self._mission_started and self.armed:
                self.route.begin(self)
        return None

    def _mode_refusal(self, mode: Mode) -> str | None:
        if mode == Mode.AUTO and self.route.total == 0:
            return "no mission"
        if mode in LEVEL and self.airborne and not self.by_hand:
            return "no radio control"
        if mode not in (*LEVEL, Mode.LAND) and not self.position_ok:
            return "requires position"
        if mode == Mode.AUTO and self.armed and not self.airborne:
            if self.route.begins_with_takeoff:
                return None
            return "Missing Takeoff Cmd"
        return None

    def start_mission(self) -> str | None:
        """Enter AUTO, and take off (MISSION_START)."""
        if not self.armed:
            return "Mission start: not armed"
        if (refusal := self.set_mode(Mode.AUTO)) is not None:
            return refusal
        if self.route.progress != Progress.ACTIVE:
            if not (self.airborne or self.route.begins_with_takeoff):
                return "Auto: Missing Takeoff Cmd"
            self.route.begin(self)
        self._mission_started = True
        return None

    def pause_mission(self, pause: bool) -> bool:
        """Execute DO_PAUSE_CONTINUE; return False if there is nothing to pause or to resume."""
        if self.mode != Mode.AUTO or not self.airborne:
            return False
        return self.route.pause(self) if pause else self.route.proceed(self)

    def mission_done(self) -> None:
        """Stay here, or stop the motors on the ground."""
        if not self.airborne:
            self.disarm()

    def take_off(self, height_m: float) -> str | None:
        """Climb to `height_m` above home, in GUIDED and armed."""
        if self.mode != Mode.GUIDED or not self.armed or self.airborne or not height_m > 0.0:
            return "Takeoff refused"
        self.climb_to(self.home[2] + height_m)
        return None

    def go_to(
        self, east_m: float, north_m: float, up_m: float, yaw_rad: float | None = None
    ) -> bool:
        """Fly to a guided target; return False if it is dropped (not GUIDED, outside a fence)."""
        place = (east_m, north_m, up_m)
        if self.mode != Mode.GUIDED or not self.airborne:
            return False
        if self.fence.violations(self.parameters, self.home, place):
            return False
        self._enter_submode("place")
        self.fly_to(place, yaw_rad)
        return True

    def go_along(self, setpoint: Setpoint, yaw_rad: float | None = None) -> bool:
        """Follow a guided velocity for GUID_TIMEOUT; return False if it is dropped."""
        place = setpoint.place
        if self.mode != Mode.GUIDED or not self.airborne:
            return False
        if place is not None and self.fence.violations(self.parameters, self.home, place):
            return False
        self._enter_submode("velocity" if place is None else "place and velocity")
        self.follow(setpoint, self.t_s + self.parameters["GUID_TIMEOUT"], yaw_rad)
        return True

    def _enter_submode(self, submode: str) -> None:
        """Drop a changed speed if the submode changes: it reads WPNAV_SPEED again."""
        if submode == self._submode:
            return
        self._submode = submode
        self._speeds.pop("speed_m_s", None)
        self._limits_version = -1

    def turn_to(self, yaw_rad: float) -> bool:
        """Turn the nose to a true bearing, flying in GUIDED or AUTO."""
        if self.mode not in (Mode.GUIDED, Mode.AUTO) or not self.airborne:
            return False
        self.face(yaw_rad)
        return True

    def enable_fence(self, on: bool) -> None:
        """Set FENCE_ENABLE."""
        self.parameters.change("FENCE_ENABLE", float(on))

    def count_items(self, kind: int, items: list[Item]) -> None:
        """Set MIS_TOTAL, FENCE_TOTAL or RALLY_TOTAL."""
        self.parameters.change(_TOTALS[kind], len(items))

    # --- time -----------------------------------------------------------------------------------

    def _watch_failsafes(self) -> None:
        self.failsafes.step(self)
        if self.t_s >= self._next_prearm_s:
            self._next_prearm_s += _PREARM_EVERY_S
            checks = not self.armed and self.parameters["ARMING_CHECK"] != 0.0
            if checks and (refusal := self.prearm_refusal()) is not None:
                self.send_text(CRITICAL, refusal)

    def _decide(self, dt_s: float) -> Command:
        if self.mode == _AUTO and self.armed and self._mission_started:
            self.route.step(self)
        if self.phase is _LANDED:
            if self.armed and (
                self.mode in (Mode.RTL, Mode.LAND)
                or self.t_s - self._since_s > self.parameters["DISARM_DELAY"]
            ):
                self.disarm()
            return IDLE
        if not self._pass_phases(dt_s):
            return IDLE
        return self._fly(dt_s, position=self.position_ok and self.mode not in LEVEL)
