"""The page by NiceGUI: the frame around the map, the buttons, and a loop for each browser.

A browser gets the changes since the version that it has confirmed. It gets no more before it
confirms again, so changes do not accumulate.
"""

from __future__ import annotations

import asyncio
import itertools
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import uvicorn
from fastapi import FastAPI, Request, Response
from nicegui import Client, background_tasks, ui

from uavmap.ui.page.access_guard import Guard, cookie_of, same
from uavmap.ui.page.board import Board
from uavmap.ui.page.hub import RESULTS, Hub
from uavmap.ui.page.live_geojson import part_of
from uavmap.ui.page.page_pipe import MAP_PATH, Message

UPDATE_S: Final = 0.1
"""Minimum time between two updates of a browser, real s."""
CONFIRM_S: Final = 8.0
"""Time without a confirmation after which a browser gets a snapshot, s."""
ANSWER_S: Final = 8.0
"""Maximum time until the flight answers an order, s."""
WATCHES: Final = "this page only watches the flight; another page has the buttons"
_CSS: Final = (Path(__file__).parent / "page.css").read_text("utf-8")
_FOCUS: Final = """
:focus-visible { outline: 3px solid #1c5fd6; outline-offset: 1px; box-shadow: 0 0 0 3px #1c5fd6; }
"""
_BLUE: Final = "#1c5fa8"
"""Colour of buttons, dark enough for white text."""
_ICON: Final = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 16 16"><rect width="16" height="16" '
    'fill="#74b27a"/><path d="M3 8h10M8 3v10" stroke="#fff" stroke-width="2"/></svg>'
)

Send = Callable[[Message], None]


class FlightView(
    ui.element, component="flight_view.js", dependencies=["flight_board.js", "flight_map.js"]
):
    """The map, the table and the log, drawn by `flight_view.js`."""


class Server(uvicorn.Server):
    """A server that sets `begun` when it accepts requests."""

    def __init__(self, config: uvicorn.Config) -> None:
        super().__init__(config)
        self.begun = asyncio.Event()

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start to accept requests."""
        await super().startup(sockets)
        if self.started:
            self.begun.set()


def serving(hub: Hub, config: Message, send: Send) -> Server:
    """Create the server of the page, without starting it. `send` passes orders to the flight."""
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    numbers = itertools.count(1)

    @app.get("/picture/{name}")
    async def picture(name: str) -> Response:
        data = await hub.picture(name)
        headers = {"cache-control": "private, max-age=600"}
        return Response(data, 200 if data else 404, headers, "image/jpeg")

    @app.get("/background")
    async def background() -> Response:
        data = hub.background
        return Response(data, 200 if data else 404, None, "image/jpeg")

    @app.get("/result/{name}")
    async def result(name: str) -> Response:
        data = await hub.result(name)
        status = 200 if data else 204 if name in RESULTS else 404  # a browser logs a 404
        return Response(data, status, {"cache-control": "no-store"}, RESULTS.get(name))

    # GDAL reads the length by HEAD, then parts
    @app.api_route(MAP_PATH, methods=["GET", "HEAD"])
    async def live_map(request: Request) -> Response:
        asked = request.headers.get("range", "")
        status, headers, part = part_of(await hub.geojson(again=bool(asked)), asked)
        headers |= {"cache-control": "no-store"}
        return Response(part, status, headers, "application/geo+json")

    @ui.page("/")
    def page(client: Client, request: Request) -> None:
        given = request.cookies.get(cookie_of(config["port"]), "")
        steers = bool(config.get("steers")) and same(given, config["token"])
        why = WATCHES if config.get("steers") and not steers else config.get("why", "")
        visitor = Visitor(hub, {**config, "steers": steers, "why": why}, send, numbers)
        following = background_tasks.create(visitor.follow(client), name="visitor")
        client.on_delete(following.cancel)

    tokens = {key: config[key] for key in ("token", "map_token", "watch_token")}
    return server_of(app, config["title"], config["port"], **tokens)


def server_of(app: FastAPI, title: str, port: int, **guarded_by: Any) -> Server:
    """Return the server of an application with NiceGUI's pages, for browsers with a token.

    `guarded_by` are arguments of `Guard`.
    """
    ui.run_with(
        app,
        title=f"{title} - uavmap",
        favicon=_ICON,
        language="en-US",
        tailwind=False,
        reconnect_timeout=5.0,
        message_history_length=0,
        show_welcome_message=False,
    )
    guarded: Any = Guard(app, cookie=cookie_of(port), **guarded_by)
    return Server(
        uvicorn.Config(
            guarded, lifespan="on", log_config=None, access_log=False, server_header=False,
            proxy_headers=False, ws_max_size=1 << 20, timeout_graceful_shutdown=1,
        )
    )  # fmt: skip


def add_look(css: str) -> None:
    """Add a style sheet to a page, with a visible focus and buttons of high contrast."""
    ui.add_css(_FOCUS + css)
    ui.colors(primary=_BLUE)


class Visitor:
    """One open page."""

    def __init__(
        self, hub: Hub, config: Message, send: Send, numbers: itertools.count[int]
    ) -> None:
        self._hub = hub
        self._config = config
        self._send = send
        self._numbers = numbers
        self._at_s: float | None = None
        """Mission time that is shown, s; None for now."""
        self._changed = asyncio.Event()
        self._buttons: dict[str, ui.button] = {}
        self._listed: list[int] = []
        add_look(_CSS)
        with ui.row().classes("flight-head"):
            ui.label(config["title"]).classes("title")
            self._why = ui.label("").classes("why")
            if config.get("steers"):
                with ui.row().classes("flight-orders") as self._orders:
                    self._add_buttons()
        if hub.timeline is not None:
            self._add_slider()
        self._view = FlightView()

    # --- orders ----------------------------------------------------------------------------
    def _add_buttons(self) -> None:
        for name, label, question in (
            ("pause", "Pause", "Hold all vehicles?"),
            ("continue", "Continue", "Continue the mission?"),
            ("return", "Return", ""),
        ):
            look = "outline color=grey-9 padding='xs md'"
            if name == "return":  # the style sheet has its size
                look = "unelevated color=red-9"
            button = ui.button(label).props(f"no-caps {look}")
            button.mark(name).props(f"data-order={name}")
            button.on_click(self._asking(name, question) if question else self._return)
            self._buttons[name] = button

    def _asking(self, name: str, question: str) -> Callable[[], Any]:
        async def on_click() -> None:
            if await ask(question) is not None:
                await self._order({"do": name})

        return on_click

    async def _return(self) -> None:
        choices = {0: "all vehicles"} | {number: f"vehicle {number}" for number in self._listed}
        question = "Which vehicles return? They stay at home until a resume."
        if (vehicle := await ask(question, "Return", "Cancel", choices)) is not None:
            await self._order({"do": "return", "vehicle": vehicle or None})

    async def _order(self, order: Message) -> None:
        if self._hub.board.field("hands_off") or self._hub.ended:
            ui.notify("no order is given: the flight accepts no orders now")
            return
        number = str(next(self._numbers))
        answer = asyncio.get_running_loop().create_future()
        self._hub.answers[number] = answer
        self._send({**order, "id": number})
        try:
            ui.notify(await asyncio.wait_for(answer, ANSWER_S))
        except TimeoutError:
            ui.notify("no response from the flight; check the log and the aircraft")
        finally:
            self._hub.answers.pop(number, None)

    def _show_buttons(self, board: Board) -> None:
        why = self._hub.ended or board.field("hands_off") or self._config.get("why", "")
        paused = bool(board.field("paused"))
        fits = {"pause": not paused, "continue": paused or bool(board.field("held"))}
        self._why.set_text("" if self._hub.ended else why)  # the banner shows the end
        if self._buttons:
            self._orders.set_visibility(not why)
        for name, button in self._buttons.items():
            button.set_visibility(not why and fits.get(name, True))

    # --- time ------------------------------------------------------------------------------
    def _add_slider(self) -> None:
        with ui.row().classes("flight-time"):
            self._play = ui.button("Play", on_click=self._toggle).props("no-caps flat dense")
            self._slider = ui.slider(min=0.0, max=1.0, step=0.5, value=0.0).classes("grow")
            self._slider.props('aria-label="mission time"')
            self._slider.on("update:model-value", self._seek, throttle=0.1, leading_events=True)
            self._now = ui.button("Now", on_click=lambda: self._go_to(None)).props(
                "no-caps flat dense"
            )
        self._playing = False

    def _seek(self, event: Any) -> None:
        self._playing = False
        self._go_to(float(event.args))

    def _go_to(self, t_s: float | None) -> None:
        self._at_s = t_s
        self._changed.set()

    def _toggle(self) -> None:
        timeline = self._hub.timeline
        assert timeline is not None
        self._playing = not self._playing
        first_s, last_s = timeline.span
        if self._playing and (self._at_s is None or self._at_s >= last_s):
            self._go_to(first_s)
        self._changed.set()

    def _show_time(self) -> None:
        timeline = self._hub.timeline
        if timeline is None:
            return
        first_s, last_s = timeline.span
        if self._playing and self._at_s is not None:
            self._at_s += max(last_s - first_s, 30.0) / 30.0 * UPDATE_S  # the whole in 30 s
            if self._at_s >= last_s:
                self._playing, self._at_s = False, None
        self._play.set_text("Stop" if self._playing else "Play")
        if (self._slider.props["min"], self._slider.props["max"]) != (first_s, last_s):
            self._slider.props["min"], self._slider.props["max"] = first_s, last_s
            self._slider.update()
        at_s = last_s if self._at_s is None else self._at_s
        if self._slider.value != at_s:
            self._slider.set_value(at_s)
        self._now.set_visibility(self._at_s is not None)

    # --- updates ---------------------------------------------------------------------------
    async def follow(self, client: Client) -> None:
        """Send the browser all changes until its page is closed or the flight is over."""
        with client:
            await client.connected()
            self._hub.enter(self)
            try:
                await self._follow(client)
            finally:
                self._hub.leave(self)

    async def _follow(self, client: Client) -> None:
        version, scene, shown = 0, None, None
        while not client.is_deleted:
            if self._hub.scene is None and not self._hub.ended:
                await self._hub.news.wait()
                continue
            ended = self._hub.ended
            try:
                if scene is not self._hub.scene:
                    scene, version = self._hub.scene, 0
                    await self._view.run_method("setScene", scene, timeout=CONFIRM_S)
                board = self._board()
                version = version if board is shown else 0
                version, shown = await self._send_news(board, version), board
            except TimeoutError:
                version, scene = 0, None  # a snapshot has all that it has missed
                continue
            if ended:
                return
            await self._rest(board, version)

    def _board(self) -> Board:
        self._show_time()
        if self._at_s is None or self._hub.timeline is None:
            return self._hub.board
        return self._hub.timeline.at(self._at_s)

    async def _send_news(self, board: Board, version: int) -> int:
        """Send the browser the changes; return the version that it confirms, 0 for none."""
        self._show_buttons(self._hub.board)
        self._listed = sorted(board.vehicles)
        link = {
            "live": self._at_s is None and not self._hub.ended,
            "sounds": self._hub.timeline is None and not self._hub.ended,
            "text": self._hub.ended,
            "pictures": self._config.get("pictures", ""),
        }
        delta = board.since(version)
        confirmed = await self._view.run_method("applyDelta", delta, link, timeout=CONFIRM_S)
        return delta["v"] if confirmed == delta["v"] else 0

    async def _rest(self, board: Board, version: int) -> None:
        await asyncio.sleep(UPDATE_S)
        if self._hub.timeline is not None and self._playing:
            return
        while board is not self._hub.board or board.version == version:
            if self._changed.is_set() or self._hub.ended:
                break
            waits = [
                asyncio.ensure_future(self._hub.news.wait()),
                asyncio.ensure_future(self._changed.wait()),
            ]
            _, pending = await asyncio.wait(waits, return_when=asyncio.FIRST_COMPLETED)
            for task in pending:
                task.cancel()
        self._changed.clear()


async def ask(
    question: str, yes: str = "Yes", no: str = "No", choices: dict[int, str] | None = None
) -> int | None:
    """Ask before an order to aircraft; return the choice, 0 without choices, or None for no."""
    with ui.dialog() as dialog, ui.card():
        dialog.props["aria-label"] = question
        ui.label(question)
        chosen = None
        if choices is not None:
            chosen = ui.select(choices, value=0, label="vehicles").props("outlined dense")
        with ui.row():
            ui.button(yes, on_click=lambda: dialog.submit(True)).props("no-caps data-confirm=yes")
            ui.button(no, on_click=lambda: dialog.submit(False)).props("no-caps flat")
    agreed = await dialog
    dialog.delete()
    return (0 if chosen is None else chosen.value) if agreed else None
