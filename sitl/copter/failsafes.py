"""The common part of the failsafes of every autopilot: conditions, beginning and end.

A subclass decides on the action: `sitl.ardupilot.failsafes`, `sitl.px4.failsafes`. All times are
the vehicle's own.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar, Protocol

from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.body.battery import Battery
from sitl.copter.control import Estimate
from sitl.copter.fence import Fence, Place
from sitl.copter.params import Parameters

INFO: int = mav.MAV_SEVERITY_INFO
WARNING: int = mav.MAV_SEVERITY_WARNING
CRITICAL: int = mav.MAV_SEVERITY_CRITICAL

CHARGE_OK, CHARGE_LOW, CHARGE_CRITICAL, CHARGE_EMERGENCY = 1, 2, 3, 4  # MAV_BATTERY_CHARGE_STATE
STATION, RADIO, POSITION = "ground station", "radio control", "position"


class Craft(Protocol):
    """The part of an autopilot that failsafes use."""

    t_s: float
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
    def position_lost(self) -> bool: ...  # noqa: D102
    def send_text(self, severity: int, text: str) -> None: ...  # noqa: D102
    def disarm(self, force: bool = False) -> str | None: ...  # noqa: D102


class Failsafes(ABC):
    """The active failsafes of one vehicle."""

    ended: ClassVar[Mapping[str, tuple[int, str]]]
    """Severity and text when a loss ends, by what was lost."""

    def __init__(self) -> None:
        self.charge_state = CHARGE_OK
        self.lost: set[str] = set()
        """The present losses: `STATION`, `RADIO`, `POSITION`."""
        self._station_s: float | None = None  # last heartbeat of the ground station
        self._position_s: float | None = None  # since when nothing helps the filter
        self._gone_after_s = 0.0
        self._consumed_mah = 0.0

    @property
    @abstractmethod
    def active(self) -> bool:
        """True if the heartbeat reports CRITICAL."""

    def note_station(self, now_s: float) -> None:
        """Note a heartbeat of the ground station."""
        self._station_s = now_s

    def silent_s(self, now_s: float) -> float:
        """Return the silence of the ground station, s; below 0 before its first message."""
        return -1.0 if self._station_s is None else now_s - self._station_s

    def has_lost_position(self, now_s: float) -> bool:
        """Return whether the filter has no position any more."""
        return self._position_s is not None and now_s - self._position_s >= self._gone_after_s

    def is_fresh_pack(self, craft: Craft) -> bool:
        """Return whether the battery was swapped since the last call; its charge is good then."""
        before_mah, self._consumed_mah = self._consumed_mah, craft.battery.consumed_mah
        if self._consumed_mah >= before_mah:
            return False
        self.charge_state = CHARGE_OK
        return True

    def begins(self, craft: Craft, what: str, lost: bool) -> bool:
        """Return whether a loss begins; report it when one ends."""
        if lost == (what in self.lost):
            return False
        if lost:
            self.lost.add(what)
        else:
            self.lost.remove(what)
            if what in self.ended:
                craft.send_text(*self.ended[what])
        return lost

    def loses_position(self, craft: Craft, holds_out_s: float, *, matters: bool = True) -> bool:
        """Return whether the loss of the position begins.

        Without aiding the filter holds out for `holds_out_s`, at most the shortest time given
        since. `matters`: it is in the air, under the autopilot's control.
        """
        if not craft.position_lost:
            self._position_s = None
            return self.begins(craft, POSITION, False)
        if self._position_s is None:
            self._position_s, self._gone_after_s = craft.t_s, math.inf
        self._gone_after_s = min(self._gone_after_s, holds_out_s)
        gone = matters and self.has_lost_position(craft.t_s)
        return self.begins(craft, POSITION, gone or POSITION in self.lost)

    def breaks_fences(self, craft: Craft) -> int:
        """Return the fences, bits of FENCE_TYPE, that were broken since the last call."""
        return craft.fence.watch(
            craft.parameters, craft.home, craft.estimate.place, craft.t_s,
            flying=craft.armed and craft.airborne,
        )  # fmt: skip
