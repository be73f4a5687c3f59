"""The process of a page; `uavmap.ui.page.feed` starts it.

It reads the messages of the flight from standard input, writes orders to standard output, and ends
with the flight.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
from collections.abc import Callable
from typing import Final

from uavmap.base.extras import install_command
from uavmap.ui.page.hub import Hub
from uavmap.ui.page.page_pipe import Message, back, messages, read

LAST_S: Final = 4.0
"""Maximum time for the last updates of browsers, real s."""
DIED: Final = "the process of the flight has ended too early; `uavmap resume` continues the flight"


def main() -> None:
    """Serve a page until the flight ends."""
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(_serve(back()))
    os._exit(0)  # at once: all is written, a flight waits, and an orderly end takes seconds


async def _serve(send: Callable[[Message], None]) -> None:
    reader = await messages()
    config, _ = await read(reader)
    try:
        from uavmap.ui.page.server import serving  # noqa: PLC0415 - an extra, and it takes seconds
    except ImportError as error:
        remedy = install_command("page")
        send({"failed": f"NiceGUI cannot be loaded ({error}); install it: {remedy}"})
        return
    hub = Hub(config)
    server = serving(hub, config, send)
    listening = socket.socket(fileno=config["socket"])
    running = asyncio.create_task(server.serve(sockets=[listening]))
    begun = asyncio.create_task(server.begun.wait())
    await asyncio.wait((running, begun), return_when=asyncio.FIRST_COMPLETED)
    if begun.done():
        send({"ready": True})
        await _listen(hub, reader)
    server.should_exit = True
    await running


async def _listen(hub: Hub, reader: asyncio.StreamReader) -> None:
    try:
        while True:
            await hub.receive(*await read(reader))
    except (asyncio.IncompleteReadError, ValueError):
        pass
    hub.ended = hub.ended or DIED
    hub.wake()
    with contextlib.suppress(TimeoutError):
        await asyncio.wait_for(hub.unwatched.wait(), LAST_S)


if __name__ == "__main__":
    main()
