"""uavmap app: plan, practise, fly and share maps in one page of the browser."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import logging
import secrets
import socket
from functools import partial
from pathlib import Path
from typing import Final

from missions.errors import OutputError
from uavmap.base.messages import shown_on
from uavmap.base.terminal import Terminal
from uavmap.ui.cli.option_table import add_options
from uavmap.ui.page.feed import bind_port, need_nicegui, url_host

_LOG: Final = logging.getLogger("uavmap.ui.app")
EXAMPLES: Final = """\
  uavmap app                                in this folder: open the URL that it prints
  uavmap app fields/                        in another folder, with all files that it makes
  uavmap app fields/ --tiles area.mbtiles   over a map from another folder
  uavmap app fields/ --page-host 0.0.0.0    for a tablet in the same network
"""
NOTES: Final = """\
On the page you draw areas, make missions, practise them in the simulator, check and fly aircraft,
map photographs, and see results. The page writes files and runs commands as you would at a
terminal, and shows each command. One browser has the controls; others watch.

Ctrl-C ends the page. Its commands continue: a flight does not end with the page.
"""
DESCRIPTION: Final = "Plan, practise, fly and share maps in a browser, without a terminal."


add_arguments: Final = partial(add_options, command="app")


def run(options: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C."""
    need_nicegui()
    folder = Path(options.workspace)
    if not folder.is_dir():
        raise OutputError(f"{folder}: no such folder; make it, or give another")
    # not above: NiceGUI takes a second to load
    from uavmap.ui.app.server import serving  # noqa: PLC0415
    from uavmap.ui.app.visitor import App  # noqa: PLC0415
    from uavmap.ui.app.workspace import Workspace  # noqa: PLC0415

    given = None if options.tiles is None else Path(options.tiles).absolute()
    token, host = secrets.token_urlsafe(16), options.page_host
    with bind_port(host, options.port, "--port") as listening, shown_on(Terminal()):
        port = listening.getsockname()[1]
        origin = f"http://{url_host(host)}:{port}"
        app = App(Workspace(folder.absolute()), given, host, origin)
        _LOG.info(f"uavmap app: {origin}/?token={token}")
        _LOG.info("Ctrl-C ends the page")
        server = serving(app, token, port)
        with contextlib.suppress(KeyboardInterrupt):
            asyncio.run(_serve(server, listening))
        for job in app.jobs.running:
            _LOG.info(f"still running: {job.shown}; its lines are in {job.log}")
    return 0


async def _serve(server: object, listening: socket.socket) -> None:
    await server.serve(sockets=[listening])  # type: ignore[attr-defined]
