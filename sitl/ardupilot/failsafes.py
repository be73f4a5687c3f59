"""An ArduCopter's failsafes, and the parameters that set them.

Battery low and critical (BATT_*), no ground station (FS_GCS_*), no radio control (FS_THR_ENABLE),
no position (FS_EKF_ACTION), a broken fence (FENCE_*). Each acts once when it begins; then the
pilot may change the mode again. All times are the vehicle's own.
"""

from __future__ import annotations

from typing import ClassVar, Protocol

from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.copter import failsafes as copter
from sitl.copter.failsafes import (
    CHARGE_CRITICAL,
    CHARGE_LOW,
    CHARGE_OK,
    CRITICAL,
    POSITION,
    RADIO,
    STATION,
    WARNING,
    Failsafes,
)
from sitl.copter.fence import names
from sitl.copter.modes import LEVEL, Mode, Phase

_POSITION_LOST_S = 8.0
_CONTINUE_AUTO, _CONTINUE_LANDING, _CONTINUE_PILOT = 2, 8, 16  # FS_OPTIONS, ground station
_BY_HAND = (*LEVEL, Mode.LOITER, Mode.POSHOLD)
_TERMINATE = -1

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


class Craft(copter.Craft, Protocol):
    """The part of an autopilot that failsafes use."""

    mode: Mode
    phase: Phase

    @property
    def satellites_lost(self) -> bool: ...  # noqa: D102
    def set_mode(self, mode: Mode) -> str | None: ...  # noqa: D102


class ArduPilotFailsafes(Failsafes):
    """The active failsafes of an ArduCopter."""

    ended: ClassVar = {
        STATION: (WARNING, "GCS Failsafe Cleared"),
        RADIO: (WARNING, "Radio Failsafe Cleared"),
        POSITION: (CRITICAL, "EKF Failsafe Cleared"),
    }

    def __init__(self) -> None:
        super().__init__()
        self._glitch = self._broken_fence = False
        self._below_s: dict[int, float] = {}  # since when a voltage is too low, by charge state

    @property
    def active(self) -> bool:
        """True if any of them is active: the heartbeat reports CRITICAL."""
        return self.charge_state != CHARGE_OK or bool(self.lost) or self._broken_fence

    def step(self, craft: Craft) -> None:
        """Look at everything once."""
        if self.is_fresh_pack(craft):
            self._below_s.clear()
        for state, name in ((CHARGE_CRITICAL, "CRT"), (CHARGE_LOW, "LOW")):
            if self.charge_state < state and self._is_below(craft, state, name):
                self._battery_low(craft, state, name)
        self._station(craft)
        self._radio(craft)
        self._position(craft)
        self._fence(craft)

    # --- one each -------------------------------------------------------------------------------

    def _is_below(self, craft: Craft, state: int, name: str) -> bool:
        """Return whether charge, or for BATT_LOW_TIMER voltage, is too low; 0 disables either."""
        battery, get = craft.battery, craft.parameters
        volts, mah = get[f"BATT_{name}_VOLT"], get[f"BATT_{name}_MAH"]
        if mah > 0.0 and get["BATT_CAPACITY"] - battery.consumed_mah < mah:
            return True
        if not (volts > 0.0 and battery.voltage_v < volts):
            self._below_s.pop(state, None)
            return False
        since_s = self._below_s.setdefault(state, craft.t_s)
        return craft.t_s - since_s >= get["BATT_LOW_TIMER"]

    def _battery_low(self, craft: Craft, state: int, name: str) -> None:
        self.charge_state = state
        battery, word = craft.battery, "low" if state == CHARGE_LOW else "critical"
        craft.send_text(
            WARNING,
            f"Battery 1 is {word} {battery.voltage_v:.2f}V used {battery.consumed_mah:.0f} mAh",
        )
        action = _BATTERY_ACTIONS.get(int(craft.parameters[f"BATT_FS_{name}_ACT"]))
        if action is None:
            return
        if self._keeps_landing(craft):
            craft.send_text(WARNING, "Battery Failsafe - Continuing Landing")
            return
        self._act(craft, "Battery", action)

    def _station(self, craft: Craft) -> None:
        get, enabled = craft.parameters, int(craft.parameters["FS_GCS_ENABLE"])
        silent_s = self.silent_s(craft.t_s)
        lost = enabled != 0 and silent_s > get.positive("FS_GCS_TIMEOUT", 2, 120)
        if not self.begins(craft, STATION, lost):
            return
        options = int(get["FS_OPTIONS"])
        if craft.mode == Mode.AUTO and (options & _CONTINUE_AUTO or enabled == 2):
            craft.send_text(WARNING, "GCS Failsafe - Continuing Auto Mode")
        elif craft.mode in _BY_HAND and options & _CONTINUE_PILOT:
            craft.send_text(WARNING, "GCS Failsafe - Continuing Pilot Control")
        elif self._keeps_landing(craft):
            craft.send_text(WARNING, "GCS Failsafe - Continuing Landing")
        else:
            self._act(craft, "GCS", _GCS_ACTIONS.get(enabled, Mode.RTL))

    def _radio(self, craft: Craft) -> None:
        enabled = int(craft.parameters["FS_THR_ENABLE"])
        if self.begins(craft, RADIO, enabled != 0 and craft.radio_lost):
            self._act(craft, "Radio", _RADIO_ACTIONS.get(enabled, Mode.LAND))

    def _position(self, craft: Craft) -> None:
        if craft.satellites_lost != self._glitch:
            self._glitch = not self._glitch
            craft.send_text(
                CRITICAL, "GPS Glitch or Compass error" if self._glitch else "Glitch cleared"
            )
        navigates = craft.armed and craft.airborne and craft.mode not in LEVEL
        if not self.loses_position(craft, _POSITION_LOST_S, matters=navigates):
            return
        if craft.parameters["FS_EKF_ACTION"] != 0.0:
            craft.set_mode(Mode.LAND)
            craft.send_text(CRITICAL, "EKF Failsafe: changed to LAND Mode")
        else:
            craft.send_text(CRITICAL, "EKF variance")

    def _fence(self, craft: Craft) -> None:
        fresh = self.breaks_fences(craft)
        self._broken_fence = craft.fence.broken != 0
        if not fresh:
            return
        craft.send_text(mav.MAV_SEVERITY_NOTICE, f"{names(fresh)} fence breached")
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
            craft.send_text(WARNING, f"{what} Failsafe")
        if not craft.armed:
            return
        if not craft.airborne or action == _TERMINATE:
            craft.disarm(force=action == _TERMINATE)
            return
        mode = Mode(action)
        if craft.set_mode(mode) is not None:  # no position for a return
            craft.set_mode(Mode.LAND)
