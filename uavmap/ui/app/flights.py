"""Practise, Preflight, Fly: a mission in the simulator or with real aircraft."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import re
import socket
from collections.abc import Callable, Sequence
from typing import Final

from nicegui import background_tasks, ui

from missions.errors import UavmapError
from missions.flight.setting_of import setting_of
from uavmap.load.mission_source import load
from uavmap.mavlink.links.urls import parse_url
from uavmap.ui.app.jobs import Job
from uavmap.ui.app.preflight import Findings
from uavmap.ui.app.visitor import App, Visitor
from uavmap.ui.page.feed import LOOPBACK
from uavmap.ui.page.page_scene import background_from_tiles
from uavmap.ui.page.server import ask

_LOG: Final = logging.getLogger("uavmap.ui.app")
SPEEDUPS: Final = {1: "real time", 5: "5 times", 20: "20 times"}
LOOK_S: Final = 0.3
"""Time between two checks of a process, s."""
_URL: Final = re.compile(r"^\w+://\S+$")


class Practise:
    """The tab that flies a mission in the simulator, with the buttons of a real flight."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor = visitor
        with ui.element("div").classes("app-form"):
            self._add_form(visitor)

    def _add_form(self, visitor: Visitor) -> None:
        ui.label("Fly a mission in the simulator. The live page has the buttons of a real flight.")
        self._mission = visitor.select("mission", visitor.app.workspace.missions)
        self._vehicles = ui.number("vehicles", value=1, min=1, max=20, format="%d")
        self._speedup = ui.select(SPEEDUPS, value=5, label="speed of time").mark("speedup")
        self._seed = ui.number("seed", value=1, min=0, format="%d")
        self._keeps = ui.checkbox("keep the pictures", value=True).mark("keep")
        visitor.button("Practise", self._begin).mark("practise")

    async def _begin(self) -> None:
        mission, app = chosen_mission(self._mission), self._visitor.app
        vehicles, speedup = int(self._vehicles.value or 1), str(self._speedup.value)
        port, http_port = free_ports(vehicles), free_ports(1, socket.SOCK_STREAM)
        flight = ["fly", mission, "--speedup", speedup, *app.page_words("--page"), "--yes",
                  "--auto-swap", *frames_option(self._keeps),
                  *await tiles_option(app, mission)]  # fmt: skip
        simulator = self._visitor.run(
            ["sitl", "--mission", mission, "--vehicles", str(vehicles), "--speedup", speedup,
             "--seed", str(int(self._seed.value or 0)), "--port", str(port),
             "--http-port", str(http_port)]
        )  # fmt: skip
        # the task continues if the browser is closed
        background_tasks.create(fly_in(app, simulator, flight, vehicles), name="practise")


async def fly_in(app: App, simulator: Job, flight: Sequence[str], vehicles: int) -> None:
    """Fly in a simulator when it has printed the URLs of its vehicles, and end it after the flight.

    If this task is cancelled at the end of the page, both continue.
    """
    await _until(lambda: not simulator.runs or len(_urls_of(simulator)) >= vehicles)
    if not simulator.runs:
        return  # its last line has the reason
    connects = [word for url in _urls_of(simulator) for word in ("--connect", url)]
    try:
        job = app.jobs.begin([*flight, *connects])
        await _until(lambda: not job.runs)
    except UavmapError as error:
        _LOG.info(str(error))
    simulator.interrupt()


async def _until(true: Callable[[], bool]) -> None:
    """Wait for a process; a thread would delay the end of the page."""
    while not true():  # noqa: ASYNC110 - a process and its file have no event
        await asyncio.sleep(LOOK_S)


def _urls_of(simulator: Job) -> list[str]:
    return [line for line in simulator.lines() if _URL.match(line)]


class RealAircraft:
    """The tabs Preflight and Fly: the links, the findings of the doctor, and the take-off."""

    def __init__(self, visitor: Visitor, *, flies: bool) -> None:
        self._visitor = visitor
        with ui.element("div").classes("app-form"):
            self._add_form(visitor, flies=flies)
        if not flies:
            Findings(visitor)

    def _add_form(self, visitor: Visitor, *, flies: bool) -> None:
        ui.label(
            "Fly a mission with real aircraft." if flies
            else "Check whether each vehicle could fly a mission. The check arms and sets nothing."
        )  # fmt: skip
        self._mission = visitor.select("mission", visitor.app.workspace.missions)
        self._urls = ui.textarea(
            "URLs of the vehicles, one per line", value="udpin://0.0.0.0:14550"
        ).props("rows=2").classes("app-wide").mark("links")  # fmt: skip
        if flies:
            self._keeps = ui.checkbox("keep the pictures", value=True)
            with ui.row().classes("app-row"):
                visitor.button("Fly", self._fly, grave=True).mark("fly")
                visitor.button("Dry run", self._dry_run).mark("dry-run")
        else:
            visitor.button("Check the vehicles", self._examine).mark("examine")

    def _linked(self, command: str) -> list[str]:
        urls = (self._urls.value or "").split()
        for url in urls:
            parse_url(url)
        return [
            command,
            chosen_mission(self._mission),
            *(w for url in urls for w in ("--connect", url)),
        ]

    def _examine(self) -> None:
        self._visitor.run(self._linked("doctor"))

    def _dry_run(self) -> None:
        self._visitor.run([*self._linked("fly"), "--dry-run"])

    async def _fly(self) -> None:
        words = self._linked("fly")
        question = "The vehicles arm and take off after good checks. Is the field clear?"
        if await ask(question, "Take off", "Cancel") is not None:
            page = self._visitor.app.page_words("--page")
            ground = await tiles_option(self._visitor.app, chosen_mission(self._mission))
            self._visitor.run([*words, *page, "--yes", *frames_option(self._keeps), *ground])


def frames_option(keeps: ui.checkbox) -> list[str]:
    """Return the option that keeps the pictures of a flight, to be mapped and painted later."""
    return ["--keep-frames"] if keeps.value else []


async def tiles_option(app: App, mission: str) -> list[str]:
    """Return the option with the first map of the folder that shows the ground of a mission."""
    return await asyncio.to_thread(_tiles_option, app, mission)


def _tiles_option(app: App, mission: str) -> list[str]:
    setting = setting_of(load(str(app.workspace.folder / mission)))
    for name in app.grounds.files():
        with contextlib.suppress(UavmapError):
            background_from_tiles(app.grounds.path_of(name), setting)  # as the flight will do
            return ["--tiles", name]
    return []


def chosen_mission(mission: ui.select) -> str:
    """Return the chosen mission. Raises `UavmapError` without one."""
    if not mission.value:
        raise UavmapError("no mission: make one under Areas")
    return str(mission.value)


def free_ports(count: int, kind: socket.SocketKind = socket.SOCK_DGRAM) -> int:
    """Return the first of `count` consecutive ports that are free now. Raises `UavmapError`."""
    for first in range(14650, 30000, 100):
        held = []
        try:
            for port in range(first, first + count):
                held.append(socket.socket(socket.AF_INET, kind))
                held[-1].bind((LOOPBACK, port))
            return first
        except OSError:
            continue
        finally:
            for each in held:
                each.close()
    raise UavmapError("no port of this computer is free for the simulator; end another simulator")
