"""Aircraft of others, as receivers on board report them: ADSB_VEHICLE and UTM_GLOBAL_POSITION.

A receiver forwards broadcasts of strangers. A report without a place is no track. In others, a
field that is missing or makes no sense is unknown. Only the nearest are remembered: memory does not
grow with a flood.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import LatLon
from uavmap.base.printable import printable
from uavmap.mavlink.continuity import distance_m
from uavmap.mavlink.message_gate import RULES, Gate

Message = Any

MAX_AIRCRAFT: Final = 100
"""Maximum number of aircraft that are remembered."""
MAX_REPORT_AGE_S: Final = 60.0
"""Age from which a report is forgotten, s."""
FARTHEST_M: Final = 20_000.0
"""Distance from the vehicle beyond which an aircraft is no traffic, m."""
PRESSURE_ERROR_M: Final = 300.0
"""Largest error of a height by pressure, m: the air's pressure at the sea is not known."""
GEOID_ERROR_M: Final = 110.0
"""Largest error of a height by satellites, m: it may count from the ellipsoid."""
NAME_LENGTH: Final = 12
MAX_SPEED_M_S: Final = 600.0
LOWEST_M: Final = -500.0
HIGHEST_M: Final = 30_000.0
"""Speeds and heights beyond these are unknown."""
_GROUND: Final = (
    mav.ADSB_EMITTER_TYPE_EMERGENCY_SURFACE,
    mav.ADSB_EMITTER_TYPE_SERVICE_SURFACE,
    mav.ADSB_EMITTER_TYPE_POINT_OBSTACLE,
)
"""Emitters that do not fly."""


class TrafficReport(NamedTuple):
    """A report of an aircraft."""

    ident: str
    name: str
    received_s: float
    """When it was there, on the loop's clock."""
    position: LatLon
    amsl_m: float | None
    error_m: float
    velocity_m_s: tuple[float, float] | None
    """Towards true east and true north."""


@dataclass(slots=True)
class LinkTraffic:
    """Reports on one link; `gate` counts refused ones."""

    gate: Gate
    aircraft: dict[str, TrafficReport] = field(default_factory=dict)

    def add(self, message: Message, here: LatLon | None, now_s: float) -> None:
        """Take a message in; `here` is where our vehicle is."""
        kind = message.get_type()
        fault = RULES[kind].fault(message)
        if fault is not None:
            self.gate.refuse(kind, fault, now_s)
            return
        received = _READERS[kind](message, now_s)
        if received is None or here is None or distance_m(received.position, here) > FARTHEST_M:
            return
        before = self.aircraft.get(received.ident)
        if before is None or received.received_s >= before.received_s:
            self.aircraft[received.ident] = received
        if len(self.aircraft) > MAX_AIRCRAFT:
            self._forget(here, now_s)

    def _forget(self, here: LatLon, now_s: float) -> None:
        """Forget old reports, or else the farthest aircraft."""
        recent = [
            one for one in self.aircraft.values() if now_s - one.received_s <= MAX_REPORT_AGE_S
        ]
        recent.sort(key=lambda one: distance_m(one.position, here))
        self.aircraft = {one.ident: one for one in recent[:MAX_AIRCRAFT]}


def _adsb(message: Message, now_s: float) -> TrafficReport | None:
    """Return what an ADSB_VEHICLE holds; None where it has no place, or does not fly."""
    flags = message.flags
    if not flags & mav.ADSB_FLAGS_VALID_COORDS or message.emitter_type in _GROUND:
        return None
    ident = f"{message.ICAO_address & 0xFFFFFF:06X}"
    sign = _text(message.callsign) if flags & mav.ADSB_FLAGS_VALID_CALLSIGN else ""
    by_satellites = message.altitude_type == mav.ADSB_ALTITUDE_TYPE_GEOMETRIC
    moving = mav.ADSB_FLAGS_VALID_HEADING | mav.ADSB_FLAGS_VALID_VELOCITY
    velocity_m_s = None
    toward_deg, speed_m_s = message.heading / 100.0, message.hor_velocity / 100.0
    if flags & moving == moving and toward_deg <= 360.0 and speed_m_s <= MAX_SPEED_M_S:
        toward = math.radians(toward_deg)
        velocity_m_s = speed_m_s * math.sin(toward), speed_m_s * math.cos(toward)
    return TrafficReport(
        f"{ident} {sign}".rstrip(),
        sign or ident,
        now_s - message.tslc,
        LatLon(message.lat / 1e7, message.lon / 1e7),
        _height(message.altitude, flags & mav.ADSB_FLAGS_VALID_ALTITUDE),
        GEOID_ERROR_M if by_satellites else PRESSURE_ERROR_M,
        velocity_m_s,
    )


def _utm(message: Message, now_s: float) -> TrafficReport | None:
    """Return what a UTM_GLOBAL_POSITION holds; None where it has no place, or does not fly."""
    flags = message.flags
    placed = flags & mav.UTM_DATA_AVAIL_FLAGS_POSITION_AVAILABLE
    if not placed or message.flight_state == mav.UTM_FLIGHT_STATE_GROUND:
        return None
    ident = f"system {message.get_srcSystem()}"
    if flags & mav.UTM_DATA_AVAIL_FLAGS_UAS_ID_AVAILABLE:
        ident = bytes(message.uas_id).hex()
    moving = flags & mav.UTM_DATA_AVAIL_FLAGS_HORIZONTAL_VELO_AVAILABLE
    known = flags & mav.UTM_DATA_AVAIL_FLAGS_ALTITUDE_AVAILABLE
    return TrafficReport(
        ident,
        f"UAS {ident[-6:]}",
        now_s,
        LatLon(message.lat / 1e7, message.lon / 1e7),
        _height(message.alt, known),
        GEOID_ERROR_M,
        (message.vy / 100.0, message.vx / 100.0) if moving else None,
    )


def _height(millimetres: int, known: int) -> float | None:
    """Return a height that can be one, m."""
    height_m = millimetres / 1000.0
    return height_m if known and LOWEST_M <= height_m <= HIGHEST_M else None


def _text(value: str | bytes) -> str:
    text = value.decode("ascii", "replace") if isinstance(value, bytes) else value
    return printable(text.split("\0", 1)[0], NAME_LENGTH).strip()


_READERS: Final[Mapping[str, Callable[[Message, float], TrafficReport | None]]] = {
    "ADSB_VEHICLE": _adsb,
    "UTM_GLOBAL_POSITION": _utm,
}
KINDS: Final = frozenset(_READERS)
"""Messages of traffic."""
