"""The process of a page, started by `uavmap.ui.page.feed`; it ends with the flight.

Messages of the flight come by standard input, orders go by standard output.
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
from uavmap.ui.page.page_pipe import Words, back, messages, read

LAST_S: Final = 4.0
"""Maximum time for the last updates of browsers, real seconds."""
DIED: Final = "the flight's program has ended without a word; `uavmap resume` goes on with it"


def main() -> None:
    """Serve a page until the flight ends."""
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(_serve(back()))
    os._exit(0)  # nothing is left to write, and a flight waits: to tear all this down takes seconds


async def _serve(send: Callable[[Words], None]) -> None:
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
        await asyncio.wait_for(hub.nobody.wait(), LAST_S)


if __name__ == "__main__":
    main()
