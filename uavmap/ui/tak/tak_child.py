"""The process that sends a flight to TAK; `uavmap.ui.tak.tak_feed` starts it.

It reads the messages of the flight from standard input, writes reports to standard output, and ends
with the flight.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import time
from collections.abc import Callable
from typing import Final

from uavmap.base.extras import install_command
from uavmap.ui.page.board import Board
from uavmap.ui.page.live_map import LiveMap
from uavmap.ui.page.page_pipe import Message, back, messages, read
from uavmap.ui.tak.marks import Marks
from uavmap.ui.tak.outbox import Outbox

LAST_S: Final = 4.0
"""Maximum time for the last marks, real seconds."""
OVER: Final = "the flight is over"
DIED: Final = "the flight's program has ended"


def main() -> None:
    """Send until the flight ends."""
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(_serve(back()))
    os._exit(0)  # at once: all is written, and a flight waits


async def _serve(send: Callable[[Message], None]) -> None:
    reader = await messages()
    config, _ = await read(reader)
    try:
        from uavmap.ui.tak.link import Link  # noqa: PLC0415 - an extra
    except ImportError as error:
        send({"failed": f"pytak cannot be loaded ({error}); install it: {install_command('tak')}"})
        return
    outbox = Outbox()
    try:
        link = Link(config["url"], outbox, lambda text: send({"report": text}))
    except ValueError as error:
        send({"failed": str(error)})
        return
    send({"ready": True})
    running = asyncio.create_task(link.run())
    sender = Sender(outbox, config)
    try:
        while True:
            sender.receive((await read(reader))[0])
            link.wake()
    except (asyncio.IncompleteReadError, ValueError):
        sender.end()
    await link.finish(running, LAST_S)


class Sender:
    """Converter of the messages of a flight to marks in an outbox.

    `config` has `simulated`, and the minimum times between two events of an aircraft, `aircraft_s`,
    and of a shape, `shapes_s`.
    """

    def __init__(
        self, outbox: Outbox, config: Message, now_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._outbox = outbox
        self._aircraft_s, self._shapes_s = config["aircraft_s"], config["shapes_s"]
        self._marks = Marks(simulated=config["simulated"])
        self._board, self._scene = Board(), Message()
        self._ended = DIED
        self._now_s = now_s
        self._shapes_due_s = float("-inf")

    def receive(self, message: Message) -> None:
        """Receive a message of the flight (`uavmap.ui.page.page_pipe`)."""
        match message.get("kind"):
            case "scene":
                self._scene = message["scene"]
            case "delta":
                self._board.apply(message["delta"])
                self._put()
            case "ended":
                self._ended = OVER

    def end(self) -> None:
        """Mark the aircraft as landed, or as last seen: the flight sends no more."""
        self._shapes_due_s = float("-inf")
        self._put(self._ended)

    def _put(self, ended: str | None = None) -> None:
        if not self._scene:
            return
        live = LiveMap.from_board(self._scene, self._board.since(0))
        self._outbox.put("unit", [self._marks.unit(live)], self._shapes_s)
        self._outbox.put("aircraft", self._marks.aircraft(live, ended), self._aircraft_s)
        now_s = self._now_s()
        if now_s >= self._shapes_due_s:
            self._shapes_due_s = now_s + self._shapes_s
            self._outbox.put("traffic", self._marks.traffic(live), self._shapes_s)
            self._outbox.put("shapes", self._marks.shapes(live), self._shapes_s)


if __name__ == "__main__":
    main()
