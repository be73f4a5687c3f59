"""The aircraft process in the view of the mission process: started, connected to, restarted."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import signal
import time
import traceback
from collections.abc import AsyncIterator, Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractAsyncContextManager
from pathlib import Path
from typing import Final

from pydantic import ValidationError

from missions.errors import LinkError
from uavmap.aircraft.process import messages as msg
from uavmap.aircraft.process.port import Port, ended_by
from uavmap.base.child_process import Child
from uavmap.base.clock import wall_timeout
from uavmap.journal.flight_plan import FlightPlan
from uavmap.runner.aircraft_takeover import ADDRESS, RECORD, Address, Attachment, attach, recorded

Connection = Callable[[Port, Callable[[], msg.Begin]], AbstractAsyncContextManager[None]]
"""Connects a port to aircraft; the function makes the first message of each connection."""

MODULE: Final = "uavmap.runner.aircraft_child"
BEAT_WALL_S: Final = 0.5
"""Time between two heartbeats, real seconds."""
SILENT_WALL_S: Final = 5.0
"""Maximum silence of the other process that a busy machine explains, real seconds."""
END_WALL_S: Final = 5.0
START_WALL_S: Final = 30.0
RECORD_WAIT_WALL_S: Final = 2.0
"""Maximum wait until the record is in the journal, real seconds."""
STARTS: Final = 3
"""Number of times in a row that the process is started before the mission gives up."""
_READ_BYTES: Final = 1 << 16
_LOG: Final = logging.getLogger("uavmap.flight")


class AircraftProcess:
    """The aircraft process of one flight, started unless one is `found`.

    `append` continues its telemetry log.
    """

    def __init__(
        self, plan: FlightPlan, folder: Path, found: Attachment | None, *, append: bool
    ) -> None:
        self._plan = plan
        self._folder = folder
        self._found = found
        self._append = append
        self._child: Child | None = None
        self._address: Address | None = None
        self._speedup = plan.speedup or 1.0
        self._received_s = 0.0

    @contextlib.asynccontextmanager
    async def connected(self, port: Port, begin: Callable[[], msg.Begin]) -> AsyncIterator[None]:
        """Connect the port to the aircraft, again and again, until the end of the context."""
        line = await self._start(self._found)
        port.connect(line.send)
        keeping = asyncio.create_task(self._keep(port, line, begin))
        try:
            yield
        finally:
            keeping.cancel()
            # an operator who interrupts now still sees how it ended
            with contextlib.suppress(asyncio.CancelledError):
                await asyncio.gather(keeping, return_exceptions=True)
                await asyncio.to_thread(self._end)

    async def _start(self, found: Attachment | None = None) -> _Line:
        """Connect to an aircraft process; a started one is ended if no caller waits for it."""
        self._zero_s = time.monotonic() - asyncio.get_running_loop().time() / self._speedup
        if found is not None:
            return await self._line(found)
        starter = ThreadPoolExecutor(1, "aircraft")
        begun = starter.submit(self._begin)
        starter.shutdown(wait=False)
        try:
            return await self._line(await asyncio.wrap_future(begun))
        except asyncio.CancelledError:
            begun.add_done_callback(self._discard)
            if self._child is not None:
                self._child.process.kill()
            raise

    async def _line(self, found: Attachment) -> _Line:
        self._address = found.address
        found.socket.setblocking(False)
        reader, writer = await asyncio.open_connection(sock=found.socket)
        self._received_s = time.monotonic()
        return _Line(reader, writer)

    def _begin(self) -> Attachment:
        child = self._child = Child(MODULE, "aircraft")
        wanted = {
            "plan": self._plan.as_json(), "folder": str(self._folder), "append": self._append,
            "start_s": self._zero_s,
        }  # fmt: skip
        try:
            child.stdin.write(json.dumps(wanted).encode() + b"\n")
            child.stdin.close()
            address = Address.parse(child.stdout.readline())
        except (OSError, ValidationError):
            raise LinkError(self._not_begun("start")) from None
        answer = None
        with contextlib.suppress(TimeoutError):
            answer = attach(address)
        if answer is None:
            raise LinkError(self._not_begun("answer"))
        self._append = True
        return answer[1]

    def _not_begun(self, what: str) -> str:
        child = self._child
        assert child is not None
        self._end_process()
        return (
            f"the process of the aircraft does not {what}: {child.last_words() or 'it has ended'}"
        )

    async def _keep(self, port: Port, line: _Line, begin: Callable[[], msg.Begin]) -> None:
        """Pass messages on; whenever the process is gone, find it again, or start it."""
        try:
            while True:
                try:
                    await self._pass_on(port, line)
                finally:
                    await asyncio.sleep(0)  # the port notes the kept events
                    line.send(msg.Beat(kept=port.kept))
                    line.writer.close()
                    with contextlib.suppress(OSError):
                        await line.writer.wait_closed()
                if port.ended.done():
                    return
                line = await self._again(port, begin())
        except Exception as error:
            text = "".join(traceback.format_exception(error))
            port.receive(ended_by(error, {}, str(error) if isinstance(error, LinkError) else text))

    async def _again(self, port: Port, begin: msg.Begin) -> _Line:
        answer = None
        if self._address is not None:
            with contextlib.suppress(TimeoutError):
                answer = await asyncio.to_thread(attach, self._address)
        if answer is None:
            _LOG.info("the process of the aircraft has died; it is started again")
            port.report_loss()
            line = await self._started_again()
            port.connect(line.send)
            port.send(begin)
            return line
        attached, found = answer
        if attached.state not in ("new", "flying"):
            found.socket.close()
            port.let_go()
            raise LinkError(attached.reason)
        _LOG.info("this process stalled for so long that the aircraft hold; it continues")
        for message in recorded(self._folder):
            port.receive(message)
        with contextlib.suppress(TimeoutError):
            async with wall_timeout(RECORD_WAIT_WALL_S):
                await port.taken_in()
        with contextlib.suppress(OSError):
            (self._folder / RECORD).unlink()
        line = await self._start(found)
        port.connect(line.send)
        if attached.state == "new":
            port.send(begin)
        return line

    async def _started_again(self) -> _Line:
        failure = LinkError()
        for _ in range(STARTS):
            await asyncio.to_thread(self._end_process)
            with contextlib.suppress(OSError):
                (self._folder / ADDRESS).unlink()
            try:
                return await self._start()
            except LinkError as error:
                failure = error
        raise failure

    async def _pass_on(self, port: Port, line: _Line) -> None:
        """Pass messages on until the process is silent, or gone. Raises `LinkError` for others."""
        decoder = msg.Decoder()
        beating = asyncio.create_task(self._beat(port, line))
        try:
            while data := await line.reader.read(_READ_BYTES):
                self._received_s = time.monotonic()
                for message in decoder.feed(data):
                    port.receive(message)
        except OSError:
            pass
        finally:
            beating.cancel()

    async def _beat(self, port: Port, line: _Line) -> None:
        while True:
            line.send(msg.Beat(kept=port.kept))
            if time.monotonic() - self._received_s > 2.0 * SILENT_WALL_S:
                line.writer.close()
            await asyncio.sleep(BEAT_WALL_S * self._speedup)

    def _end_process(self) -> None:
        """End a process that is silent: two would fly the same vehicles."""
        # a process of a mission process that has died
        if self._child is None and self._address is not None:
            with contextlib.suppress(OSError):
                os.kill(self._address.process, signal.SIGKILL)
        self._address = None
        if self._child is not None:
            self._child.process.kill()
            self._child.process.wait()
            self._child.close(END_WALL_S)
            self._child = None

    def _discard(self, begun: Future[Attachment]) -> None:
        if not begun.cancelled() and begun.exception() is None:
            begun.result().socket.close()
        self._end_process()

    def _end(self) -> None:
        if self._child is None:
            return
        with contextlib.suppress(Exception):
            self._child.process.wait(END_WALL_S)
            self._child.close(END_WALL_S)


class _Line:
    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader = reader
        self.writer = writer

    def send(self, message: msg.Message) -> None:
        """Send a message; if the other end is gone, the message is dropped."""
        if not self.writer.is_closing():
            self.writer.write(msg.encode(message))
