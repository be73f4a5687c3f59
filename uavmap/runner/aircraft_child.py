"""The aircraft process of a flight: links, streams, guardians and the poses of pictures.

    python -m uavmap.runner.aircraft_child

Its first line of input is its task in JSON (plan, folder, append, start_s). It listens on a socket
of this computer, and obeys the mission process that sends its token. When that process ends without
a last message, each vehicle holds for `guardian.orphan_hold_s`, then returns and lands.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import json
import os
import secrets
import signal
import sys
import time
from collections import deque
from pathlib import Path
from typing import Any, Final

from missions.errors import LinkError, UavmapError
from uavmap.aircraft.process import messages as msg
from uavmap.aircraft.process.port import ended_by
from uavmap.base.atomic_write import write_text
from uavmap.base.clock import MissionClock, ScaledClock, run, wall_timeout
from uavmap.base.messages import shown_on
from uavmap.journal.flight_plan import TLOG, FlightPlan
from uavmap.journal.telemetry_log import TlogWriter
from uavmap.runner.aircraft_process import BEAT_WALL_S, END_WALL_S, SILENT_WALL_S, START_WALL_S
from uavmap.runner.aircraft_side import AircraftSide
from uavmap.runner.aircraft_takeover import ADDRESS, RECORD, Address
from uavmap.runner.flight_links import cameras_of, opened_links

_READ_BYTES: Final = 1 << 16
GONE: Final = "the mission process has ended"
END_REQUESTED: Final = "the process of the aircraft is asked to end"


class AircraftChild:
    """The process, for one flight."""

    def __init__(self, plan: FlightPlan, folder: Path, start_s: float, *, append: bool) -> None:
        self._plan = plan
        self._folder = folder
        self._start_s = start_s
        self._append = append
        self._speedup = plan.speedup or 1.0
        self._hold_s = plan.mission.guardian.orphan_hold_s
        self._clock = MissionClock(0.0)
        self._token = secrets.token_hex(16)
        self._writer: asyncio.StreamWriter | None = None
        self._early: list[msg.Message] = []
        """Messages from before the mission connected."""
        self._waiting: list[msg.Message] = []
        """Messages of the mission from before the links were open."""
        self._unkept: deque[msg.EventReport] = deque()
        """Events that were sent and are, as far as known, not in the journal."""
        self._gone = asyncio.Event()
        """Set while no mission is connected."""
        self._gone.set()
        self._met = asyncio.Event()
        """Set once a mission has been connected."""
        self._over = self._asked_to_end = False
        self._side: AircraftSide | None = None
        self._running: asyncio.Task[None] | None = None
        self._received_s = time.monotonic()
        """Time of the mission's last message, on the monotonic clock, s."""

    async def run(self) -> None:
        """Fly, from the first connection to the end."""
        self._running = asyncio.current_task()
        for number in (signal.SIGINT, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN)
        asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, self._stop)
        server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]
        address = Address(port, self._token, self._start_s, os.getpid()).as_json()
        path = self._folder / ADDRESS
        try:
            write_text(path, address, private=True)
        # this error must not keep an aircraft in the air from this process
        except OSError as error:
            self.show(f"{path} cannot be written ({error.strerror}): no resume can take over")
        sys.stdout.write(address + "\n")
        sys.stdout.flush()
        try:
            with shown_on(self):
                await self._fly()
        finally:
            await self._close()
            with contextlib.suppress(OSError):
                path.unlink()
            server.close()

    def show(self, text: str) -> None:
        """Send a line for the operator, as a display does."""
        self._send(msg.Line(text))

    async def _fly(self) -> None:
        plan = self._plan
        mission = plan.mission
        setting = plan.known_setting()
        watching = asyncio.create_task(self._watch())
        try:
            cameras = cameras_of(plan.cameras, mission, plan.member)
            with self._log() as log:
                async with opened_links(plan, cameras, mission.camera, log.record) as links:
                    side = self._side = AircraftSide(
                        plan, setting, self._folder, links, self._clock, self._send
                    )
                    for message in self._waiting:
                        side.host.receive(message)
                    # a full collection takes 0.1 s, which a stream cannot wait
                    gc.collect()
                    gc.freeze()
                    await side.run()
        except UavmapError as error:
            self._send(ended_by(error, {}, str(error)))
            with contextlib.suppress(TimeoutError):
                async with wall_timeout(START_WALL_S):
                    await self._met.wait()
        except asyncio.CancelledError:
            self._send(ended_by(LinkError(END_REQUESTED), {}, END_REQUESTED))
        finally:
            watching.cancel()

    def _log(self) -> TlogWriter:
        rate = 1.0 / self._speedup
        return TlogWriter(
            self._folder / TLOG,
            lambda: self._plan.epoch_utc_s + self._clock.now_s() * rate,
            append=self._append,
            say=self.show,
        )

    # --- the mission ----------------------------------------------------------------------------
    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Exchange messages with a connected mission until it is gone."""
        decoder = msg.Decoder(known=False)
        try:
            while data := await reader.read(_READ_BYTES):
                for message in decoder.feed(data):
                    if isinstance(message, msg.Attach):
                        if not self._meets(message, writer):
                            return
                        decoder.known = True
                    elif writer is self._writer:
                        self._received_s = time.monotonic()
                        if isinstance(message, msg.Beat):
                            while self._unkept and self._unkept[0].serial <= message.kept:
                                self._unkept.popleft()
                        elif self._side is None:
                            self._waiting.append(message)
                        else:
                            self._side.host.receive(message)
        except OSError:
            pass
        except LinkError as error:
            if writer is self._writer:
                self.show(str(error))
        finally:
            writer.close()
            if writer is self._writer:
                self._writer = None
                for unkept in self._unkept:
                    self._record(msg.encode(unkept))
                self._unkept.clear()
                self._gone.set()
                self._hold()

    def _meets(self, message: msg.Attach, writer: asyncio.StreamWriter) -> bool:
        """Return whether this mission has the aircraft from now on."""
        if not secrets.compare_digest(message.token, self._token):
            return False
        state = "new" if self._side is None else self._side.host.state
        answer = msg.Attached(state)
        if message.version != msg.VERSION:
            answer = msg.Attached("refused", "the aircraft are flown by another version of uavmap")
        elif self._writer is not None:
            answer = msg.Attached("refused", "another process of uavmap flies this mission")
        elif self._side is not None and state == "returning":
            reason = f"{GONE}: the vehicles return and land"
            answer = msg.Attached("returning", reason, self._side.beat().fates)
        writer.write(msg.encode(answer))
        if answer.state in ("refused", "returning"):
            return False
        self._writer, self._received_s = writer, time.monotonic()
        self._met.set()
        self._gone.clear()
        for early in self._early:
            self._send(early)
        self._early.clear()
        if self._side is not None and self._side.host.ready is not None:
            self._send(self._side.ready(self._clock.start_s))
        return True

    def _send(self, message: msg.Message) -> None:
        self._over = self._over or isinstance(message, msg.Ended)
        if self._writer is not None:
            if isinstance(message, msg.EventReport):
                self._unkept.append(message)
            if not self._writer.is_closing():
                self._writer.write(msg.encode(message))
        elif not self._met.is_set():
            self._early.append(message)
        elif not self._over and isinstance(message, msg.EventReport | msg.Line):
            self._record(msg.encode(message))

    def _record(self, data: bytes) -> None:
        """Write a message to the record, whole or not at all."""
        with contextlib.suppress(OSError):  # a full disk must not keep an aircraft in the air
            file = os.open(self._folder / RECORD, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
            try:
                before = os.fstat(file).st_size
                if os.write(file, data) < len(data):  # half a message hides all that follow
                    os.ftruncate(file, before)
                os.fsync(file)
            finally:
                os.close(file)

    # --- without a mission ----------------------------------------------------------------------
    async def _watch(self) -> None:
        while True:
            await asyncio.sleep(BEAT_WALL_S * self._speedup)
            silent_s = time.monotonic() - self._received_s
            side = self._side
            if self._writer is not None:
                self._send(msg.Beat() if side is None else side.beat())
                if silent_s > SILENT_WALL_S and not (side is None or side.host.end.done()):
                    # it connects again if it lives; one that reads nothing gets nothing more
                    self._writer.transport.abort()
            elif side is not None and silent_s > SILENT_WALL_S + self._hold_s:
                side.host.receive(msg.Finish(GONE))

    def _hold(self) -> None:
        self._received_s = time.monotonic() - SILENT_WALL_S
        if self._side is not None and self._side.host.state == "flying":
            self.show(
                f"{GONE} without a last message: the vehicles hold for {self._hold_s:.0f} s, then "
                f"return; `uavmap resume {self._folder}` takes them over"
            )
            self._side.host.hold()

    def _stop(self) -> None:
        """Have the mission, or at the second call the guardians, return all vehicles."""
        asked_before, self._asked_to_end = self._asked_to_end, True
        if self._side is None:
            if self._running is not None:
                self._running.cancel()
        elif self._writer is None or asked_before or self._side.host.state != "flying":
            self._side.host.receive(msg.Finish(END_REQUESTED))
        else:
            self._send(msg.Recall())

    async def _close(self) -> None:
        """Send the rest, and wait until the mission has kept it."""
        if self._writer is not None:
            with contextlib.suppress(OSError, TimeoutError):
                async with wall_timeout(END_WALL_S):  # a stalled mission reads nothing
                    await self._gone.wait()
                    return
            self._writer.transport.abort()
            await self._gone.wait()


def main() -> None:
    """Run the process that the first line of input describes."""
    wanted: dict[str, Any] = json.loads(sys.stdin.readline())
    folder = Path(wanted["folder"])
    plan = FlightPlan.from_json(wanted["plan"], folder)
    child = AircraftChild(plan, folder, wanted["start_s"], append=wanted["append"])
    run(child.run(), ScaledClock(plan.speedup or 1.0, wanted["start_s"]))


if __name__ == "__main__":
    main()
