"""MAVSDK's process in the view of the service: start, requests, watch, restart, end.

None of its errors is one of the flight: a request fails as on a lost link. The vehicle is silent
meanwhile, and is reconnected when it is received again.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import sys
from collections.abc import Callable
from typing import Any, Final

from missions.errors import LinkError
from uavmap.mavlink.mavsdk.driver_pipe import FRAMES, Pieces, frames_piece, object_piece

START_S: Final = 20.0
"""Maximum time to load the library, real seconds."""
RESTART_WAIT_S: Final = 1.0
"""Wait before a restart, real seconds."""
ANSWER_S: Final = 20.0
"""Maximum wait for an answer, real seconds; then it hangs: the library gives up at 2."""
SILENT_S: Final = 5.0
"""Maximum silence while its vehicle is received, real seconds; then it hangs as well."""
MAX_UNREAD: Final = 1 << 20
"""Maximum number of bytes that wait to be read."""
_READ_BYTES: Final = 1 << 16
_END_S: Final = 2.0

JsonObject = dict[str, Any]


class MavsdkProcess:
    """The process of one vehicle.

    `take_frames` gets MAVSDK's frames, `take_message` its decoded messages. The library's clock is
    real, the loop's runs `speedup` times as fast.
    """

    def __init__(
        self,
        system: int,
        component: int,
        take_frames: Callable[[bytes], None],
        take_message: Callable[[JsonObject], None],
        say: Callable[[str], None],
        speedup: float = 1.0,
    ) -> None:
        self._command = (
            sys.executable, "-m", "uavmap.mavlink.mavsdk.driver_child", str(system), str(component),
        )  # fmt: skip
        self._take_frames = take_frames
        self._take_message = take_message
        self._log = say
        self._speedup = speedup
        self._process: asyncio.subprocess.Process | None = None
        self._living: asyncio.Task[None] | None = None
        self._numbers = itertools.count()
        self._answers: dict[int, asyncio.Future[JsonObject]] = {}
        self._ready: asyncio.Future[None] | None = None
        self._fed_s: float | None = None
        """Time since which its vehicle is received and it has passed nothing on, s."""
        self._knows = False
        """True if MAVSDK has found the vehicle."""
        self.version = ""
        """MAVSDK's version, once it is ready."""
        self.starts = 0
        """Number of starts."""

    @property
    def pid(self) -> int | None:
        """Process id on this machine, None without one."""
        return None if self._process is None else self._process.pid

    # --- life -------------------------------------------------------------------------------
    async def start(self) -> None:
        """Start it, and keep it alive until `close`. Raises `LinkError` if it does not start."""
        self._ready = asyncio.get_running_loop().create_future()
        self._living = asyncio.create_task(self._live())
        try:
            async with asyncio.timeout(START_S * self._speedup):
                await self._ready
        except TimeoutError:
            await self.close()
            raise LinkError(
                f"MAVSDK was not ready within {START_S:g} s; fly with --driver pymavlink"
            ) from None
        except LinkError:
            await self.close()
            raise

    async def close(self) -> None:
        """End it."""
        living, self._living = self._living, None
        if living is not None:
            living.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await living

    async def _live(self) -> None:
        """Restart it whenever it ends; but not if it never was ready."""
        while True:
            why = await self._run_once()
            if self._ready is not None and not self._ready.done():
                self._ready.set_exception(
                    LinkError(
                        f"MAVSDK does not start ({why}); is the package mavsdk installed for this "
                        "machine? Or fly with --driver pymavlink"
                    )
                )
                return
            self._log(f"MAVSDK has ended ({why}) and is started again")
            await asyncio.sleep(RESTART_WAIT_S * self._speedup)

    async def _run_once(self) -> str:
        """Run it from its start to its end; return why it has ended."""
        try:
            process = await asyncio.create_subprocess_exec(
                *self._command,
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                stderr=asyncio.subprocess.PIPE,
                start_new_session=True,  # Ctrl-C is for the service, which returns the vehicles
            )
        except OSError as error:
            return str(error)
        self._process, self._fed_s, self._knows = process, None, False
        self.starts += 1
        assert process.stderr is not None
        complaints = asyncio.create_task(_last_line(process.stderr))
        try:
            why = await self._read(process)
            return why or await complaints or f"exit code {await process.wait()}"
        finally:
            self._process = None
            for answer in self._answers.values():
                if not answer.done():
                    answer.set_exception(LinkError("MAVSDK has ended"))
            self._answers.clear()
            complaints.cancel()
            await self._end(process)

    async def _read(self, process: asyncio.subprocess.Process) -> str:
        pieces, loop = Pieces(), asyncio.get_running_loop()
        assert process.stdout is not None
        while True:
            try:
                async with asyncio.timeout(SILENT_S * self._speedup):
                    data = await process.stdout.read(_READ_BYTES)
                if not data:
                    return ""
                for letter, content in pieces.feed(data):
                    if letter == FRAMES:
                        self._take_frames(content)
                    else:
                        self._receive(json.loads(content))
            except TimeoutError:
                pass
            except (ValueError, KeyError, TypeError) as error:
                return f"it wrote an invalid piece: {error}"
            fed_s = self._fed_s
            if fed_s is not None and loop.time() - fed_s > SILENT_S * self._speedup:
                return f"it passed nothing on for {SILENT_S:g} s"

    async def _end(self, process: asyncio.subprocess.Process) -> None:
        assert process.stdin is not None
        process.stdin.close()
        try:
            async with asyncio.timeout(_END_S * self._speedup):
                await process.wait()
        except TimeoutError:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.wait()
        # a process that ends without reading all breaks the pipe: its end is known
        with contextlib.suppress(OSError):
            await process.stdin.wait_closed()

    # --- words ------------------------------------------------------------------------------
    def _receive(self, content: JsonObject) -> None:
        if "name" in content:
            self._fed_s = None
            self._take_message(content)
        elif "id" in content:
            answer = self._answers.pop(content["id"], None)
            if answer is not None and not answer.done():
                answer.set_result(content)
        elif "system" in content:
            self._knows = True
        elif "ready" in content and self._ready is not None and not self._ready.done():
            self.version = str(content["ready"])
            self._ready.set_result(None)

    def feed(self, data: bytes, *, ours: bool) -> None:
        """Pass on bytes from the link; `ours`: our vehicle sent some of them."""
        if ours and self._knows and self._fed_s is None:
            self._fed_s = asyncio.get_running_loop().time()
        self._write(frames_piece(data))

    def request(self, answered: Callable[[str], None], **what: Any) -> None:
        """Request an action; `answered` gets MAVSDK's result."""

        def finish(answer: asyncio.Future[JsonObject]) -> None:
            if not answer.cancelled():
                answered("" if answer.exception() else str(answer.result()["result"]))

        self._begin(what).add_done_callback(finish)

    async def ask(self, **what: Any) -> JsonObject:
        """Request an action, and return MAVSDK's answer. Raises `LinkError` if it ends first."""
        answer = self._begin(what)
        try:
            async with asyncio.timeout(ANSWER_S * self._speedup):
                return await answer
        except TimeoutError:
            if (process := self._process) is not None:
                with contextlib.suppress(ProcessLookupError):
                    process.kill()
            raise LinkError(f"MAVSDK did not answer within {ANSWER_S:g} s") from None

    def _begin(self, what: JsonObject) -> asyncio.Future[JsonObject]:
        answer: asyncio.Future[JsonObject] = asyncio.get_running_loop().create_future()
        number = next(self._numbers)
        if self._write(object_piece({"id": number, **what})):
            self._answers[number] = answer
        else:
            answer.set_exception(LinkError("MAVSDK does not run"))
        return answer

    def _write(self, piece: bytes) -> bool:
        """Write, and return whether it runs; end a process that does not read any more."""
        process = self._process
        if process is None or process.stdin is None or process.stdin.is_closing():
            return False
        if process.stdin.transport.get_write_buffer_size() > MAX_UNREAD:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            return False
        process.stdin.write(piece)
        return True


async def _last_line(errors: asyncio.StreamReader) -> str:
    """Return the last line without a traceback: the error."""
    last = b""
    while data := await errors.read(_READ_BYTES):
        last = (last + data)[-_READ_BYTES:]
    lines = last.decode("utf-8", "replace").strip().splitlines()
    return lines[-1].strip() if lines else ""
