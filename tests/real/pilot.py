"""The second link to an autopilot: commands and observations of a pilot or a ground station."""

from __future__ import annotations

import asyncio
import contextlib
import math
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import LatLon
from tests.real.sockets import Address, Socket

Message: TypeAlias = Any  # pymavlink carries no types

SYSTEM: Final = 255
_TRIES: Final = 6
_ANSWER_S: Final = 2.0
_LIST_S: Final = 90.0
_STICKS_S: Final = 0.1
FENCE: Final = mav.MAV_MISSION_TYPE_FENCE
RALLY: Final = mav.MAV_MISSION_TYPE_RALLY


@dataclass(frozen=True, slots=True)
class Item:
    """A point of a fence or a rally point, as an autopilot keeps it."""

    command: int
    param1: float
    lat_e7: int
    lon_e7: int
    height_m: float = 0.0


class Pilot:
    def __init__(
        self, system: int, mode_of: Callable[[Message], str], *, bytewise: bool,
        peer: Address | None = None,
    ) -> None:  # fmt: skip
        self.system, self._mode_of, self._bytewise, self._peer = system, mode_of, bytewise, peer
        self.latest: dict[str, Message] = {}
        self.time_s = 0.0
        """Time by the vehicle's own clock, s."""
        self.modes: list[tuple[float, str]] = []
        """Modes of the heartbeats, each with its time, at each change."""
        self.texts: list[str] = []
        self.sticks: Callable[[], Message] | None = None
        """Task that sends the radio control ten times a second."""
        self.follow: list[Callable[[Message], None]] = []
        self._in = mav.MAVLink(None)
        self._in.robust_parsing = True
        self._out = mav.MAVLink(None, srcSystem=SYSTEM, srcComponent=mav.MAV_COMP_ID_MISSIONPLANNER)
        self._socket = Socket(self._receive)
        self._tasks: list[asyncio.Task[None]] = []

    # --- the socket ------------------------------------------------------------------------------
    async def open(self, port: int) -> None:
        await self._socket.open(port)
        self._tasks = [asyncio.create_task(self._beats()), asyncio.create_task(self._steers())]

    def forget(self) -> None:
        self.latest.clear()
        self.modes.clear()
        self.time_s = 0.0

    def close(self) -> None:
        for task in self._tasks:
            task.cancel()
        self._socket.close()

    def _receive(self, data: bytes, address: Address) -> None:
        self._peer = address
        for message in self._in.parse_buffer(data) or ():
            if message.get_srcSystem() == self.system and message.get_srcComponent() == 1:
                self._handle(message)

    def _handle(self, message: Message) -> None:
        kind = message.get_type()
        if hasattr(message, "time_boot_ms"):
            self.time_s = message.time_boot_ms / 1000.0
        if kind == "STATUSTEXT":
            self.texts.append(message.text)
        elif kind == "HEARTBEAT":
            mode = self._mode_of(message)
            if not self.modes or self.modes[-1][1] != mode:
                self.modes.append((self.time_s, mode))
        self.latest[kind] = message
        for told in list(self.follow):
            told(message)

    def send(self, message: Message) -> None:
        if self._peer is not None:
            self._socket.send(message.pack(self._out), self._peer)
            self._out.seq = (self._out.seq + 1) & 0xFF

    async def _beats(self) -> None:
        while True:
            self.send(mav.MAVLink_heartbeat_message(mav.MAV_TYPE_GCS, 8, 0, 0, 4, 3))
            await asyncio.sleep(0.5)

    async def _steers(self) -> None:
        while True:
            if self.sticks is not None:
                self.send(self.sticks())
            await asyncio.sleep(_STICKS_S)

    # --- what is so ------------------------------------------------------------------------------
    @property
    def mode(self) -> str:
        return self.modes[-1][1] if self.modes else ""

    @property
    def armed(self) -> bool:
        beat = self.latest.get("HEARTBEAT")
        return beat is not None and bool(beat.base_mode & mav.MAV_MODE_FLAG_SAFETY_ARMED)

    @property
    def ready(self) -> bool:
        """Return whether it would arm, and knows its position."""
        status, place = self.latest.get("SYS_STATUS"), self.latest.get("GLOBAL_POSITION_INT")
        checked = status is not None and bool(
            status.onboard_control_sensors_health & mav.MAV_SYS_STATUS_PREARM_CHECK
        )
        return checked and place is not None and place.lat != 0

    @property
    def speed_m_s(self) -> float:
        """Return the speed over ground, as the autopilot estimates it."""
        place = self.latest.get("GLOBAL_POSITION_INT")
        return 0.0 if place is None else math.hypot(place.vx, place.vy) / 100.0

    # --- asking ----------------------------------------------------------------------------------
    async def answer(self, ask: Message, kind: str, **fields: object) -> Message:
        """Ask until a message of a kind has these values of its fields."""
        found: asyncio.Future[Message] = asyncio.get_running_loop().create_future()

        def check(told: Message) -> None:
            so = told.get_type() == kind and not found.done()
            if so and all(getattr(told, key) == value for key, value in fields.items()):
                found.set_result(told)

        self.follow.append(check)
        try:
            for _ in range(_TRIES):
                self.send(ask)
                with contextlib.suppress(TimeoutError):
                    return await asyncio.wait_for(asyncio.shield(found), _ANSWER_S)
        finally:
            self.follow.remove(check)
        raise AssertionError(f"no {kind} {fields} after {ask.get_type()}")

    async def command(self, number: int, *params: float) -> int:
        values = (*params, *([0.0] * (7 - len(params))))
        ask = mav.MAVLink_command_long_message(self.system, 1, number, 0, *values)
        return int((await self.answer(ask, "COMMAND_ACK", command=number)).result)

    async def go_to(self, position: LatLon, amsl_m: float) -> None:
        """Command a flight to a place, as a click on a ground station's map does."""
        at = round(position.lat_deg * 1e7), round(position.lon_deg * 1e7)
        ask = mav.MAVLink_command_int_message(
            self.system, 1, mav.MAV_FRAME_GLOBAL_INT, mav.MAV_CMD_DO_REPOSITION, 0, 0,
            -1, mav.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE, 0, math.nan, *at, amsl_m,
        )  # fmt: skip
        await self.answer(ask, "COMMAND_ACK", command=mav.MAV_CMD_DO_REPOSITION, result=0)

    async def stream(self, message_id: int, rate_hz: float) -> None:
        """Request a message at a rate by the vehicle's clock."""
        await self.command(mav.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, 1e6 / rate_hz)

    async def set_parameter(self, name: str, value: float) -> None:
        ask = mav.MAVLink_param_request_read_message(self.system, 1, name.encode(), -1)
        kind = (await self.answer(ask, "PARAM_VALUE", param_id=name)).param_type
        whole = self._bytewise and kind != mav.MAV_PARAM_TYPE_REAL32
        raw = struct.pack("<i", int(value)) if whole else struct.pack("<f", value)
        sent = struct.unpack("<f", raw)[0]
        setting = mav.MAVLink_param_set_message(self.system, 1, name.encode(), sent, kind)
        await self.answer(setting, "PARAM_VALUE", param_id=name, param_value=sent)

    def _value(self, told: Message) -> float:
        if self._bytewise and told.param_type != mav.MAV_PARAM_TYPE_REAL32:
            return float(struct.unpack("<i", struct.pack("<f", told.param_value))[0])
        return float(told.param_value)

    async def parameters(self) -> dict[str, float]:
        found: dict[int, tuple[str, float]] = {}
        count = [0]

        def check(message: Message) -> None:
            if message.get_type() == "PARAM_VALUE" and message.param_index != 0xFFFF:
                count[0] = message.param_count
                found[message.param_index] = message.param_id, self._value(message)

        self.follow.append(check)
        try:
            self.send(mav.MAVLink_param_request_list_message(self.system, 1))
            async with asyncio.timeout(_LIST_S):
                known = -1
                while not count[0] or len(found) < count[0]:
                    await asyncio.sleep(0.5)
                    if len(found) == known:  # lost items of the list are requested one by one
                        missing = [index for index in range(count[0]) if index not in found]
                        for index in missing[:40]:
                            self.send(
                                mav.MAVLink_param_request_read_message(self.system, 1, b"", index)
                            )
                    known = len(found)
        finally:
            self.follow.remove(check)
        return dict(found.values())

    async def items(self, kind: int) -> list[Item]:
        ask = mav.MAVLink_mission_request_list_message(self.system, 1, kind)
        count = (await self.answer(ask, "MISSION_COUNT", mission_type=kind)).count
        found = []
        for index in range(count):
            ask = mav.MAVLink_mission_request_int_message(self.system, 1, index, kind)
            told = await self.answer(ask, "MISSION_ITEM_INT", seq=index, mission_type=kind)
            found.append(Item(told.command, told.param1, told.x, told.y, round(told.z, 2)))
        self.send(mav.MAVLink_mission_ack_message(self.system, 1, 0, kind))
        return found

    async def give(self, kind: int, items: Sequence[Item]) -> None:
        """Have the autopilot keep these items."""

        def serve(message: Message) -> None:
            if message.get_type().startswith("MISSION_REQUEST") and message.mission_type == kind:
                item = items[message.seq]
                self.send(
                    mav.MAVLink_mission_item_int_message(
                        self.system, 1, message.seq, mav.MAV_FRAME_GLOBAL_RELATIVE_ALT,
                        item.command, 0, 1, item.param1, 0, 0, 0, item.lat_e7, item.lon_e7,
                        item.height_m, kind,
                    )
                )  # fmt: skip

        self.follow.append(serve)
        try:
            ask = mav.MAVLink_mission_count_message(self.system, 1, len(items), kind)
            done = await self.answer(ask, "MISSION_ACK", mission_type=kind)
        finally:
            self.follow.remove(serve)
        assert done.type == 0, f"the fence was not taken: {done.type}"


def changed(before: Mapping[str, float], after: Mapping[str, float]) -> dict[str, str]:
    return {
        name: f"{before.get(name)} to {after.get(name)}"
        for name in sorted({*before, *after})
        if before.get(name) != after.get(name)
    }
