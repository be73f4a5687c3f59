"""Aircraft of others in the world: each flies straight and has a transponder."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.geo.geodesy import LocalPlane
from missions.units import LatLon
from sitl.codec import Message

_ADSB_ALL = (
    mav.ADSB_FLAGS_VALID_COORDS
    | mav.ADSB_FLAGS_VALID_ALTITUDE
    | mav.ADSB_FLAGS_VALID_HEADING
    | mav.ADSB_FLAGS_VALID_VELOCITY
    | mav.ADSB_FLAGS_VALID_CALLSIGN
    | mav.ADSB_FLAGS_SIMULATED
)
_UTM_ALL = (
    mav.UTM_DATA_AVAIL_FLAGS_UAS_ID_AVAILABLE
    | mav.UTM_DATA_AVAIL_FLAGS_POSITION_AVAILABLE
    | mav.UTM_DATA_AVAIL_FLAGS_ALTITUDE_AVAILABLE
    | mav.UTM_DATA_AVAIL_FLAGS_HORIZONTAL_VELO_AVAILABLE
)
_FIRST_ADDRESS = 0x4B0001


@dataclass(frozen=True, slots=True)
class Intruder:
    """An aircraft of others, from `at_s` of the world's time on.

    Attributes:
        position: Its place at `at_s`.
        height_m: Above the world's plane.
        toward_deg: True bearing of its flight.
        for_s: Time for which its transponder sends.
        name: Its call sign; `utm` sends none.
        kind: The kind of messages that a receiver makes of it.
    """

    position: LatLon
    height_m: float
    toward_deg: float = 0.0
    speed_m_s: float = 0.0
    at_s: float = 0.0
    for_s: float = math.inf
    name: str = ""
    kind: Literal["adsb", "utm"] = "adsb"

    def report(self, number: int, plane: LocalPlane, amsl_m: float, t_s: float) -> Message | None:
        """Return what receivers report at a time; None while it does not send."""
        flown_s = t_s - self.at_s
        if not 0.0 <= flown_s <= self.for_s:
            return None
        toward = math.radians(self.toward_deg)
        v_east, v_north = self.speed_m_s * math.sin(toward), self.speed_m_s * math.cos(toward)
        east, north = plane.to_plane(self.position)
        place = plane.to_wgs84(east + v_east * flown_s, north + v_north * flown_s)
        lat, lon = round(place.lat_deg * 1e7), round(place.lon_deg * 1e7)
        millimetres = round((amsl_m + self.height_m) * 1000.0)
        if self.kind == "utm":
            ident = [*number.to_bytes(2, "big"), *([0x5A] * 16)]
            velocity = round(v_north * 100.0), round(v_east * 100.0), 0
            return mav.MAVLink_utm_global_position_message(
                0, ident, lat, lon, millimetres, 0, *velocity, 0, 0, 0, 0, 0, 0, 100,
                mav.UTM_FLIGHT_STATE_AIRBORNE, _UTM_ALL,
            )  # fmt: skip
        return mav.MAVLink_adsb_vehicle_message(
            _FIRST_ADDRESS + number, lat, lon, mav.ADSB_ALTITUDE_TYPE_GEOMETRIC, millimetres,
            round(self.toward_deg % 360.0 * 100.0), round(self.speed_m_s * 100.0), 0,
            self.name.encode("ascii", "replace")[:8], mav.ADSB_EMITTER_TYPE_ROTOCRAFT, 0,
            _ADSB_ALL, 0,
        )  # fmt: skip


def reports(
    traffic: tuple[Intruder, ...], plane: LocalPlane, amsl_m: float, t_s: float
) -> Iterator[Message]:
    """Yield what receivers report of all at a time."""
    for number, intruder in enumerate(traffic):
        if (message := intruder.report(number, plane, amsl_m, t_s)) is not None:
            yield message
