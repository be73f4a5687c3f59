"""A PX4's failsafes, and the parameters that set them.

Battery (COM_LOW_BAT_ACT), ground station (NAV_DLL_ACT), radio control (NAV_RCL_ACT), position,
geofence (GF_ACTION), a lost stream of setpoints (COM_OBL_RC_ACT). But for a lost stream, it holds
for COM_FAIL_ACT_T before it returns or lands; a mode that the pilot selects meanwhile cancels the
failsafe. The vehicle stays in the failsafe's mode until another is selected, or until the lost
stream is back: then it enters OFFBOARD by itself. All times are the vehicle's own.

All failsafes have one text; the cause is in the arguments of the event only.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from enum import IntEnum
from typing import ClassVar, Protocol

from sitl.body.battery import CELLS
from sitl.copter import failsafes as copter
from sitl.copter.aircraft import Notice
from sitl.copter.failsafes import (
    CHARGE_CRITICAL,
    CHARGE_EMERGENCY,
    CHARGE_LOW,
    CRITICAL,
    INFO,
    RADIO,
    STATION,
    WARNING,
    Failsafes,
)
from sitl.copter.fence import names
from sitl.copter.params import Parameters
from sitl.px4.aiding import Ekf2Aiding
from sitl.px4.modes import BY_HAND, Px4Mode

FRESH_S = 0.5
"""Age limit of the last setpoint when OFFBOARD is selected: it needs two a second."""


class Setpoints:
    """When SET_POSITION_TARGET_* was received last, whatever the mode."""

    def __init__(self) -> None:
        self._received_s = -math.inf

    def note(self, now_s: float) -> None:
        """Note a setpoint."""
        self._received_s = now_s

    def silent_s(self, now_s: float) -> float:
        """Return the seconds since the last one."""
        return now_s - self._received_s

    def fresh(self, now_s: float) -> bool:
        """Return whether there is a stream to switch to."""
        return self.silent_s(now_s) <= FRESH_S + 1e-6


class Cause(IntEnum):
    """`failsafe_cause_t`: a lost stream, position or place inside the fence has no cause."""

    GENERIC = 0
    RADIO = 1
    STATION = 2
    LOW_BATTERY = 3
    CRITICAL_BATTERY = 4
    EMERGENCY_BATTERY = 5


MOTORS_OFF = -1
_ACTIONS: Mapping[int, int] = {
    Px4Mode.POSITION: 2, Px4Mode.ALTITUDE: 3, Px4Mode.STABILIZED: 4, Px4Mode.HOLD: 5,
    Px4Mode.RTL: 6, Px4Mode.LAND: 7, MOTORS_OFF: 10,
}  # fmt: skip
"""`failsafe_action_t`."""


def failsafe(intended: Px4Mode, action: int, cause: Cause, holds_s: float = 0.0) -> Notice:
    """Return the notice of a failsafe: one text for all, and an event with the cause.

    Arguments (`failsafe/framework.cpp`, `notifyUser`): the intended mode, the action, the seconds
    that it holds first, and the cause if there is one.
    """
    name, text = "commander_failsafe_enter", "Failsafe activated"
    arguments = struct.pack("<IB", int(intended), _ACTIONS[action])
    if cause == Cause.GENERIC:
        name += "_generic"
    if holds_s > 0.0:
        name, text = name + "_hold", f"{text}, entering Hold for {holds_s:.0f} seconds"
        arguments += struct.pack("<H", round(holds_s))
    if cause != Cause.GENERIC:
        arguments += struct.pack("<B", cause)
    return Notice(CRITICAL, text, name, arguments)


_LINK_ACTIONS = {
    1: Px4Mode.HOLD, 2: Px4Mode.RTL, 3: Px4Mode.LAND, 5: MOTORS_OFF, 6: MOTORS_OFF,
}  # fmt: skip
_OFFBOARD_ACTIONS = {
    0: Px4Mode.POSITION, 1: Px4Mode.ALTITUDE, 2: Px4Mode.STABILIZED, 4: Px4Mode.LAND,
    5: Px4Mode.HOLD, 6: MOTORS_OFF, 7: MOTORS_OFF,
}  # fmt: skip
_FENCE_ACTIONS = {2: Px4Mode.HOLD, 3: Px4Mode.RTL, 4: MOTORS_OFF, 5: Px4Mode.LAND}
_SEVERITY_ORDER = (
    Px4Mode.POSITION, Px4Mode.ALTITUDE, Px4Mode.STABILIZED, Px4Mode.HOLD, Px4Mode.RTL,
    Px4Mode.LAND, MOTORS_OFF,
)  # fmt: skip
_RADIO_EXCEPT = {Px4Mode.MISSION: 1, Px4Mode.HOLD: 2, Px4Mode.OFFBOARD: 4}
_CHARGES = (
    (CHARGE_EMERGENCY, "BAT_EMERGEN_THR", "Dangerous battery", CRITICAL),
    (CHARGE_CRITICAL, "BAT_CRIT_THR", "Critical battery", CRITICAL),
    (CHARGE_LOW, "BAT_LOW_THR", "Low battery", WARNING),
)
"""State, the parameter below which it begins, its name and the severity of its text."""
_BATTERY_CAUSES = {
    CHARGE_LOW: Cause.LOW_BATTERY, CHARGE_CRITICAL: Cause.CRITICAL_BATTERY,
    CHARGE_EMERGENCY: Cause.EMERGENCY_BATTERY,
}  # fmt: skip


class Craft(copter.Craft, Protocol):
    """The part of an autopilot that failsafes use."""

    mode: Px4Mode
    setpoints: Setpoints
    aiding: Ekf2Aiding
    texts: list[Notice]

    @property
    def by_hand(self) -> bool: ...  # noqa: D102
    @property
    def intended(self) -> Px4Mode: ...  # noqa: D102
    @property
    def position_poor(self) -> bool: ...  # noqa: D102
    def fail_to(self, mode: Px4Mode) -> None: ...  # noqa: D102


class Px4Failsafes(Failsafes):
    """The active failsafes of a PX4."""

    ended: ClassVar = {
        STATION: (INFO, "Connection to ground station regained"),
        RADIO: (INFO, "Manual control regained"),
    }

    def __init__(self) -> None:
        super().__init__()
        self.engaged = False
        """True if a failsafe has changed the mode, and no pilot since."""
        self._without_satellites = False  # it flies on, and has reported that
        self._due: tuple[float, int] | None = None  # when the waiting in Hold ends, and what then
        self._action = 0
        self._streamless = False  # what is done is for a lost stream of setpoints

    @property
    def active(self) -> bool:
        """True if the heartbeat reports CRITICAL."""
        return self.engaged

    def is_station_connected(self, now_s: float, parameters: Parameters) -> bool:
        """Return whether a ground station is connected."""
        return 0.0 <= self.silent_s(now_s) <= parameters.positive("COM_DL_LOSS_T", 5, 300)

    def note_pilot(self) -> None:
        """Note that the pilot has selected a mode, or that the motors have stopped."""
        self.engaged, self._due, self._action, self._streamless = False, None, 0, False

    def step(self, craft: Craft) -> None:
        """Look at everything once."""
        self._battery(craft)
        self._links(craft)
        self._position(craft)
        if fresh := self.breaks_fences(craft):
            craft.send_text(CRITICAL, f"Geofence violated: {names(fresh)}")
            wanted = _FENCE_ACTIONS.get(int(craft.parameters["GF_ACTION"]))
            self._act(craft, Cause.GENERIC, wanted)
        self._offboard(craft)
        if self._due is not None and craft.t_s >= self._due[0]:
            action, self._due = self._due[1], None
            self._carry_out(craft, action)

    # --- one each -------------------------------------------------------------------------------

    def _battery(self, craft: Craft) -> None:
        self.is_fresh_pack(craft)
        battery, get = craft.battery, craft.parameters
        share = battery.energy_wh / battery.capacity_wh
        if battery.voltage_v < CELLS * get["BAT1_V_EMPTY"]:
            share = 0.0
        row = next((row for row in _CHARGES if share < get[row[1]]), None)
        if row is None or row[0] <= self.charge_state:
            return
        self.charge_state, _, words, severity = row
        craft.send_text(severity, f"{words} level")
        wanted = int(get["COM_LOW_BAT_ACT"])
        if self.charge_state == CHARGE_EMERGENCY and wanted in (2, 3):
            self._act(craft, _BATTERY_CAUSES[CHARGE_EMERGENCY], Px4Mode.LAND)
        elif self.charge_state == CHARGE_CRITICAL and wanted == 3:
            self._act(craft, _BATTERY_CAUSES[CHARGE_CRITICAL], Px4Mode.RTL)

    def _links(self, craft: Craft) -> None:
        get = craft.parameters
        known = self.silent_s(craft.t_s) >= 0.0
        if self.begins(craft, STATION, known and not self.is_station_connected(craft.t_s, get)):
            craft.send_text(WARNING, "Connection to ground station lost")
            self._act(craft, Cause.STATION, _LINK_ACTIONS.get(int(get["NAV_DLL_ACT"])))
        if self.begins(craft, RADIO, craft.radio_lost):
            craft.send_text(CRITICAL, "Manual control lost")
            if not int(get["COM_RCL_EXCEPT"]) & _RADIO_EXCEPT.get(craft.mode, 0):
                self._act(craft, Cause.RADIO, _LINK_ACTIONS.get(int(get["NAV_RCL_ACT"])))

    def _position(self, craft: Craft) -> None:
        if craft.aiding.just_stopped and craft.armed and not craft.position_lost:
            self._without_satellites = True
            craft.send_text(WARNING, "GNSS data fusion stopped")
        elif craft.aiding.just_started and self._without_satellites:
            self._without_satellites = False
            craft.send_text(INFO, "GNSS data fusion started")
        holds_out_s = craft.parameters.positive("EKF2_NOAID_TOUT", 5e5, 1e7) / 1e6
        begins = self.loses_position(craft, 0.0 if craft.position_poor else holds_out_s)
        if begins and craft.armed and craft.airborne:
            craft.texts.append(failsafe(craft.intended, Px4Mode.LAND, Cause.GENERIC))
            self._carry_out(craft, Px4Mode.LAND)  # there is nothing to wait in Hold with

    def _offboard(self, craft: Craft) -> None:
        if not craft.armed:
            return
        if self._streamless and craft.setpoints.fresh(craft.t_s) and craft.airborne:
            self.note_pilot()
            craft.fail_to(Px4Mode.OFFBOARD)
        if craft.mode != Px4Mode.OFFBOARD:
            return
        if craft.setpoints.silent_s(craft.t_s) <= craft.parameters["COM_OF_LOSS_T"]:
            return
        wanted = int(craft.parameters["COM_OBL_RC_ACT"])
        action = _OFFBOARD_ACTIONS.get(wanted, Px4Mode.RTL)
        if action in BY_HAND and not craft.by_hand:
            action = Px4Mode.RTL
        self._act(craft, Cause.GENERIC, action, streamless=True)

    # --- what follows ---------------------------------------------------------------------------

    def _act(
        self, craft: Craft, cause: Cause, action: int | None, *, streamless: bool = False
    ) -> None:
        """Begin an action unless a graver one is active; `streamless`: without a hold."""
        if action is None or not craft.armed:
            return
        rank = _SEVERITY_ORDER.index(action)
        if self._action and rank <= _SEVERITY_ORDER.index(self._action):
            return
        if not craft.airborne:
            craft.disarm()
            return
        delay_s = craft.parameters["COM_FAIL_ACT_T"]
        waits = action in (Px4Mode.RTL, Px4Mode.LAND)
        if craft.mode == Px4Mode.LAND and cause in _BATTERY_CAUSES.values():
            action = Px4Mode.LAND  # it breaks the landing off, waits in Hold, and lands
        else:
            waits = waits and not streamless and craft.mode not in (Px4Mode.RTL, Px4Mode.LAND)
        self._streamless = streamless
        if waits and delay_s > 0.0:
            craft.texts.append(failsafe(craft.intended, action, cause, holds_s=delay_s))
            self.engaged = True
            craft.fail_to(Px4Mode.HOLD)
            self._action, self._due = action, (craft.t_s + delay_s, action)
            return
        craft.texts.append(failsafe(craft.intended, action, cause))
        self._carry_out(craft, action)

    def _carry_out(self, craft: Craft, action: int) -> None:
        self._action, self._due, self.engaged = action, None, True
        if action == MOTORS_OFF:
            craft.disarm(force=True)
        elif craft.mode != Px4Mode.LAND:  # a vehicle that lands continues its landing
            craft.fail_to(Px4Mode(action))
