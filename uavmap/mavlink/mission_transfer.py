"""Lists of places on an autopilot, by MAVLink's mission protocol: a fence, rally points.

The vehicle drives an upload and asks for each item; we drive a download, and acknowledge its end.
One transfer runs at a time. A vehicle repeats a request after a second, however slow the link. Each
answered copy brings an item twice, and an ArduPilot answers the second with INVALID_SEQUENCE and
continues (`MissionItemProtocol.cpp`). So a repeated request is answered once in the round-trip
time, which is measured. This result ends nothing while the vehicle still asks.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import CommandRefusedError, LinkError
from missions.units import LatLon
from uavmap.mavlink.session import GROUND_SYSTEM_ID, Message, Session

TRIES: Final = 8
"""Maximum number of sends without an answer."""
WAIT_S: Final = 1.5
WHOLE_TRIES: Final = 3
"""Maximum number of starts of an upload that the vehicle gave up or that a bad link has spoilt."""
LONGEST_TRIP_S: Final = 4.0
"""Maximum wait before a repeated request is answered again, s: vehicles give up after 8 s."""
TRIP_MARGIN: Final = 1.2
"""Maximum round trip of a link, as a multiple of the shortest."""
PLACE_E7: Final = 2
"""Tolerance of a place, 1e-7 degrees: a vehicle may keep it as a float."""
HEIGHT_M: Final = 1.0
"""Tolerance of a rally point's height, m: an ArduPilot keeps whole metres."""

_RESULTS: Final = {
    number: value.name.removeprefix("MAV_MISSION_").lower().replace("_", " ")
    for number, value in mav.enums["MAV_MISSION_RESULT"].items()
}
_LOST: Final = (mav.MAV_MISSION_OPERATION_CANCELLED, mav.MAV_MISSION_INVALID_SEQUENCE)
"""Results of an upload that a bad link has spoilt: a new start may succeed."""
_FRAMES: Final = {
    mav.MAV_FRAME_GLOBAL_INT: mav.MAV_FRAME_GLOBAL,
    mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT: mav.MAV_FRAME_GLOBAL_RELATIVE_ALT,
    mav.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT: mav.MAV_FRAME_GLOBAL_TERRAIN_ALT,
}
"""Frames of a PX4's items, and the equivalent ones by which it flies.

Its return to a rally point in frame 5 or 6 hangs in the air (`rtl.cpp`).
"""


class Kind(IntEnum):
    """The lists of an autopilot, by MAV_MISSION_TYPE."""

    FENCE = mav.MAV_MISSION_TYPE_FENCE
    RALLY = mav.MAV_MISSION_TYPE_RALLY

    @property
    def words(self) -> str:
        """Name of the list."""
        return "the fence" if self is Kind.FENCE else "the rally points"


@dataclass(frozen=True, slots=True)
class Item:
    """A mission item.

    Attributes:
        command: MAV_CMD.
        position: Position of the item; zeros with MAV_FRAME_MISSION.
        first: param1: vertices of a polygon, a radius.
        frame: MAV_FRAME, one of those without INT in their names.
        height_m: Height in this frame.
        others: param2 to param4; NaN: the autopilot chooses. Fence and rally points have none.
    """

    command: int
    position: LatLon
    first: float = 0.0
    frame: int = mav.MAV_FRAME_GLOBAL
    height_m: float = 0.0
    others: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def equals(self, other: Item) -> bool:
        """Return whether both mean the same. A fence's frames and heights do not count.

        >>> here = Item(mav.MAV_CMD_NAV_RALLY_POINT, LatLon(47.0, 8.0))
        >>> here.equals(Item(mav.MAV_CMD_NAV_RALLY_POINT, LatLon(47.0, 8.0000001)))
        True
        >>> here.equals(Item(mav.MAV_CMD_NAV_RALLY_POINT, LatLon(47.0, 8.0), height_m=30.0))
        False
        """
        off = (
            abs(self.position.lat_deg - other.position.lat_deg),
            abs(self.position.lon_deg - other.position.lon_deg),
        )
        near = all(degrees * 1e7 <= PLACE_E7 + 0.5 for degrees in off)
        if self.command == mav.MAV_CMD_NAV_RALLY_POINT:
            near &= self.frame == other.frame and abs(self.height_m - other.height_m) <= HEIGHT_M
        return (self.command, self.first) == (other.command, other.first) and near


def same_items(wanted: Sequence[Item], found: Sequence[Item]) -> bool:
    """Return whether a list was read back as it was sent."""
    return len(wanted) == len(found) and all(
        a.equals(b) for a, b in zip(wanted, found, strict=True)
    )


class MissionTransfer:
    """Fence and rally points of one vehicle."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._kind: Kind | None = None
        self._sending: Sequence[Item] | None = None
        self._received: list[Message] = []
        self._trip_s = 0.0
        """Shortest measured round trip, s."""
        self._sent_s: dict[int, tuple[float, float]] = {}
        """Times of the first and last send of each item; -1: the opening."""
        session.listen(self._on_message)

    # --- upload -------------------------------------------------------------------------------
    async def upload(self, kind: Kind, items: Sequence[Item]) -> None:
        """Replace the vehicle's list; an empty one clears it.

        Raises `CommandRefusedError` with the vehicle's reason, `LinkError` when it falls silent.
        """
        for attempt in range(WHOLE_TRIES):
            result = await self._replaced(kind, items)
            if result == mav.MAV_MISSION_ACCEPTED:
                return
            if result not in _LOST or attempt == WHOLE_TRIES - 1:
                raise CommandRefusedError(
                    f"upload of {kind.words} refused: {_RESULTS.get(result, result)}"
                    + self._session.view.recent_texts()
                )

    async def _replaced(self, kind: Kind, items: Sequence[Item]) -> int:
        view = self._session.view
        address = view.system_id, view.autopilot_component
        opening = mav.MAVLink_mission_clear_all_message(*address, kind)
        if items:
            opening = mav.MAVLink_mission_count_message(*address, len(items), kind)
        self._begin(kind, items or None)
        try:
            return await self._acknowledged(opening)
        finally:
            self._end()

    async def _acknowledged(self, opening: Message) -> int:
        """Return the MAV_MISSION_RESULT that ends a transfer; items are sent on request.

        The opening is repeated until the vehicle asks by itself. Silence after the last item means
        a lost acknowledgement: the item, sent once more, is acknowledged once more.
        """
        asked = -1
        spoilt: int | None = None
        last = -1 if self._sending is None else len(self._sending) - 1
        for _ in range(TRIES):
            if asked < 0:
                self._note_sent(-1)
                self._session.send(opening)
            elif asked == last:
                self._send_item(asked)
            while (message := await self._next()) is not None:
                if message.get_type() != "MISSION_ACK":
                    asked, spoilt = getattr(message, "seq", asked), None
                elif message.type == mav.MAV_MISSION_INVALID_SEQUENCE and asked >= 0:
                    spoilt = int(message.type)
                elif message.type != mav.MAV_MISSION_ACCEPTED or asked == last:
                    return int(message.type)  # else it accepts items from before this
            if spoilt is not None:
                return spoilt
        if asked >= 0:
            return int(mav.MAV_MISSION_OPERATION_CANCELLED)  # it gave up, and that message was lost
        raise LinkError("the vehicle does not answer the mission protocol")

    # --- download -----------------------------------------------------------------------------
    async def download(self, kind: Kind) -> tuple[Item, ...]:
        """Return the vehicle's list.

        Raises `CommandRefusedError` if it has none, `LinkError` if it is silent.
        """
        view = self._session.view
        address = view.system_id, view.autopilot_component
        self._begin(kind, None)
        try:
            listing = mav.MAVLink_mission_request_list_message(*address, kind)
            count = (await self._answer(listing, "MISSION_COUNT", kind)).count
            items: list[Item] = []
            for seq in range(count):
                request = mav.MAVLink_mission_request_int_message(*address, seq, kind)
                items.append(_item(await self._answer(request, "MISSION_ITEM_INT", kind, seq)))
            self._session.send(
                mav.MAVLink_mission_ack_message(*address, mav.MAV_MISSION_ACCEPTED, kind)
            )
        finally:
            self._end()
        return tuple(items)

    async def _answer(
        self, request: Message, name: str, kind: Kind, seq: int | None = None
    ) -> Message:
        for _ in range(TRIES):
            self._session.send(request)
            while (message := await self._next()) is not None:
                if message.get_type() == name and (seq is None or message.seq == seq):
                    return message
                if message.get_type() == "MISSION_ACK" and message.type:
                    reason = _RESULTS.get(message.type, message.type)
                    raise CommandRefusedError(f"download of {kind.words} refused: {reason}")
        raise LinkError(f"download of {kind.words} failed: the vehicle does not answer")

    # --- both ---------------------------------------------------------------------------------
    def _begin(self, kind: Kind, items: Sequence[Item] | None) -> None:
        self._kind, self._sending = kind, items
        self._received.clear()
        self._sent_s.clear()

    def _end(self) -> None:
        self._kind = self._sending = None

    async def _next(self) -> Message | None:
        wait_s = max(WAIT_S, self._session.ack_wait_s, 1.5 * self._trip_s)
        if not await self._session.until(lambda: bool(self._received), wait_s):
            return None
        return self._received.pop(0)

    def _on_message(self, message: Message) -> None:
        if self._kind is None or not message.get_type().startswith("MISSION_"):
            return
        if getattr(message, "mission_type", None) != self._kind:
            return
        if message.target_system not in (0, GROUND_SYSTEM_ID):
            return  # a ground station has a transfer as well
        name = message.get_type()
        if name in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):
            self._answer_request(message.seq)
        self._received.append(message)

    def _answer_request(self, seq: int) -> None:
        """Answer a request, if no answer to a copy of it can be on its way."""
        now_s = asyncio.get_running_loop().time()
        if seq not in self._sent_s and seq - 1 in self._sent_s:
            trip_s = now_s - self._sent_s[seq - 1][0]
            self._trip_s = min(self._trip_s or trip_s, trip_s)
        _, sent_s = self._sent_s.get(seq, (0.0, float("-inf")))
        if now_s - sent_s >= min(TRIP_MARGIN * self._trip_s, LONGEST_TRIP_S):
            self._send_item(seq)

    def _note_sent(self, seq: int) -> None:
        now_s = asyncio.get_running_loop().time()
        self._sent_s[seq] = (self._sent_s.get(seq, (now_s, now_s))[0], now_s)

    def _send_item(self, seq: int) -> None:
        items, view = self._sending, self._session.view
        if items is None or self._kind is None or not 0 <= seq < len(items):
            return
        self._note_sent(seq)
        item = items[seq]
        self._session.send(
            mav.MAVLink_mission_item_int_message(
                view.system_id,
                view.autopilot_component,
                seq,
                item.frame,
                item.command,
                0,
                1,
                item.first,
                *item.others,
                round(item.position.lat_deg * 1e7),
                round(item.position.lon_deg * 1e7),
                item.height_m,
                self._kind,
            )
        )


def _item(message: Message) -> Item:
    place = LatLon(message.x / 1e7, message.y / 1e7)
    frame = _FRAMES.get(message.frame, message.frame)
    return Item(message.command, place, message.param1, frame, message.z)
