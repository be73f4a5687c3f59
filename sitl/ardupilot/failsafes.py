"""What an ArduCopter does by itself when something fails, and the parameters that say so.

Battery low and critical (BATT_*), no ground station (FS_GCS_*), no radio control (FS_THR_ENABLE),
no position (FS_EKF_ACTION), a broken fence (FENCE_*). Each acts once when it begins; afterwards
the pilot may change the mode again. All times are the vehicle's own.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.body.battery import Battery
from sitl.copter.control import Estimate
from sitl.copter.fence import Fence, Place, names
from sitl.copter.modes import Mode, Phase
from sitl.copter.params import Parameters

_POSITION_LOST_S = 8.0
_CONTINUE_AUTO, _CONTINUE_LANDING, _CONTINUE_PILOT = 2, 8, 16  # FS_OPTIONS, ground station
_TERMINATE = -1
WARNING: int = mav.MAV_SEVERITY_WARNING
CRITICAL: int = mav.MAV_SEVERITY_CRITICAL

_BATTERY_ACTIONS = {
    1: Mode.LAND, 2: Mode.RTL, 3: Mode.RTL, 4: Mode.LAND, 5: _TERMINATE, 6: Mode.RTL, 7: Mode.BRAKE,
}  # fmt: skip
_GCS_ACTIONS = {
    1: Mode.RTL, 2: Mode.RTL, 3: Mode.RTL, 4: Mode.RTL, 5: Mode.LAND, 6: Mode.RTL, 7: Mode.BRAKE,
}  # fmt: skip
_RADIO_ACTIONS = {
    1: Mode.RTL, 2: Mode.RTL, 3: Mode.LAND, 4: Mode.RTL, 5: Mode.LAND, 6: Mode.RTL, 7: Mode.BRAKE,
}  # fmt: skip
_FENCE_ACTIONS = {1: Mode.RTL, 2: Mode.LAND, 3: Mode.RTL, 4: Mode.BRAKE, 5: Mode.RTL}

OK, LOW, BATTERY_CRITICAL = 1, 2, 3  # MAV_BATTERY_CHARGE_STATE


class Craft(Protocol):
    """What the failsafes see and can do."""

    t_s: float
    mode: Mode
    phase: Phase
    armed: bool
    home: Place
    estimate: Estimate
    battery: Battery
    fence: Fence
    parameters: Parameters
    radio_lost: bool

    @property
    def airborne(self) -> bool: ...  # noqa: D102
    @property
    def navigating(self) -> bool: ...  # noqa: D102
    @property
    def position_lost(self) -> bool: ...  # noqa: D102
    @property
    def satellites_lost(self) -> bool: ...  # noqa: D102
    def say(self, severity: int, text: str) -> None: ...  # noqa: D102
    def set_mode(self, mode: Mode) -> str | None: ...  # noqa: D102
    def disarm(self, force: bool = False) -> str | None: ...  # noqa: D102


@dataclass(slots=True)
class Failsafes:
    """Which of them are active."""

    charge_state: int = OK
    no_station: bool = False
    no_radio: bool = False
    no_position: bool = False
    broken_fence: bool = False
    _station_s: float | None = None  # last heartbeat of the ground station
    _below_s: dict[int, float] = field(default_factory=dict)
    _glitch: bool = False
    _position_s: float | None = None
    _consumed_mah: float = 0.0

    @property
    def active(self) -> bool:
        """Any of them: the heartbeat says CRITICAL."""
        return (
            self.charge_state != OK or self.no_station or self.no_radio or self.no_position
            or self.broken_fence
        )  # fmt: skip

    def hear_station(self, now_s: float) -> None:
        """A heartbeat of the ground station SYSID_MYGCS."""
        self._station_s = now_s

    def step(self, craft: Craft) -> None:
        """Look at everything once."""
        self._battery(craft)
        self._station(craft)
        self._radio(craft)
        self._position(craft)
        self._fence(craft)

    # --- one each -------------------------------------------------------------------------------

    def _battery(self, craft: Craft) -> None:
        battery, get = craft.battery, craft.parameters
        if battery.consumed_mah < self._consumed_mah:  # a fresh pack
            self.charge_state = OK
            self._below_s.clear()
        self._consumed_mah = battery.consumed_mah
        if self.charge_state < BATTERY_CRITICAL and self._is_below(
            craft, BATTERY_CRITICAL, get["BATT_CRT_VOLT"], get["BATT_CRT_MAH"]
        ):
            self._battery_event(craft, BATTERY_CRITICAL, "critical", "BATT_FS_CRT_ACT")
        elif self.charge_state < LOW and self._is_below(
            craft, LOW, get["BATT_LOW_VOLT"], get["BATT_LOW_MAH"]
        ):
            self._battery_event(craft, LOW, "low", "BATT_FS_LOW_ACT")

    def _is_below(self, craft: Craft, state: int, volts: float, mah: float) -> bool:
        """Below the charge, or for BATT_LOW_TIMER below the voltage; 0 switches either off."""
        battery = craft.battery
        left_mah = craft.parameters["BATT_CAPACITY"] - battery.consumed_mah
        if mah > 0.0 and left_mah < mah:
            return True
        if not (volts > 0.0 and battery.voltage_v < volts):
            self._below_s.pop(state, None)
            return False
        since_s = self._below_s.setdefault(state, craft.t_s)
        return craft.t_s - since_s >= craft.parameters["BATT_LOW_TIMER"]

    def _battery_event(self, craft: Craft, state: int, word: str, parameter: str) -> None:
        self.charge_state = state
        battery = craft.battery
        craft.say(
            WARNING,
            f"Battery 1 is {word} {battery.voltage_v:.2f}V used {battery.consumed_mah:.0f} mAh",
        )
        action = _BATTERY_ACTIONS.get(int(craft.parameters[parameter]))
        if action is None:
            return
        if self._keeps_landing(craft):
            craft.say(WARNING, "Battery Failsafe - Continuing Landing")
            return
        self._act(craft, "Battery", action)

    def _station(self, craft: Craft) -> None:
        if self._station_s is None:
            return
        enabled = int(craft.parameters["FS_GCS_ENABLE"])
        silent_s = craft.t_s - self._station_s
        lost = enabled != 0 and silent_s > craft.parameters.positive("FS_GCS_TIMEOUT", 2, 120)
        if lost and not self.no_station:
            self.no_station = True
            options = int(craft.parameters["FS_OPTIONS"])
            if craft.mode == Mode.AUTO and (options & _CONTINUE_AUTO or enabled == 2):
                craft.say(WARNING, "GCS Failsafe - Continuing Auto Mode")
            elif craft.mode in (Mode.STABILIZE, Mode.LOITER) and options & _CONTINUE_PILOT:
                craft.say(WARNING, "GCS Failsafe - Continuing Pilot Control")
            elif self._keeps_landing(craft):
                craft.say(WARNING, "GCS Failsafe - Continuing Landing")
            else:
                self._act(craft, "GCS", _GCS_ACTIONS.get(enabled, Mode.RTL))
        elif self.no_station and not lost:
            self.no_station = False
            craft.say(WARNING, "GCS Failsafe Cleared")

    def _radio(self, craft: Craft) -> None:
        enabled = int(craft.parameters["FS_THR_ENABLE"])
        lost = enabled != 0 and craft.radio_lost
        if lost and not self.no_radio:
            self.no_radio = True
            self._act(craft, "Radio", _RADIO_ACTIONS.get(enabled, Mode.LAND))
        elif self.no_radio and not lost:
            self.no_radio = False
            craft.say(WARNING, "Radio Failsafe Cleared")

    def _position(self, craft: Craft) -> None:
        """Without any help the filter holds out for a while, then the position is gone."""
        if craft.satellites_lost != self._glitch:
            self._glitch = not self._glitch
            craft.say(CRITICAL, "GPS Glitch or Compass error" if self._glitch else "Glitch cleared")
        if not craft.position_lost:
            if self.no_position:
                craft.say(CRITICAL, "EKF Failsafe Cleared")
            self._position_s, self.no_position = None, False
            return
        if self._position_s is None:
            self._position_s = craft.t_s
        if self.no_position or craft.t_s - self._position_s < _POSITION_LOST_S:
            return
        if not craft.navigating:
            return  # on the ground, or with the pilot
        self.no_position = True
        if craft.parameters["FS_EKF_ACTION"] != 0.0:
            craft.set_mode(Mode.LAND)
            craft.say(CRITICAL, "EKF Failsafe: changed to LAND Mode")
        else:
            craft.say(CRITICAL, "EKF variance")

    def position_gone(self, now_s: float) -> bool:
        """The filter has no position any more."""
        return self._position_s is not None and now_s - self._position_s >= _POSITION_LOST_S

    def _fence(self, craft: Craft) -> None:
        now = craft.estimate
        fresh = craft.fence.watch(
            craft.parameters, craft.home, (now.east, now.north, now.up), craft.t_s,
            flying=craft.armed and craft.airborne,
        )  # fmt: skip
        self.broken_fence = craft.fence.broken != 0
        if not fresh:
            return
        craft.say(mav.MAV_SEVERITY_NOTICE, f"{names(fresh)} fence breached")
        action = _FENCE_ACTIONS.get(int(craft.parameters["FENCE_ACTION"]))
        if action is not None and craft.mode not in (Mode.LAND, action):
            self._act(craft, "Fence", action, announce=False)

    # --- what follows ---------------------------------------------------------------------------

    @staticmethod
    def _keeps_landing(craft: Craft) -> bool:
        landing = craft.phase == Phase.DESCEND
        return landing and bool(int(craft.parameters["FS_OPTIONS"]) & _CONTINUE_LANDING)

    @staticmethod
    def _act(craft: Craft, what: str, action: int, *, announce: bool = True) -> None:
        if announce:
            craft.say(WARNING, f"{what} Failsafe")
        if not craft.armed:
            return
        if not craft.airborne or action == _TERMINATE:
            craft.disarm(force=action == _TERMINATE)
            return
        mode = Mode(action)
        if craft.set_mode(mode) is not None:  # no position for a return
            craft.set_mode(Mode.LAND)
