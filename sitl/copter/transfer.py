"""The vehicle's side of MAVLink's mission protocol: missions, fences and rally points.

A pure state machine of messages and time. The vehicle drives an upload: it requests each item,
again after a second, and gives up after eight without one. A stalled upload leaves a truncated
mission behind, as on the real vehicle; a fence takes effect only when it is complete. This is
ArduPilot's behaviour; PX4's differences are arguments of `Transfer`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.codec import Message
from sitl.copter.mission_items import ALL, FENCE, MISSION, OK, RALLY, Item, check, check_fence

_RETRY_S, _GIVE_UP_S = 1.0, 8.0
_SOON_S = 1e-6
_MOST = {MISSION: 724, FENCE: 250, RALLY: 80}
_NAMES = {MISSION: "Mission", FENCE: "Fence", RALLY: "Rally"}
_DONE = {
    MISSION: "Flight plan received", FENCE: "Fence received", RALLY: "Rally points received",
}  # fmt: skip
_DENIED: int = mav.MAV_MISSION_DENIED
_UNSUPPORTED: int = mav.MAV_MISSION_UNSUPPORTED
_INT_FRAMES: dict[int, int] = {
    mav.MAV_FRAME_GLOBAL: mav.MAV_FRAME_GLOBAL_INT,
    mav.MAV_FRAME_GLOBAL_RELATIVE_ALT: mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
}


Plans: TypeAlias = dict[int, list[Item]]
"""A list for each MAV_MISSION_TYPE. Where item 0 of a mission is home, it begins with item 1."""


@dataclass(slots=True)
class _Upload:
    kind: int
    count: int
    partner: tuple[int, int]
    asked_s: float
    received_s: float
    received: list[Item] = field(default_factory=list)


@dataclass(kw_only=True)
class Transfer:
    """Answers the messages of the mission protocol, and requests missing items.

    Attributes:
        home: Returns home as an item; without it item 0 is an item as any other.
        running: Whether the mission is being flown.
        changed: Receives the kind of a list that has changed.
        send_text: Receives severity and text.
        ask_int: Request with MISSION_REQUEST_INT instead of MISSION_REQUEST.
        whole: A list takes effect only when it is complete, as fences always do.
        int_frames: A MISSION_ITEM_INT has the frame of that kind, 5 for 0 and 6 for 3.
        answers_copies: A second copy of an item is answered by INVALID_SEQUENCE.
        check: Returns the MAV_MISSION_RESULT for an item of a list.
    """

    plans: Plans
    home: Callable[[], Item] | None
    running: Callable[[], bool]
    changed: Callable[[int], None]
    send_text: Callable[[int, str], None]
    ask_int: bool = False
    retry_s: float = _RETRY_S
    give_up_s: float = _GIVE_UP_S
    whole: bool = False
    int_frames: bool = False
    answers_copies: bool = True
    check: Callable[[int, Item], int] = check

    def __post_init__(self) -> None:
        self._at_once = () if self.whole else (MISSION, RALLY)  # these change while they arrive
        self._frames = _INT_FRAMES if self.int_frames else {}
        self._upload: _Upload | None = None
        self._finished: tuple[int, int, tuple[int, int]] | None = None
        self._handlers: dict[str, Callable[[Message, float], list[Message]]] = {
            "MISSION_COUNT": self._count,
            "MISSION_ITEM": self._item,
            "MISSION_ITEM_INT": self._item,
            "MISSION_REQUEST_LIST": self._list,
            "MISSION_REQUEST": self._request,
            "MISSION_REQUEST_INT": self._request,
            "MISSION_CLEAR_ALL": self._clear,
            # part of a mission cannot be replaced
            "MISSION_WRITE_PARTIAL_LIST": lambda m, _: [_ack(m, _UNSUPPORTED)],
        }
        self.handled = tuple(self._handlers)

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Return the answers to a message of the protocol for this vehicle."""
        all_ = message.mission_type == ALL and message.get_type() == "MISSION_CLEAR_ALL"
        if message.mission_type not in self.plans and not all_:
            return [_ack(message, _UNSUPPORTED)]
        return self._handlers[message.get_type()](message, now_s)

    def step(self, now_s: float) -> list[Message]:
        """Request a missing item again, or give up."""
        upload = self._upload
        if upload is None:
            return []
        if now_s - upload.received_s >= self.give_up_s - _SOON_S:
            self._break_off(upload)
            self.send_text(mav.MAV_SEVERITY_WARNING, f"{_NAMES[upload.kind]} upload timeout")
            result = mav.MAV_MISSION_OPERATION_CANCELLED
            return [mav.MAVLink_mission_ack_message(*upload.partner, result, upload.kind)]
        if now_s - upload.asked_s >= self.retry_s - _SOON_S:
            return [self._ask(upload, now_s)]
        return []

    # --- upload ---------------------------------------------------------------------------------

    def _count(self, m: Message, now_s: float) -> list[Message]:
        partner = _sender(m)
        if self._upload is not None:
            if self._upload.partner != partner:
                return [_ack(m, _DENIED)]
            same = (m.mission_type, m.count) == (self._upload.kind, self._upload.count)
            # A second copy does not begin the upload again, which would lose the received items.
            # After a silence it does, perhaps with other items.
            if same and now_s - self._upload.received_s < self.retry_s:
                return [self._ask(self._upload, now_s)]
            self._break_off(self._upload)
        self._finished = None
        if m.count > _MOST[m.mission_type]:
            return [_ack(m, int(mav.MAV_MISSION_NO_SPACE))]
        upload = _Upload(m.mission_type, m.count, partner, now_s, now_s)
        if m.count == 0:
            self._keep(upload)
            return [_ack(m, OK)]
        if upload.kind in self._at_once:
            self.plans[upload.kind].clear()
            self.changed(upload.kind)
        self._upload = upload
        return [self._ask(upload, now_s)]

    def _ask(self, upload: _Upload, now_s: float) -> Message:
        upload.asked_s = now_s
        build = (
            mav.MAVLink_mission_request_int_message
            if self.ask_int
            else mav.MAVLink_mission_request_message
        )
        return build(*upload.partner, len(upload.received), upload.kind)

    def _item(self, m: Message, now_s: float) -> list[Message]:
        upload, partner = self._upload, _sender(m)
        if upload is None:
            if self._finished == (m.mission_type, m.seq, partner):
                return [_ack(m, OK)]  # the first ACK was lost
            return [_ack(m, int(mav.MAV_MISSION_ERROR))]
        if partner != upload.partner or m.mission_type != upload.kind:
            return [_ack(m, _DENIED)]
        expected = len(upload.received)
        if m.seq < expected and not self.answers_copies:
            return []  # a second copy; the next one has been asked for
        if m.seq != expected:
            return [_ack(m, int(mav.MAV_MISSION_INVALID_SEQUENCE))]
        item = Item.from_message(m)
        result = self.check(upload.kind, item)
        if result == OK:
            upload.received.append(item)
            upload.received_s = now_s
            if upload.kind in self._at_once:
                self.plans[upload.kind].append(item)
            if len(upload.received) < upload.count:
                return [self._ask(upload, now_s)]
            result = self._keep(upload)
        if result == OK:
            self._upload = None
            self._finished = (upload.kind, m.seq, partner)
        else:
            self._break_off(upload)
        return [_ack(m, result)]

    def _break_off(self, upload: _Upload) -> None:
        """End an upload; what has come of a mission or of rally points stays."""
        self._upload = None
        if upload.kind in self._at_once:
            self.changed(upload.kind)

    def _keep(self, upload: _Upload) -> int:
        result = check_fence(upload.received) if upload.kind == FENCE else OK
        if result == OK:
            self.plans[upload.kind][:] = upload.received
            self.changed(upload.kind)
            self.send_text(mav.MAV_SEVERITY_INFO, _DONE[upload.kind])
        return result

    # --- download -------------------------------------------------------------------------------

    def _list(self, m: Message, _now_s: float) -> list[Message]:
        if self._upload is not None:
            return [_ack(m, _DENIED)]
        count = len(self.plans[m.mission_type])
        return [mav.MAVLink_mission_count_message(*_sender(m), count, m.mission_type)]

    def _request(self, m: Message, _now_s: float) -> list[Message]:
        items = self.plans[m.mission_type]
        if m.mission_type == MISSION and m.seq == 0 and self.home is not None:
            item = self.home()
        elif m.seq < len(items):
            item = items[m.seq]
        else:
            return [_ack(m, int(mav.MAV_MISSION_INVALID_SEQUENCE))]
        exact = m.get_type() == "MISSION_REQUEST_INT"
        if exact:
            item = replace(item, frame=self._frames.get(item.frame, item.frame))
        return [item.message(m.seq, m.mission_type, _sender(m), exact=exact)]

    # --- the rest -------------------------------------------------------------------------------

    def _clear(self, m: Message, _now_s: float) -> list[Message]:
        kinds = list(self.plans) if m.mission_type == ALL else [m.mission_type]
        if self._upload is not None:
            return [_ack(m, _DENIED)]
        if MISSION in kinds and self.running():
            return [_ack(m, int(mav.MAV_MISSION_ERROR))]
        for kind in kinds:
            self.plans[kind].clear()
            self.changed(kind)
        self._finished = None
        return [_ack(m, OK)]


def _sender(m: Message) -> tuple[int, int]:
    return m.get_srcSystem(), m.get_srcComponent()


def _ack(m: Message, result: int) -> Message:
    return mav.MAVLink_mission_ack_message(*_sender(m), result, m.mission_type)
