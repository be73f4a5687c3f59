"""The other end of a session, scripted message by message."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import LatLon
from uavmap.mavlink.session import GROUND_SYSTEM_ID, Session

Message = Any


class Peer:
    """A vehicle whose messages a test determines; `received` holds (time, message)."""

    def __init__(self, system: int = 1, component: int = mav.MAV_COMP_ID_AUTOPILOT1) -> None:
        self.received: list[tuple[float, Message]] = []
        self.frames: list[bytes] = []
        self.answer: Callable[[Message], None] = lambda message: None
        self.session = Session(self._handle, self.frames.append)
        self._component = component
        self._in = mav.MAVLink(None)
        self._out = mav.MAVLink(None, srcSystem=system, srcComponent=component)

    def _handle(self, frame: bytes) -> None:
        for message in self._in.parse_buffer(frame) or []:
            self.received.append((asyncio.get_running_loop().time(), message))
            self.answer(message)

    def frame(self, message: Message, component: int | None = None) -> bytes:
        self._out.srcComponent = self._component if component is None else component
        data: bytes = message.pack(self._out)
        self._out.seq = (self._out.seq + 1) & 0xFF
        return data

    def send(
        self, *messages: Message, after_s: float = 0.001, component: int | None = None
    ) -> None:
        """Send messages to the session a moment later, in one piece."""
        data = b"".join(self.frame(message, component) for message in messages)
        asyncio.get_running_loop().call_later(after_s, self.session.feed, data)

    def commands(self) -> list[tuple[float, int, int]]:
        """Return (time, command, confirmation) of every COMMAND_LONG and COMMAND_INT received."""
        return [
            (t_s, m.command, getattr(m, "confirmation", 0))
            for t_s, m in self.received
            if m.get_type().startswith("COMMAND_")
        ]


def heartbeat(
    mode: int = 4, *, armed: bool = False, autopilot: int = mav.MAV_AUTOPILOT_ARDUPILOTMEGA
) -> Message:
    base = mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (mav.MAV_MODE_FLAG_SAFETY_ARMED * armed)
    return mav.MAVLink_heartbeat_message(mav.MAV_TYPE_QUADROTOR, autopilot, base, mode, 4, 3)


def position(
    place: LatLon,
    *,
    t_s: float,
    up_m: float = 12.0,
    amsl_m: float | None = None,
    velocity: tuple[int, int, int] = (0, 0, 0),
) -> Message:
    """Return GLOBAL_POSITION_INT at a time of the vehicle's clock; home is 500 m above the sea."""
    amsl_m = 500.0 + up_m if amsl_m is None else amsl_m
    return mav.MAVLink_global_position_int_message(
        round(t_s * 1000) & 0xFFFFFFFF, round(place.lat_deg * 1e7), round(place.lon_deg * 1e7),
        round(amsl_m * 1000), round(up_m * 1000), *velocity, 0,
    )  # fmt: skip


def ack(command: int, result: int, target: int = GROUND_SYSTEM_ID) -> Message:
    return mav.MAVLink_command_ack_message(command, result, 0, 0, target, 0)


def text(words: str) -> Message:
    return mav.MAVLink_statustext_message(mav.MAV_SEVERITY_CRITICAL, words.encode())
