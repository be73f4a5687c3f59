"""What is measured over a link before a flight: rates, losses, the way there and back, the fix."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from uavmap.mavlink.session import Message, Session
from uavmap.mavlink.vehicle_view import EKF_ABSOLUTE

MEASURE_S: Final = 4.0
"""So long a link is listened to."""
TOLD_S: Final = 8.0
"""So much longer what has not been told yet is waited for."""
PINGS: Final = 5
_NS: Final = 1e9
_NO_VOLTAGE_MV: Final = 65_535


@dataclass(frozen=True, slots=True)
class Measured:
    """What a few seconds of listening have told."""

    frames_hz: float
    """Frames of the autopilot that arrived."""
    lost_share: float
    """0 to 1: of the autopilot's frames, those whose number is missing."""
    round_trip_s: float | None
    """The median of some answers to TIMESYNC; None where none came."""
    fix: Message | None
    """The last GPS_RAW_INT."""
    volts: float | None
    """Of the battery, as SYS_STATUS has it."""
    version: str
    """Of the autopilot's firmware; empty where it was not told."""


class Listener:
    """Listens to a session; make one early, for it only knows what was said since."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._fix: Message | None = None
        self._volts: float | None = None
        self._version = ""
        self._sent_ns: dict[int, float] = {}
        self._trips_s: list[float] = []
        session.listen(self._on_message)

    async def measure(self, seconds: float = MEASURE_S) -> Measured:
        """Listen for a while, and ask for what does not come by itself.

        What the findings judge is waited for a little longer: telemetry that begins late, over a
        slow link or from a busy machine, is no fault of the vehicle, nor is an estimator that was
        switched on a moment ago.
        """
        session, view = self._session, self._session.view
        loop = asyncio.get_running_loop()
        sender = view.system_id, view.autopilot_component
        heard, missing = session.losses.counts(sender)
        begin_s = loop.time()
        for _ in range(PINGS):
            self._ping(loop.time())
            self._ask()
            await asyncio.sleep(seconds / PINGS)
        until_s = loop.time() + max(TOLD_S, 4.0 * session.ack_wait_s)
        while not self._all_told() and loop.time() < until_s:
            self._ask()
            await session.until(self._all_told, seconds / PINGS)
        heard_after, missing_after = session.losses.counts(sender)
        heard, missing = heard_after - heard, missing_after - missing
        trips_s = sorted(self._trips_s)
        return Measured(
            frames_hz=heard / max(loop.time() - begin_s, 1e-6),
            lost_share=missing / max(heard + missing, 1),
            round_trip_s=trips_s[len(trips_s) // 2] if trips_s else None,
            fix=self._fix,
            volts=self._volts,
            version=self._version,
        )

    def _ask(self) -> None:
        """For what does not come by itself, or was told before it was good."""
        if not _fixed(self._fix):
            self._session.request(mav.MAVLINK_MSG_ID_GPS_RAW_INT)
        if not self._version or self._session.view.identity is None:
            self._session.request(mav.MAVLINK_MSG_ID_AUTOPILOT_VERSION)

    def _all_told(self) -> bool:
        """Fix, estimator, place and battery: without them a vehicle counts as not able to fly."""
        view = self._session.view
        return (
            _fixed(self._fix)
            and bool(view.ekf_flags & EKF_ABSOLUTE)
            and view.position is not None
            and (view.battery_percent is not None or view.energy_consumed_j is not None)
        )

    def _ping(self, now_s: float) -> None:
        # its own time back tells which question was answered; zero would be no question
        asked_ns = round(now_s * _NS) + 1
        self._sent_ns[asked_ns] = now_s
        self._session.send(mav.MAVLink_timesync_message(0, asked_ns))

    def _on_message(self, message: Message) -> None:
        name = message.get_type()
        if name == "GPS_RAW_INT":
            self._fix = message
        elif name == "SYS_STATUS" and 0 < message.voltage_battery < _NO_VOLTAGE_MV:
            self._volts = message.voltage_battery / 1000.0
        elif name == "AUTOPILOT_VERSION":
            self._version = _version(message.flight_sw_version)
        elif name == "TIMESYNC" and message.tc1 != 0:
            sent_s = self._sent_ns.pop(message.ts1, None)
            if sent_s is not None:
                self._trips_s.append(asyncio.get_running_loop().time() - sent_s)


def _fixed(fix: Message | None) -> bool:
    return fix is not None and fix.fix_type >= mav.GPS_FIX_TYPE_3D_FIX


def _version(number: int) -> str:
    """In words: a byte each for major, minor and patch.

    >>> _version(0x040601FF)
    '4.6.1'
    """
    return f"{number >> 24 & 0xFF}.{number >> 16 & 0xFF}.{number >> 8 & 0xFF}" if number else ""
