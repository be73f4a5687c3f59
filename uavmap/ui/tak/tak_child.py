"""The process that sends a flight to TAK, started by `uavmap.ui.tak.tak_feed`; it ends with it.

Messages of the flight come by standard input, reports go by standard output.
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
from uavmap.ui.page.page_pipe import Words, back, messages, read
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
    os._exit(0)  # nothing is left to write, and a flight waits


async def _serve(send: Callable[[Words], None]) -> None:
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
    """Makes the marks of what the flight sends, and puts them into an outbox.

    `config` has `simulated`, and `aircraft_s` and `shapes_s`, the least times between two events of
    one aircraft or shape.
    """

    def __init__(
        self, outbox: Outbox, config: Words, now_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._outbox = outbox
        self._aircraft_s, self._shapes_s = config["aircraft_s"], config["shapes_s"]
        self._marks = Marks(simulated=config["simulated"])
        self._board, self._scene = Board(), Words()
        self._ended = DIED
        self._now_s = now_s
        self._shapes_due_s = float("-inf")

    def receive(self, words: Words) -> None:
        """Receive a message of the flight (`uavmap.ui.page.page_pipe`)."""
        match words.get("kind"):
            case "scene":
                self._scene = words["scene"]
            case "delta":
                self._board.apply(words["delta"])
                self._put()
            case "ended":
                self._ended = OVER

    def end(self) -> None:
        """Nothing more will come: mark the aircraft as landed, or as last seen."""
        self._shapes_due_s = float("-inf")
        self._put(self._ended)

    def _put(self, ended: str | None = None) -> None:
        if not self._scene:
            return
        live = LiveMap.of(self._scene, self._board.since(0))
        self._outbox.put("unit", [self._marks.unit(live)], self._shapes_s)
        self._outbox.put("aircraft", self._marks.aircraft(live, ended), self._aircraft_s)
        now_s = self._now_s()
        if now_s >= self._shapes_due_s:
            self._shapes_due_s = now_s + self._shapes_s
            self._outbox.put("shapes", self._marks.shapes(live), self._shapes_s)


if __name__ == "__main__":
    main()
