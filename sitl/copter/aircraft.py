"""The common part of every simulated autopilot: an estimate, home, readiness, plans, texts, time.

A subclass decides: `sitl.ardupilot.autopilot` is an ArduCopter, `sitl.px4.autopilot` a PX4.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import ClassVar, NamedTuple

from sitl.body.battery import Battery
from sitl.body.estimator import Estimator
from sitl.body.physics import Body, Command
from sitl.copter.aiding import Aiding
from sitl.copter.failsafes import CRITICAL, INFO, Failsafes
from sitl.copter.fence import Fence
from sitl.copter.mission_items import FENCE, MISSION, RALLY, Item
from sitl.copter.modes import Phase
from sitl.copter.motion import Airframe, Motion
from sitl.copter.params import Parameters
from sitl.copter.route import Route
from sitl.copter.trajectory import Follower, Setpoint
from sitl.copter.transfer import Plans
from sitl.quirks import Quirks

_PREARM_SHARE = 0.8  # of the time to readiness: the prearm bit goes true before the position
_HOME_SHARE = 0.5
_BOUNCE_M_S, _BOUNCE_S = 2.5, 0.7  # of one that lies there, its motors turning


class Notice(NamedTuple):
    """A status text, and the event that goes with it.

    `event` is its name and `arguments` are packed; without a name it follows from the text.
    """

    severity: int
    text: str
    event: str = ""
    arguments: bytes = b""


class Device(NamedTuple):
    """The device around an autopilot; `seed`: the world's, and the system id."""

    body: Body
    error: Estimator
    battery: Battery
    airframe: Airframe
    quirks: Quirks
    seed: tuple[int, int]


class Aircraft(Motion, ABC):
    """One autopilot; `step` advances it, the other methods are what a pilot can request.

    It sees the world through an estimate of its position and moves it through `Body`. It knows no
    MAVLink: requests are method calls that return None or the reason for a refusal.
    """

    first_item: ClassVar[int]
    """The first item of a mission that is flown: an ArduPilot's item 0 is home."""
    failsafes: Failsafes

    def __init__(
        self,
        device: Device,
        parameters: Parameters,
        fence: Fence,
        aiding: Aiding,
        follower: Follower,
    ) -> None:
        super().__init__(device.body, device.airframe, parameters, follower)
        self.error = device.error
        self.aiding = aiding
        self.battery = device.battery
        self.armed = False
        self.plans: Plans = {MISSION: [], FENCE: [], RALLY: []}
        self.route = Route(self.plans[MISSION], self.first_item)
        self.fence = fence
        self.texts: list[Notice] = []
        self.mode_changed = False
        self.home_changed = False
        self.home_known = False
        """There was a fix, and home is set."""
        self._resets = 0  # of the position that have been planned anew for

    # --- what it knows of itself ---------------------------------------------------------------

    @property
    def prearm_ok(self) -> bool:
        """Prearm bit of SYS_STATUS."""
        settled = self.t_s >= _PREARM_SHARE * self._airframe.ready_after_s
        if not settled or self.body.crashed or self.position_lost:
            return False
        return self.armed or not self.error.lost or self.error.aided

    @property
    def position_ok(self) -> bool:
        """True if the navigation filter has an absolute position."""
        return self.t_s >= self._airframe.ready_after_s and not self.failsafes.has_lost_position(
            self.t_s
        )

    @property
    def position_lost(self) -> bool:
        """True if there are no satellites, and nothing in their place."""
        return self.error.unaided

    @property
    def satellites_lost(self) -> bool:
        """True if there are no satellites, although the position depends on them."""
        return self.error.lost and self.error.satellites_used

    @property
    @abstractmethod
    def in_mission(self) -> bool:
        """True if the mode is the one that flies missions."""

    # --- what can be asked for ------------------------------------------------------------------

    def send_text(self, severity: int, text: str) -> None:
        """Send a status text."""
        self.texts.append(Notice(severity, text))

    @abstractmethod
    def arm(self, force: bool = False) -> str | None:
        """Start the motors; return the reason for a refusal, or None."""

    @abstractmethod
    def prearm_refusal(self) -> str | None:
        """Return what the checks before arming object to, or None."""

    @abstractmethod
    def disarm(self, force: bool = False) -> str | None:
        """Stop the motors; in the air only by force, and then it falls."""

    @abstractmethod
    def go_to(
        self, east_m: float, north_m: float, up_m: float, yaw_rad: float | None = None
    ) -> bool:
        """Fly to a target of SET_POSITION_TARGET_*; return False if it is dropped."""

    @abstractmethod
    def go_along(self, setpoint: Setpoint, yaw_rad: float | None = None) -> bool:
        """Follow a setpoint of SET_POSITION_TARGET_*; return False if it is dropped."""

    @abstractmethod
    def mission_done(self) -> None:
        """Act on the end of the mission."""

    def enable_fence(self, on: bool) -> None:
        """Execute DO_FENCE_ENABLE, where the autopilot has it."""

    def count_items(self, kind: int, items: list[Item]) -> None:
        """Count the items of a changed list in a parameter, where there is one."""

    def set_home(self, east_m: float, north_m: float, up_m: float) -> None:
        """Execute DO_SET_HOME."""
        self.home = (east_m, north_m, up_m)
        self.home_known = self.home_changed = True

    # --- what follows from it -------------------------------------------------------------------

    def _start_motors(self, text: str) -> None:
        """Arm; home is here from now on."""
        self.armed = self.body.motors_on = True
        self.home = self.estimate.place
        self.home_changed = True
        self._control.reset()
        self._enter(Phase.LANDED)
        self.send_text(INFO, text)

    def _leave_mode(self) -> None:
        """Drop target, stream and changed speeds; in the air, brake to a hold."""
        self.mode_changed = True
        self.target = None
        self.stop_stream()
        self._speeds.clear()
        self._limits_version = -1
        if self.phase == Phase.SPOOL:
            self._enter(Phase.LANDED)
        if self.airborne:
            self._control.yaw_target = None
            self.hold = self._stopping_point()

    # --- time -----------------------------------------------------------------------------------

    def step(self, wind: tuple[float, float], dt_s: float) -> None:
        """Advance estimate, decision, control, physics and battery."""
        self.t_s += dt_s
        if not self.home_known and self.t_s >= _HOME_SHARE * self._airframe.ready_after_s:
            self.home_known = self.home_changed = True
        self.aiding.step(self.t_s)
        self.error.move(dt_s, self.body.v_east, self.body.v_north)
        if self.error.resets != self._resets:
            self._resets = self.error.resets
            self._shaper.active = False
            self._follower.stop()
        self._look()
        self._watch_failsafes()
        if self.body.motors_on and self.battery.empty:
            self.body.motors_on = False
            self.send_text(CRITICAL, "Battery 1 is empty")
        command = self._decide(dt_s)
        self.body.step(command, wind, dt_s)
        self._look()  # telemetry and pictures are of this moment
        if self.armed and not self.body.motors_on and self.body.on_ground:
            self.disarm(force=True)

    def _look(self) -> None:
        body, error, now = self.body, self.error, self.estimate
        now.east, now.north = body.east + error.east, body.north + error.north
        now.up = body.up + error.up
        now.v_east, now.v_north = body.v_east + error.v_east, body.v_north + error.v_north
        now.v_up = body.v_up + error.v_up
        if body.crashed and body.motors_on:
            now.v_up += _BOUNCE_M_S * math.sin(math.tau * self.t_s / _BOUNCE_S)

    @abstractmethod
    def _watch_failsafes(self) -> None:
        """Let the failsafes look once."""

    @abstractmethod
    def _decide(self, dt_s: float) -> Command:
        """Return the command for the motors."""
