"""A MAVLink 2 conversation with one vehicle: frames in, frames out, commands with their ACKs.

The session keeps the latest messages of the vehicle (`view`), repeats commands until they are
acknowledged, and passes every message to its listeners. It knows nothing of sockets.
"""

from __future__ import annotations

import asyncio
import math
import struct
from collections import defaultdict
from collections.abc import Callable, Collection, Iterator
from typing import Any, Final, Protocol

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import CommandRefusedError, LinkError
from missions.units import LatLon
from uavmap.mavlink.link_traffic import KINDS, LinkTraffic
from uavmap.mavlink.links.framing import Losses
from uavmap.mavlink.links.signing import Signing
from uavmap.mavlink.status_texts import event_text
from uavmap.mavlink.vehicle_view import VehicleView
from uavmap.mavlink.view_updates import update

Message = Any  # pymavlink carries no types
Listener = Callable[[Message], None]
Record = Callable[[bytes], None]

ACK_WAIT_S: Final = 1.0
ACK_TRIES: Final = 5
GROUND_SYSTEM_ID: Final = 245
"""Our own system id: this process flies several vehicles, so it is none of them."""

_READ_BYTES_KEPT: Final = 4096
_MAY_PASS = (mav.MAV_RESULT_TEMPORARILY_REJECTED,)
_RESULT_NAMES: Final[dict[int, str]] = {
    number: value.name.removeprefix("MAV_RESULT_").lower().replace("_", " ")
    for number, value in mav.enums["MAV_RESULT"].items()
} | {9: "unsupported frame"}  # newer than the dialect


class Permit(Protocol):
    """Permission for a command that changes the mode, requested before each copy of it."""

    async def wait_for_grant(self) -> None:
        """Wait until a copy may be sent, and note it. Raises `LinkError`."""

    def grants(self) -> bool:
        """Return whether a copy may be sent now; if so, note it."""


def result_name(result: int) -> str:
    """Return a MAV_RESULT as text; its number if it has none."""
    return _RESULT_NAMES.get(result, str(result))


class Session:
    """One vehicle at the other end of a link.

    `send` takes frames to the link, `record` sees every frame of both directions. A command is
    repeated after `ack_wait_s` without an acknowledgement.
    """

    def __init__(
        self, send: Callable[[bytes], None], record: Record, ack_wait_s: float = ACK_WAIT_S
    ) -> None:
        self.ack_wait_s = ack_wait_s
        """Maximum wait for an answer, in seconds of the loop's clock."""
        self._send = send
        self._record = record
        self._codec = mav.MAVLink(None, GROUND_SYSTEM_ID, mav.MAV_COMP_ID_ONBOARD_COMPUTER)
        self._codec.robust_parsing = True
        self._listeners: list[tuple[tuple[str, ...], Listener]] = []
        self._waiters: list[tuple[Callable[[], bool], asyncio.Future[None]]] = []
        self._acks: dict[tuple[int, int], asyncio.Queue[Message]] = {}
        """Acknowledgements by command and commanded component."""
        self._commanding: defaultdict[int, asyncio.Lock] = defaultdict(asyncio.Lock)
        """One command at a time for each component: no landing waits for a camera's answer."""
        self.received_s: dict[int, float] = {}
        """Time of the autopilot's last message of a kind, by its id, on our clock."""
        self.view = VehicleView()
        self.traffic = LinkTraffic(self.view.gate)
        self.losses = Losses()
        self.signing: Signing | None = None
        """With a key, unsigned messages are ignored, and sent ones are signed."""
        self.tap: Callable[[bytes], None] = lambda data: None
        """Takes the raw bytes of the link, once the vehicle has been received."""
        self.process_number = 0
        """Number of this process in our heartbeat, which distinguishes other processes from an
        echo.

        0: none, and other processes are not detected.
        """
        self.rival_s: float | None = None
        """Time of another process of ours on this link."""
        self.bound_s: float | None = None
        """Time of our vehicle's first message, on the loop's clock."""
        self.onboard = False
        """True if we are a part of the vehicle and no ground station, also to a PX4."""

    # --- frames --------------------------------------------------------------------------
    def feed(self, data: bytes) -> bool:
        """Handle received bytes; return whether our vehicle sent some of them."""
        now_s = asyncio.get_running_loop().time()
        ours = False
        for message in self._parsed(data):
            if self.signing is not None and not self._signed(message):
                continue
            self._record(bytes(message.get_msgbuf()))
            if message.get_srcSystem() == GROUND_SYSTEM_ID:
                self._look_for_rival(message, now_s)
            if message.get_type() in KINDS:  # whichever system a router passes them on for
                self.traffic.add(message, self.view.position, now_s)
                continue
            ours = self._receive(message, now_s) or ours
        if self.view.system_id:
            self.tap(data)
        self._wake()
        return ours

    def _receive(self, message: Message, now_s: float) -> bool:
        if not update(self.view, message, now_s):
            return False
        self.bound_s = now_s if self.bound_s is None else self.bound_s
        if message.get_srcComponent() == self.view.autopilot_component:
            self.received_s[message.get_msgId()] = now_s
        kind = message.get_type()
        if kind == "COMMAND_ACK":
            self._receive_ack(message)
        elif kind == "EVENT":
            self._receive_event(message)
        for kinds, listener in self._listeners:
            if not kinds or kind in kinds:
                listener(message)
        return True

    def _receive_event(self, message: Message) -> None:
        """Report an event of a PX4 in flight.

        Only an event holds the cause of a failsafe, and on board no texts come.
        """
        if not (self.onboard or self.view.armed):
            return
        if (text := event_text(message, numbered=self.onboard)) is not None:
            self.view.add_text(text, asyncio.get_running_loop().time())

    def has_rival(self) -> bool:
        """True if another process of ours was received on this link."""
        return self.rival_s is not None

    def _look_for_rival(self, message: Message, now_s: float) -> None:
        """Note another service like this one, which a vehicle or a router passes on."""
        beats = message.get_type() == "HEARTBEAT" and self.process_number
        if not beats or message.custom_mode == self.process_number:
            return
        if self.rival_s is None:
            self.view.gate.say("another uavmap instance controls this vehicle; stop one of them")
        self.rival_s = now_s

    def _signed(self, message: Message) -> bool:
        """Return whether a message is signed as required; if not, count it, and log it once."""
        if self.signing is None or message.get_msgId() == mav.MAVLINK_MSG_ID_RADIO_STATUS:
            # a radio beside us has no key, and its message is not needed
            return self.signing is None
        fault = self.signing.fault(bytes(message.get_msgbuf()))
        if fault is not None:
            self.view.gate.refuse_once("frames", fault)
        return fault is None

    def _parsed(self, data: bytes) -> Iterator[Message]:
        """Yield the messages in a piece of a stream; other bytes are skipped."""
        codec = self._codec
        while True:
            try:
                message = codec.parse_char(data)
            except Exception:  # of the parser, whose input may come from a stranger
                message = None
                codec.buf, codec.buf_index = bytearray(), 0
            data = b""
            if message is None:
                break
            if message.get_type() == "BAD_DATA":
                continue
            self.losses.count(message)
            if message.get_msgId() in mav.mavlink_map:
                yield message
        # the parser releases its buffer only when it has read all of it
        if codec.buf_index > _READ_BYTES_KEPT:
            codec.buf, codec.buf_index = codec.buf[codec.buf_index :], 0

    def send(self, message: Message) -> None:
        """Send a message. Raises `LinkError` if a number does not fit into it."""
        frame = self._packed(message)
        self._codec.seq = (self._codec.seq + 1) & 0xFF
        self._emit(frame)

    def _packed(self, message: Message) -> bytes:
        try:
            return bytes(message.pack(self._codec))
        except (struct.error, mav.MAVError, ValueError, OverflowError, TypeError) as error:
            raise LinkError(f"{message.get_type()} cannot be sent: {error}") from None

    def _emit(self, frame: bytes) -> None:
        if self.signing is not None:
            frame = self.signing.sign(frame)
        self._record(frame)
        self._send(frame)

    def listen(self, listener: Listener, *kinds: str) -> None:
        """Call `listener` with each message of the vehicle, or with those of some kinds."""
        self._listeners.append((kinds, listener))

    # --- waiting -------------------------------------------------------------------------
    async def until(self, condition: Callable[[], bool], timeout_s: float | None = None) -> bool:
        """Wait until a condition on the view holds; return False if that takes too long."""
        if condition():
            return True
        future: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        waiter = (condition, future)
        self._waiters.append(waiter)
        try:
            async with asyncio.timeout(timeout_s):
                await future
        except TimeoutError:
            return False
        finally:
            if waiter in self._waiters:
                self._waiters.remove(waiter)
        return True

    def _wake(self) -> None:
        for waiter in list(self._waiters):
            condition, future = waiter
            if condition():
                self._waiters.remove(waiter)
                if not future.done():
                    future.set_result(None)

    # --- commands ------------------------------------------------------------------------
    async def command(
        self,
        command: int,
        *params: float,
        component: int | None = None,
        done: Callable[[], bool] = lambda: False,
        permit: Permit | None = None,
    ) -> None:
        """Send COMMAND_LONG with up to seven parameters, repeated until acknowledged.

        It goes to the autopilot, if no other component is named; only the commanded one answers.
        `done` returns whether the command was carried out, acknowledged or not: then it is not sent
        again. Raises `CommandRefusedError` with the vehicle's answer, `LinkError` when it stays
        silent.
        """
        asked = self._autopilot if component is None else component

        def message(confirmation: int) -> Message:
            return self._command_long(command, params, asked, confirmation)

        await self._until_acknowledged(command, asked, message, done, permit=permit)

    def send_command(self, command: int, *params: float, component: int | None = None) -> None:
        """Send COMMAND_LONG as `command` does, once, and without waiting for an ACK."""
        asked = self._autopilot if component is None else component
        self.send(self._command_long(command, params, asked))

    def _command_long(
        self, command: int, params: tuple[float, ...], component: int, confirmation: int = 0
    ) -> Message:
        filled = (*params, *([0.0] * (7 - len(params))))
        return mav.MAVLink_command_long_message(
            self.view.system_id, component, command, confirmation, *filled
        )

    async def command_at(
        self,
        command: int,
        frame: int,
        params: tuple[float, float, float, float],
        place: LatLon,
        z: float,
        taken: Collection[int] = (mav.MAV_RESULT_ACCEPTED,),
    ) -> None:
        """Send COMMAND_INT for a place; `taken` are results that mean yes. Raises as `command`."""
        unused = command == mav.MAV_CMD_EXTERNAL_POSITION_ESTIMATE and math.isnan(z)
        lat_deg, lon_deg = place.lat_deg, place.lon_deg
        if not (math.isfinite(lat_deg) and math.isfinite(lon_deg) and (math.isfinite(z) or unused)):
            raise LinkError(f"no place to send a vehicle to: {lat_deg}, {lon_deg}, {z} m")
        at = (round(lat_deg * 1e7), round(lon_deg * 1e7), z)
        asked = self._autopilot

        def message(_confirmation: int) -> Message:
            return mav.MAVLink_command_int_message(
                self.view.system_id, asked, frame, command, 0, 0, *params, *at
            )

        await self._until_acknowledged(command, asked, message, taken=taken)

    @property
    def _autopilot(self) -> int:
        return self.view.autopilot_component or int(mav.MAV_COMP_ID_AUTOPILOT1)

    async def _until_acknowledged(
        self,
        command: int,
        asked: int,
        message: Callable[[int], Message],
        done: Callable[[], bool] = lambda: False,
        taken: Collection[int] = (mav.MAV_RESULT_ACCEPTED,),
        permit: Permit | None = None,
    ) -> None:
        name = mav.enums["MAV_CMD"][command].name
        async with self._commanding[asked]:
            sent_s = asyncio.get_running_loop().time()
            queue = self._acks[command, asked] = asyncio.Queue()
            ack: Message | None = None
            try:
                for confirmation in range(ACK_TRIES):
                    if confirmation and done():
                        return
                    if permit is not None:
                        await permit.wait_for_grant()
                    self.send(message(confirmation))
                    ack = await self._ack(queue)
                    if ack is None or ack.result in _MAY_PASS:
                        continue
                    if ack.result in taken:
                        return
                    await self.receive_status_texts()
                    break
            finally:
                del self._acks[command, asked]
        if done():
            return
        if ack is not None:
            raise CommandRefusedError(
                f"{name} was refused: {result_name(ack.result)}"
                + self.view.recent_texts(since_s=sent_s)
            )
        raise LinkError(f"{name} was not acknowledged {ACK_TRIES} times")

    async def _ack(self, queue: asyncio.Queue[Message]) -> Message | None:
        """Return the next final ACK; IN_PROGRESS extends the wait."""
        while True:
            try:
                async with asyncio.timeout(self.ack_wait_s):
                    ack = await queue.get()
            except TimeoutError:
                return None
            if ack.result == mav.MAV_RESULT_TEMPORARILY_REJECTED:
                await asyncio.sleep(self.ack_wait_s)
            if ack.result != mav.MAV_RESULT_IN_PROGRESS:
                return ack

    async def receive_status_texts(self) -> None:
        """Wait a moment: an ArduPilot explains a refusal (STATUSTEXT) after the ACK."""
        received = self.view.text_count
        await self.until(lambda: self.view.text_count != received, timeout_s=0.5)

    def _receive_ack(self, ack: Message) -> None:
        ours = ack.target_system in (0, GROUND_SYSTEM_ID)
        asked = (ack.command, ack.get_srcComponent())
        if ours and (queue := self._acks.get(asked)) is not None:
            queue.put_nowait(ack)

    # --- what a client sends of itself -----------------------------------------------------
    def heartbeat(self) -> None:
        """Send HEARTBEAT, as a ground station or as an onboard controller.

        A PX4 sends its texts only to a ground station. With `onboard`, and to others, it is sent as
        an onboard controller, which is no ground station.
        """
        onboard = mav.MAV_TYPE_ONBOARD_CONTROLLER
        self.send(
            mav.MAVLink_heartbeat_message(
                onboard if self.onboard else self.view.kind.received_as,
                mav.MAV_AUTOPILOT_INVALID,
                0,
                self.process_number,
                mav.MAV_STATE_ACTIVE,
                3,
            )
        )

    async def message_interval(self, message_id: int, rate_hz: float) -> None:
        """Request a stream (MAV_CMD_SET_MESSAGE_INTERVAL)."""
        await self.command(mav.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, round(1e6 / rate_hz))

    def request_interval(self, message_id: int, rate_hz: float) -> None:
        """Request the same without waiting, for a stream whose messages are its answer."""
        self.send_command(mav.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, round(1e6 / rate_hz))

    def request(self, message_id: int, param2: float = 0.0) -> None:
        """Request a message once (MAV_CMD_REQUEST_MESSAGE), without waiting for an ACK."""
        component = self.view.camera_component if message_id == 263 else None
        self.send_command(mav.MAV_CMD_REQUEST_MESSAGE, message_id, param2, component=component)
