"""The application: the frame of its page, its tabs, and the files of its folder."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Final

from fastapi import FastAPI, Response
from fastapi.responses import FileResponse
from nicegui import Client, ui

from missions.errors import UavmapError
from uavmap.load.mbtiles import kind_of
from uavmap.ui.app.areas import Areas
from uavmap.ui.app.flights import Practise, RealAircraft
from uavmap.ui.app.jobs import LOGS
from uavmap.ui.app.pictures import Pictures
from uavmap.ui.app.results import Results
from uavmap.ui.app.visitor import App, Visitor
from uavmap.ui.page.feed import url_host
from uavmap.ui.page.server import Server, add_look, server_of

UPDATE_S: Final = 0.5
"""Time between two updates of a browser, s."""
_CSS: Final = (Path(__file__).parent / "app.css").read_text("utf-8")
_SANDBOX: Final = (
    "sandbox allow-popups; default-src 'none'; style-src 'unsafe-inline'; img-src data: 'self'"
)
"""Policy for a file of the folder in a browser: it is shown, but runs and loads nothing."""
TABS: Final = ("Areas", "Practise", "Preflight", "Fly", "Pictures", "Results", "Commands")


def serving(app: App, token: str, port: int) -> Server:
    """Create the server of the application, without starting it.

    Its page may show the pages of its commands, which have other ports of the same host.
    """
    fast = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)

    @fast.get("/file/{name:path}")
    async def file(name: str) -> Response:
        try:
            path = app.workspace.path_of(name)
        except UavmapError:
            path = None
        if path is None or not path.is_file() or LOGS in path.parts:  # a log has the tokens
            return Response(None, 404)
        headers = {"content-security-policy": _SANDBOX, "cache-control": "no-cache"}
        return FileResponse(path, headers=headers)

    @fast.get("/ground/{zoom}/{x}/{y}/{name:path}")
    async def tile(zoom: int, x: int, y: int, name: str) -> Response:
        data = await asyncio.to_thread(app.grounds.tile, name, zoom, x, y)
        if data is None:
            return Response(None, 204)  # a browser logs a 404
        headers = {"cache-control": "private, max-age=60"}
        return Response(data, 200, headers, f"image/{kind_of(data)}".replace("jpg", "jpeg"))

    @ui.page("/")
    def page(client: Client) -> None:
        visitor = Visitor(app)
        client.on_delete(lambda: app.controls.forget(visitor.id))
        _add_page(visitor)
        ui.timer(UPDATE_S, visitor.refresh)

    frames = f"http://{url_host(app.host)}:*"
    return server_of(fast, str(app.workspace.folder.name), port, token=token, frames=frames)


def _add_page(visitor: Visitor) -> None:
    add_look(_CSS)
    with ui.element("div").classes("app-day") as day:
        with ui.row().classes("app-head"):
            ui.label("uavmap").classes("app-title")
            folder = visitor.app.workspace.folder
            ui.label(folder.name).classes("app-folder").tooltip(str(folder))
            visitor.add_controls()
        with ui.tabs().props("no-caps dense align=left").classes("app-tabs") as tabs:
            for name in TABS:
                ui.tab(name).mark(f"tab-{name.lower()}")
        _add_panels(visitor, tabs)
    visitor.add_output(day)


def _add_panels(visitor: Visitor, tabs: ui.tabs) -> None:
    with ui.tab_panels(tabs, value=TABS[0], animated=False).props("keep-alive").classes("app-wide"):
        with ui.tab_panel("Areas"):
            Areas(visitor)
        with ui.tab_panel("Practise"):
            Practise(visitor)
        with ui.tab_panel("Preflight"):
            RealAircraft(visitor, flies=False)
        with ui.tab_panel("Fly"):
            RealAircraft(visitor, flies=True)
        with ui.tab_panel("Pictures"):
            Pictures(visitor)
        with ui.tab_panel("Results"):
            Results(visitor)
        with ui.tab_panel("Commands"):
            Commands(visitor)


class Commands:
    """The tab of all commands so far, as typed at a terminal."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor = visitor
        self._listed = 0
        self._list = ui.element("div").classes("app-commands")
        visitor.on_update(self._update)

    def _update(self) -> None:
        jobs = self._visitor.app.jobs.all
        for job in jobs[self._listed :]:
            with self._list, ui.row().classes("app-row"):
                ui.button("Show", on_click=lambda job=job: self._visitor.show(job)).props(
                    "no-caps flat dense"
                )
                ui.label(job.shown).classes("app-command")
        self._listed = len(jobs)
