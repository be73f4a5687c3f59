"""A session whose MAVLink is read and written by MAVSDK.

The service keeps its own part: the senders of bytes (the transport), the checks (gate and view),
the log. MAVSDK decodes received frames, and encodes, repeats and waits for commands. It does not
send heartbeats, which show that the guardian lives. A vehicle that is called (`udpout`) must
receive them before MAVSDK can know it.

Messages are JSON for MAVSDK, with null for a number that is not finite. Here they are pymavlink's
objects, made of MAVSDK's values: pymavlink's own decoder is used nowhere.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import math
from collections import Counter, defaultdict
from collections.abc import AsyncIterator, Callable, Collection, Iterator, Mapping
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import CommandRefusedError, LinkError
from uavmap.base.printable import printable
from uavmap.mavlink.autopilots import PX4
from uavmap.mavlink.mavsdk.driver_process import JsonObject, MavsdkProcess
from uavmap.mavlink.session import (
    ACK_TRIES,
    ACK_WAIT_S,
    GROUND_SYSTEM_ID,
    Permit,
    Record,
    Session,
    result_name,
)
from uavmap.mavlink.view_updates import is_autopilot

Message = Any

_CLASSES: Final = {made.msgname: made for made in mav.mavlink_map.values()}
_FLOATS: Final = ("float", "double")


def fields_of(message: Message) -> dict[str, Any]:
    """Return a message's fields for MAVSDK."""
    return {name: _plain_value(getattr(message, name)) for name in message.ordered_fieldnames}


def _plain_value(value: Any) -> Any:
    if isinstance(value, bytes | bytearray):
        return value.rstrip(b"\0").decode("ascii", "replace")
    if isinstance(value, list | tuple):
        return [_plain_value(one) for one in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def message_of(name: str, system: int, component: int, fields: Mapping[str, Any]) -> Message | None:
    """Return the message that MAVSDK has decoded; None for an unknown or broken one."""
    made = _CLASSES.get(name)
    if made is None:
        return None
    try:
        values = [_value(fields, *field) for field in _layout(name)]
    except (TypeError, ValueError):
        return None
    message = made(*values)
    message._header = mav.MAVLink_header(made.id, srcSystem=system, srcComponent=component)
    return message


def _value(fields: Mapping[str, Any], name: str, kind: str, length: int) -> Any:
    """Return a field's value; zero for a field that MAVSDK does not know, as of a shorter
    message."""
    if kind == "char":
        return str(fields.get(name) or "").encode()
    if not length:
        return _number(fields.get(name, 0), kind)
    values = fields.get(name, [0] * length)
    if len(values) != length:
        raise ValueError(f"{name} has {len(values)} elements")
    return [_number(one, kind) for one in values]


def _number(value: Any, kind: str) -> float | int:
    """Return a number of a field. Raises `TypeError` if a whole number is missing."""
    if kind in _FLOATS:
        return math.nan if value is None else float(value)
    if not isinstance(value, int):
        raise TypeError(f"no whole number: {value!r}")
    return value


@functools.cache
def _layout(name: str) -> tuple[tuple[str, str, int], ...]:
    """Return of each field, in the order of the constructor: name, kind, length (0: no array)."""
    made = _CLASSES[name]
    lengths = dict(zip(made.ordered_fieldnames, made.array_lengths, strict=True))
    kinds = zip(made.fieldnames, made.fieldtypes, strict=True)
    return tuple((field, kind, lengths[field]) for field, kind in kinds)


_COMMANDS: Final = ("COMMAND_LONG", "COMMAND_INT")
_QUESTIONS: Final = (mav.MAV_CMD_REQUEST_MESSAGE,)
"""Commands that MAVSDK may send at any time: it asks for the kind of vehicle."""

Kind = tuple[int, int]
"""Id of a message, and of the command in it, -1 without one."""


def kind_of(message: Message) -> Kind:
    """Return the kind of a message, which decides on its permission."""
    command = message.command if message.get_type() in _COMMANDS else -1
    return message.get_msgId(), command


class Outbox:
    """The filter of MAVSDK's output: only requested messages may pass to the link.

    The library repeats a command until it is answered. Some of its plug-ins do more than requested:
    they change the mode first, or a rate. A pilot who has taken control must not lose it to a
    repetition, so each frame is checked on its way out. `send` takes the frames.
    """

    def __init__(self, send: Callable[[bytes], None]) -> None:
        self._send = send
        self._codec = mav.MAVLink(None)
        self._codec.robust_parsing = True
        self._asked: defaultdict[int, list[Permit | None]] = defaultdict(list)
        """Commands that are waited for, each with its permit."""
        self._once: Counter[Kind] = Counter()
        """Single messages that were passed to MAVSDK and are not yet sent."""
        self.held_back: Counter[str] = Counter()
        """Number of blocked messages, by kind."""

    @contextlib.contextmanager
    def permitting(self, command: int, permit: Permit | None = None) -> Iterator[None]:
        """Let MAVSDK send a command in the context as often as `permit` grants."""
        self._asked[command].append(permit)
        try:
            yield
        finally:
            self._asked[command].remove(permit)

    def once(self, message: Message) -> None:
        """Let a message pass once."""
        self._once[kind_of(message)] += 1

    def not_sent(self, message: Message) -> None:
        """Withdraw the permission of a message that has not been sent, as far as known."""
        kind = kind_of(message)
        self._once[kind] = max(self._once[kind] - 1, 0)

    def forward(self, data: bytes) -> None:
        """Check MAVSDK's output, and send the permitted part."""
        for message in self._codec.parse_buffer(data) or ():
            if message.get_type() == "BAD_DATA":
                continue
            if self._may_go(message):
                self._send(bytes(message.get_msgbuf()))
            else:
                self.held_back[message.get_type()] += 1

    def _may_go(self, message: Message) -> bool:
        kind = kind_of(message)
        if self._once[kind] > 0:
            self._once[kind] -= 1
            return True
        if kind[1] in _QUESTIONS:
            return True
        return any(permit is None or permit.grants() for permit in self._asked[kind[1]])


MAX_MODE_CHANGE_S: Final = 2.5
"""Time in which a changed mode shows in a heartbeat, s."""
_GROUND_SPEED: Final = 1
_REFUSED: Final = frozenset(
    {
        "COMMAND_DENIED", "COMMAND_DENIED_LANDED_STATE_UNKNOWN", "COMMAND_DENIED_NOT_LANDED",
        "PARAMETER_ERROR", "UNSUPPORTED", "FAILED", "INVALID_ARGUMENT",
    }
)  # fmt: skip
"""MAVSDK's results for a refusal by the vehicle; all others mean that no answer came."""
COMPONENT: Final = int(mav.MAV_COMP_ID_ONBOARD_COMPUTER)
_NOT_SENT: Final = ("", "NO_SYSTEM")
"""MAVSDK's results while it knows no vehicle: the link's silence shows the rest."""


class MavsdkSession(Session):
    """One vehicle at the other end of a link, by MAVSDK (`opened_session`)."""

    def __init__(
        self,
        send: Callable[[bytes], None],
        record: Record,
        ack_wait_s: float = ACK_WAIT_S,
        *,
        say: Callable[[str], None] = lambda text: None,
        speedup: float = 1.0,
    ) -> None:
        super().__init__(send, record, ack_wait_s)
        self._log = say
        self.outbox = Outbox(self._emit)
        self.process = MavsdkProcess(
            GROUND_SYSTEM_ID, COMPONENT, self.outbox.forward, self._receive_object, say, speedup
        )
        self._complained = False

    # --- frames ---------------------------------------------------------------------------
    def _receive(self, message: Message, now_s: float) -> bool:
        """Pass a frame to MAVSDK, which decodes it for the view; return whether it is our
        vehicle's."""
        ours = self._is_ours(message)
        self.process.feed(bytes(message.get_msgbuf()), ours=ours)
        return ours

    def _is_ours(self, message: Message) -> bool:
        if self.view.system_id:
            return bool(message.get_srcSystem() == self.view.system_id)
        wanted = self.view.wanted_system in (None, message.get_srcSystem())
        return wanted and message.get_type() == "HEARTBEAT" and is_autopilot(message)

    def _receive_object(self, content: JsonObject) -> None:
        message = message_of(
            content["name"], content["system"], content["component"], content["fields"]
        )
        if message is not None:
            super()._receive(message, asyncio.get_running_loop().time())
            self._wake()

    def send(self, message: Message) -> None:
        """Have MAVSDK send a message. Raises `LinkError` if a number does not fit into it."""
        if message.get_type() == "HEARTBEAT":
            super().send(message)
            return
        self._packed(message)  # whose numbers fit
        self.outbox.once(message)

        def answered(result: str) -> None:
            if result == "SUCCESS":
                return
            self.outbox.not_sent(message)
            if result not in _NOT_SENT and not self._complained:
                self._complained = True
                self._log(f"MAVSDK does not send {message.get_type()}: {printable(result)}")

        self.process.request(
            answered, do="send", name=message.get_type(), fields=fields_of(message)
        )

    # --- commands -------------------------------------------------------------------------
    async def command(
        self,
        command: int,
        *params: float,
        component: int | None = None,
        done: Callable[[], bool] = lambda: False,
        permit: Permit | None = None,
    ) -> None:
        """Send a command by the plug-in `action` if that does exactly this.

        All others go by `mavlink_direct`, which MAVSDK repeats and waits for in the same way:
        decision 17.
        """
        kind, more = self.view.kind, {}
        if command == mav.MAV_CMD_DO_SET_MODE and kind is PX4 and params == kind.follow_params:
            action = "hold"
        elif command == mav.MAV_CMD_COMPONENT_ARM_DISARM and params == (1,):
            # in some modes it would change the mode first
            await self.until(lambda: self.view.mode == kind.follows, MAX_MODE_CHANGE_S)
            action = "arm"
        elif command == mav.MAV_CMD_DO_CHANGE_SPEED and params[0] == _GROUND_SPEED:
            action, more = "set_current_speed", {"speed_m_s": params[1]}
        elif command == mav.MAV_CMD_NAV_LAND:
            action = "land"
        elif command == mav.MAV_CMD_NAV_RETURN_TO_LAUNCH:
            command, action = mav.MAV_CMD_DO_SET_MODE, "return_to_launch"
        else:
            await super().command(command, *params, component=component, done=done, permit=permit)
            return
        content = await self.ask(command, action, permit, **more)
        result = content["result"]
        if result == "SUCCESS" or done():
            return
        if result in _REFUSED:
            await self.receive_status_texts()
            words = result.lower().replace("_", " ")
            raise CommandRefusedError(
                f"{action} was refused: {words}, by MAVSDK" + self.view.recent_texts()
            )
        raise LinkError(f"{action} was not acknowledged, by MAVSDK: {result}")

    async def ask(
        self, command: int, what: str, permit: Permit | None = None, **more: Any
    ) -> JsonObject:
        """Have MAVSDK carry out a request; its command may pass meanwhile, by the permit."""
        if permit is not None:
            await permit.wait_for_grant()
        with self.outbox.permitting(command, permit):
            return await self.process.ask(do=what, **more)

    async def _until_acknowledged(
        self,
        command: int,
        asked: int,
        message: Callable[[int], Message],
        done: Callable[[], bool] = lambda: False,
        taken: Collection[int] = (mav.MAV_RESULT_ACCEPTED,),
        permit: Permit | None = None,
    ) -> None:
        """Read the answer; MAVSDK repeats the command and waits."""
        name = mav.enums["MAV_CMD"][command].name
        async with self._commanding[asked]:
            result: int | None = None
            for attempt in range(ACK_TRIES):
                if attempt and done():
                    return
                result = await self._result(command, message(0), permit)
                if result in taken or (result is None and done()):
                    return
                if result is None:
                    raise LinkError(f"{name} was not acknowledged, by MAVSDK")
                if result != mav.MAV_RESULT_TEMPORARILY_REJECTED:
                    await self.receive_status_texts()
                    break
                await asyncio.sleep(self.ack_wait_s)
        if result is not None and not done():
            raise CommandRefusedError(
                f"{name} was refused: {result_name(result)}" + self.view.recent_texts()
            )

    async def _result(self, command: int, message: Message, permit: Permit | None) -> int | None:
        """Return the MAV_RESULT of a command; None without an answer."""
        self._packed(message)  # whose numbers fit
        content = await self.ask(
            command, "command", permit, name=message.get_type(), fields=fields_of(message)
        )
        answer = content.get("answer")
        return int(answer["result"]) if content["result"] == "SUCCESS" and answer else None


@contextlib.asynccontextmanager
async def opened_session(
    send: Callable[[bytes], None],
    record: Record,
    ack_wait_s: float,
    say: Callable[[str], None],
    speedup: float,
) -> AsyncIterator[MavsdkSession]:
    """Yield a session with its MAVSDK running until the end of the context.

    Raises `LinkError`.
    """
    session = MavsdkSession(send, record, ack_wait_s, say=say, speedup=speedup)
    await session.process.start()
    say(f"spoken with by MAVSDK {printable(session.process.version)}")
    try:
        yield session
    finally:
        await session.process.close()
