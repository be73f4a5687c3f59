"""A session whose MAVLink is read and written by MAVSDK.

The service's own part stays what it is: which bytes are heard and from whom (the transport), what
is believed (gate and view), what is logged. MAVSDK decodes what comes, and encodes, repeats and
waits for what goes. Heartbeats are not its: they say that the guardian lives, and a vehicle that
is called (`udpout`) has to hear them before MAVSDK can know it.
"""

from __future__ import annotations

import asyncio
import contextlib
import struct
from collections.abc import AsyncIterator, Callable, Collection
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import CommandRefusedError, LinkError
from uavmap.base.printable import printable
from uavmap.mavlink.mavsdk.driver_process import MavsdkProcess, Words
from uavmap.mavlink.mavsdk.mavsdk_messages import Message, fields_of, message_of
from uavmap.mavlink.mavsdk.outbox import Outbox
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

COMPONENT: Final = int(mav.MAV_COMP_ID_ONBOARD_COMPUTER)
_NOT_SENT: Final = ("", "NO_SYSTEM")
"""What MAVSDK says of a message while it knows no vehicle: the link's silence tells the rest."""


class MavsdkSession(Session):
    """One vehicle at the other end of a link, spoken to by MAVSDK.

    `process` is given by `opened_session`. Errors are those of a session.
    """

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
        self._say = say
        self.outbox = Outbox(self._emit)
        self.process = MavsdkProcess(
            GROUND_SYSTEM_ID, COMPONENT, self.outbox.take, self._hear, say, speedup
        )
        self._complained = False

    # --- frames ---------------------------------------------------------------------------
    def _take(self, message: Message, now_s: float) -> bool:
        """Hand a frame of the link to MAVSDK; whether our vehicle speaks in it.

        Nothing in it is believed here: the view hears what MAVSDK makes of it.
        """
        ours = self._is_ours(message)
        self.process.feed(bytes(message.get_msgbuf()), ours=ours)
        return ours

    def _is_ours(self, message: Message) -> bool:
        if self.view.system_id:
            return bool(message.get_srcSystem() == self.view.system_id)
        wanted = self.view.wanted_system in (None, message.get_srcSystem())
        return wanted and message.get_type() == "HEARTBEAT" and is_autopilot(message)

    def _hear(self, told: Words) -> None:
        """A message that MAVSDK has read."""
        message = message_of(told["name"], told["system"], told["component"], told["fields"])
        if message is not None:
            super()._take(message, asyncio.get_running_loop().time())
            self._wake()

    def send(self, message: Message) -> None:
        """Have MAVSDK send a message. Raises `LinkError` where a number does not fit into it."""
        if message.get_type() == "HEARTBEAT":
            super().send(message)
            return
        self._fits(message)
        self.outbox.once(message)

        def answered(result: str) -> None:
            if result == "SUCCESS":
                return
            self.outbox.not_sent(message)
            if result not in _NOT_SENT and not self._complained:
                self._complained = True
                self._say(f"MAVSDK does not send {message.get_type()}: {printable(result)}")

        self.process.tell(answered, do="send", name=message.get_type(), fields=fields_of(message))

    def _fits(self, message: Message) -> None:
        try:
            message.pack(self._codec)
        except (struct.error, mav.MAVError, ValueError, OverflowError, TypeError) as error:
            raise LinkError(f"{message.get_type()} cannot be sent: {error}") from None

    # --- commands -------------------------------------------------------------------------
    async def asked(
        self, command: int, what: str, permit: Permit | None = None, **more: Any
    ) -> Words:
        """Have MAVSDK do something that takes a command, which may go over the link meanwhile,
        each copy by the permit.
        """
        if permit is not None:
            await permit.granted()
        with self.outbox.asked(command, permit):
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
        """MAVSDK repeats a command and waits; here its answer is read."""
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
                    raise LinkError(f"{name} was not acknowledged, MAVSDK says")
                if result != mav.MAV_RESULT_TEMPORARILY_REJECTED:
                    await self.hear_why()
                    break
                await asyncio.sleep(self.ack_wait_s)
        if result is not None and not done():
            raise CommandRefusedError(
                f"{name} was refused: {result_name(result)}" + self.view.recent_texts()
            )

    async def _result(self, command: int, message: Message, permit: Permit | None) -> int | None:
        """The MAV_RESULT of a command; None where no answer came."""
        self._fits(message)
        told = await self.asked(
            command, "command", permit, name=message.get_type(), fields=fields_of(message)
        )
        answer = told.get("answer")
        return int(answer["result"]) if told["result"] == "SUCCESS" and answer else None


@contextlib.asynccontextmanager
async def opened_session(
    send: Callable[[bytes], None],
    record: Record,
    ack_wait_s: float,
    say: Callable[[str], None],
    speedup: float,
) -> AsyncIterator[MavsdkSession]:
    """A session with its MAVSDK running until the end of the context. Raises `LinkError`."""
    session = MavsdkSession(send, record, ack_wait_s, say=say, speedup=speedup)
    await session.process.start()
    say(f"spoken with by MAVSDK {printable(session.process.version)}")
    try:
        yield session
    finally:
        await session.process.close()
