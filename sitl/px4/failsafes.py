"""What a PX4 does by itself when something fails, and the parameters that say so.

Battery (COM_LOW_BAT_ACT), ground station (NAV_DLL_ACT), radio control (NAV_RCL_ACT), position,
geofence (GF_ACTION), a lost stream of setpoints (COM_OBL_RC_ACT). What is more than Hold waits in
Hold for COM_FAIL_ACT_T first, but for a lost stream; a mode that the pilot asks for meanwhile calls
it off. The vehicle stays in the mode of a failsafe until it is asked for another. All times are the
vehicle's own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.body.battery import CELLS, Battery
from sitl.copter.control import Estimate
from sitl.copter.fence import Fence, Place, names
from sitl.copter.params import Parameters
from sitl.px4.aiding import Ekf2Aiding
from sitl.px4.modes import Px4Mode
from sitl.px4.offboard import Setpoints

_MOTORS_OFF = -1
_LINK_ACTIONS = {
    1: Px4Mode.HOLD, 2: Px4Mode.RTL, 3: Px4Mode.LAND, 5: _MOTORS_OFF, 6: _MOTORS_OFF,
}  # fmt: skip
# without a radio control there are no modes by hand (0 to 2): it returns
_OFFBOARD_ACTIONS = {4: Px4Mode.LAND, 5: Px4Mode.HOLD, 6: _MOTORS_OFF, 7: _MOTORS_OFF}
_FENCE_ACTIONS = {2: Px4Mode.HOLD, 3: Px4Mode.RTL, 4: _MOTORS_OFF, 5: Px4Mode.LAND}
_SEVERITY_ORDER = (Px4Mode.HOLD, Px4Mode.RTL, Px4Mode.LAND, _MOTORS_OFF)
_RADIO_EXCEPT = {Px4Mode.MISSION: 1, Px4Mode.HOLD: 2, Px4Mode.OFFBOARD: 4}
_BATTERY = "battery"
_WARN, _CRITICAL = mav.MAV_SEVERITY_WARNING, mav.MAV_SEVERITY_CRITICAL

OK, LOW, CRITICAL, EMERGENCY = 1, 2, 3, 4  # MAV_BATTERY_CHARGE_STATE
_CHARGES = {LOW: "Low battery", CRITICAL: "Critical battery", EMERGENCY: "Dangerous battery"}


class Craft(Protocol):
    """What the failsafes see and can do."""

    t_s: float
    mode: Px4Mode
    armed: bool
    home: Place
    estimate: Estimate
    battery: Battery
    fence: Fence
    parameters: Parameters
    radio_lost: bool
    setpoints: Setpoints
    sources: Ekf2Aiding

    @property
    def airborne(self) -> bool: ...  # noqa: D102
    @property
    def position_lost(self) -> bool: ...  # noqa: D102
    @property
    def position_poor(self) -> bool: ...  # noqa: D102
    def say(self, severity: int, text: str) -> None: ...  # noqa: D102
    def fail_to(self, mode: Px4Mode) -> None: ...  # noqa: D102
    def disarm(self, force: bool = False) -> str | None: ...  # noqa: D102


@dataclass(slots=True)
class Px4Failsafes:
    """Which of them are active."""

    charge_state: int = OK
    no_station: bool = False
    no_radio: bool = False
    no_position: bool = False
    broken_fence: bool = False
    engaged: bool = False
    """One of them has changed the mode, and nobody has since."""
    _station_s: float | None = None  # last heartbeat of a ground station
    _without_satellites: bool = False  # it flies on, and has said so
    _position_s: float | None = None
    _gone_after_s: float = 5.0
    _consumed_mah: float = 0.0
    _due: tuple[float, int] | None = None  # when the waiting in Hold ends, and what then
    _action: int = 0

    @property
    def active(self) -> bool:
        """The heartbeat says CRITICAL."""
        return self.engaged

    def hear_station(self, now_s: float) -> None:
        """A heartbeat of a ground station."""
        self._station_s = now_s

    def hears_station(self, now_s: float, parameters: Parameters) -> bool:
        """Whether a ground station is connected."""
        if self._station_s is None:
            return False
        return now_s - self._station_s <= parameters.positive("COM_DL_LOSS_T", 5, 300)

    def position_gone(self, now_s: float) -> bool:
        """The filter has no position any more."""
        return self._position_s is not None and now_s - self._position_s >= self._gone_after_s

    def taken_over(self) -> None:
        """The pilot has asked for a mode, or the motors have stopped."""
        self.engaged, self._due, self._action = False, None, 0

    def step(self, craft: Craft) -> None:
        """Look at everything once."""
        self._battery(craft)
        self._station(craft)
        self._radio(craft)
        self._position(craft)
        self._fence(craft)
        self._offboard(craft)
        if self._due is not None and craft.t_s >= self._due[0]:
            action, self._due = self._due[1], None
            self._carry_out(craft, action)

    # --- one each -------------------------------------------------------------------------------

    def _battery(self, craft: Craft) -> None:
        battery, get = craft.battery, craft.parameters
        if battery.consumed_mah < self._consumed_mah:  # a fresh pack
            self.charge_state = OK
        self._consumed_mah = battery.consumed_mah
        share = battery.energy_wh / battery.capacity_wh
        if battery.voltage_v < CELLS * get["BAT1_V_EMPTY"]:
            share = 0.0
        thresholds = (
            (EMERGENCY, "BAT_EMERGEN_THR"),
            (CRITICAL, "BAT_CRIT_THR"),
            (LOW, "BAT_LOW_THR"),
        )
        state = next((state for state, name in thresholds if share < get[name]), OK)
        if state <= self.charge_state:
            return
        self.charge_state = state
        craft.say(_WARN if state == LOW else _CRITICAL, f"{_CHARGES[state]} level")
        wanted = int(get["COM_LOW_BAT_ACT"])
        if state == EMERGENCY and wanted in (2, 3):
            self._act(craft, _BATTERY, Px4Mode.LAND)
        elif state == CRITICAL and wanted == 3:
            self._act(craft, _BATTERY, Px4Mode.RTL)

    def _station(self, craft: Craft) -> None:
        if self._station_s is None:
            return
        lost = not self.hears_station(craft.t_s, craft.parameters)
        if lost and not self.no_station:
            craft.say(_WARN, "Connection to ground station lost")
            self._act(craft, "data link", _LINK_ACTIONS.get(int(craft.parameters["NAV_DLL_ACT"])))
        elif self.no_station and not lost:
            craft.say(mav.MAV_SEVERITY_INFO, "Connection to ground station regained")
        self.no_station = lost

    def _radio(self, craft: Craft) -> None:
        lost = craft.radio_lost
        if lost and not self.no_radio:
            excepted = int(craft.parameters["COM_RCL_EXCEPT"]) & _RADIO_EXCEPT.get(craft.mode, 0)
            craft.say(_CRITICAL, "Manual control lost")
            if not excepted:
                action = _LINK_ACTIONS.get(int(craft.parameters["NAV_RCL_ACT"]))
                self._act(craft, "manual control", action)
        elif self.no_radio and not lost:
            craft.say(mav.MAV_SEVERITY_INFO, "Manual control regained")
        self.no_radio = lost

    def _position(self, craft: Craft) -> None:
        """Without any help the filter holds out for a while, then the position is gone."""
        self._satellites(craft)
        if not craft.position_lost:
            self._position_s, self.no_position = None, False
            return
        if self._position_s is None:
            self._position_s = craft.t_s
            self._gone_after_s = craft.parameters.positive("EKF2_NOAID_TOUT", 5e5, 1e7) / 1e6
        if craft.position_poor:
            self._gone_after_s = 0.0
        if self.no_position or not self.position_gone(craft.t_s):
            return
        self.no_position = True
        craft.say(_CRITICAL, "Global position lost")
        if craft.armed and craft.airborne:
            self._carry_out(craft, Px4Mode.LAND)  # there is nothing to wait in Hold with

    def _satellites(self, craft: Craft) -> None:
        """They stop being fused, and it flies on; they begin to be fused again."""
        if craft.sources.just_stopped and craft.armed and not craft.position_lost:
            self._without_satellites = True
            craft.say(_WARN, "GNSS data fusion stopped")
        elif craft.sources.just_started and self._without_satellites:
            self._without_satellites = False
            craft.say(mav.MAV_SEVERITY_INFO, "GNSS data fusion started")

    def _fence(self, craft: Craft) -> None:
        now = craft.estimate
        fresh = craft.fence.watch(
            craft.parameters, craft.home, (now.east, now.north, now.up), craft.t_s,
            flying=craft.armed and craft.airborne,
        )  # fmt: skip
        self.broken_fence = craft.fence.broken != 0
        if fresh:
            craft.say(_CRITICAL, f"Geofence violated: {names(fresh)}")
            self._act(craft, "geofence", _FENCE_ACTIONS.get(int(craft.parameters["GF_ACTION"])))

    def _offboard(self, craft: Craft) -> None:
        if craft.mode != Px4Mode.OFFBOARD or not craft.armed:
            return
        if craft.setpoints.silent_s(craft.t_s) <= craft.parameters["COM_OF_LOSS_T"]:
            return
        craft.say(_CRITICAL, "Offboard control lost")
        wanted = int(craft.parameters["COM_OBL_RC_ACT"])
        action = _OFFBOARD_ACTIONS.get(wanted, Px4Mode.RTL)
        self._act(craft, "offboard", action, at_once=True)

    # --- what follows ---------------------------------------------------------------------------

    def _act(self, craft: Craft, cause: str, action: int | None, *, at_once: bool = False) -> None:
        """Begin an action, unless a graver one is on."""
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
        if craft.mode == Px4Mode.LAND and cause == _BATTERY:
            action = Px4Mode.LAND  # it breaks the landing off, waits in Hold, and lands
        else:
            waits = waits and not (at_once or self._landing(craft))
        if waits and delay_s > 0.0:
            craft.say(_CRITICAL, f"Failsafe {cause}: Hold, then {Px4Mode(action).name}")
            self.engaged = True
            craft.fail_to(Px4Mode.HOLD)
            self._action, self._due = action, (craft.t_s + delay_s, action)
            return
        craft.say(_CRITICAL, f"Failsafe {cause} activated")
        self._carry_out(craft, action)

    @staticmethod
    def _landing(craft: Craft) -> bool:
        return craft.mode in (Px4Mode.RTL, Px4Mode.LAND)

    def _carry_out(self, craft: Craft, action: int) -> None:
        self._action, self._due, self.engaged = action, None, True
        if action == _MOTORS_OFF:
            craft.disarm(force=True)
        elif craft.mode != Px4Mode.LAND:  # what lands goes on landing
            craft.fail_to(Px4Mode(action))
