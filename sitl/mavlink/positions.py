"""Positions that others tell the autopilot: GPS_INPUT, VISION_POSITION_ESTIMATE, ODOMETRY."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.codec.wire import Message
from sitl.copter.aircraft import Aircraft
from sitl.copter.fence import Place

_NORTH_NORTH, _EAST_EAST = 0, 6  # in the upper triangle of a covariance
_NO_ACCURACY: int = mav.GPS_INPUT_IGNORE_FLAG_HORIZONTAL_ACCURACY
_BAD_QUALITY = -1

ARDUPILOT_FRAMES: tuple[int, ...] = (mav.MAV_FRAME_LOCAL_FRD,)
PX4_FRAMES: tuple[int, ...] = (mav.MAV_FRAME_LOCAL_FRD, mav.MAV_FRAME_LOCAL_NED)
"""In which ODOMETRY is taken; both lie north here."""


@dataclass
class ToldPositions:
    """What arrives, put into the world's plane.

    Local positions are north and east of the origin (GPS_GLOBAL_ORIGIN). The time of arrival
    counts. `locate` puts a latitude and longitude (1e7) there, None where there is no such place.
    """

    aircraft: Aircraft
    origin: Callable[[], Place]
    locate: Callable[[int, int], Place | None]
    frames: Collection[int]
    """Of ODOMETRY that are taken."""

    def __post_init__(self) -> None:
        self.handlers: dict[str, Callable[[Message], bytes]] = {
            "GPS_INPUT": self._gps_input,
            "VISION_POSITION_ESTIMATE": self._vision,
            "ODOMETRY": self._odometry,
        }

    def _gps_input(self, m: Message) -> bytes:
        place = self.locate(m.lat, m.lon)
        if place is not None:
            sigma_m = 0.0 if m.ignore_flags & _NO_ACCURACY else _told(m.horiz_accuracy)
            self.aircraft.aiding.receiver(place[0], place[1], sigma_m, m.fix_type)
        return b""

    def _vision(self, m: Message) -> bytes:
        self._local(m.x, m.y, m.covariance, m.reset_counter)
        return b""

    def _odometry(self, m: Message) -> bytes:
        bodily = m.child_frame_id == mav.MAV_FRAME_BODY_FRD
        if m.frame_id in self.frames and bodily and m.quality != _BAD_QUALITY:
            self._local(m.x, m.y, m.pose_covariance, m.reset_counter)
        return b""

    def _local(self, x: float, y: float, covariance: Sequence[float], resets: int) -> None:
        if not (math.isfinite(x) and math.isfinite(y) and self.aircraft.home_known):
            return
        east, north, _ = self.origin()
        variance = 0.5 * (_told(covariance[_NORTH_NORTH]) + _told(covariance[_EAST_EAST]))
        self.aircraft.aiding.vision(east + y, north + x, math.sqrt(variance), resets)


def _told(value: float) -> float:
    """A number that says something; 0 where it is not known.

    >>> _told(math.nan), _told(0.25)
    (0.0, 0.25)
    """
    return value if math.isfinite(value) and value > 0.0 else 0.0
