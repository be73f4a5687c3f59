"""Practise, Preflight, Fly: a mission in the simulator, or with aircraft at the end of links."""

from __future__ import annotations

import asyncio
import logging
import re
import socket
from collections.abc import Sequence
from typing import Final

from nicegui import background_tasks, ui

from missions.errors import UavmapError
from uavmap.ui.app.jobs import Job
from uavmap.ui.app.visitor import App, Visitor
from uavmap.ui.page.feed import LOOPBACK
from uavmap.ui.page.server import asked

_LOG: Final = logging.getLogger("uavmap.ui.app")
SPEEDUPS: Final = {1: "real time", 5: "5 times", 20: "20 times"}
LOOK_S: Final = 0.3
_URL: Final = re.compile(r"^\w+://\S+$")


class Practise:
    """The same mission, with the same buttons, in the simulator."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor = visitor
        ui.label("Fly a mission in the simulator. The live page has the buttons of a real flight.")
        self._mission = visitor.select("mission", visitor.app.workspace.missions)
        self._vehicles = ui.number("vehicles", value=1, min=1, max=20, format="%d")
        self._speedup = ui.select(SPEEDUPS, value=5, label="how fast").mark("speedup")
        self._seed = ui.number("seed", value=1, min=0, format="%d")
        visitor.button("Practise", self._begin).mark("practise")

    def _begin(self) -> None:
        mission, app = self._mission.value, self._visitor.app
        if not mission:
            ui.notify("no mission: make one under Areas")
            return
        vehicles, speedup = int(self._vehicles.value or 1), str(self._speedup.value)
        port, http_port = free_ports(vehicles), free_ports(1, socket.SOCK_STREAM)
        simulator = self._visitor.run(
            ["sitl", "--mission", mission, "--vehicles", str(vehicles), "--speedup", speedup,
             "--seed", str(int(self._seed.value or 0)), "--port", str(port),
             "--http-port", str(http_port)]
        )  # fmt: skip
        flight = ["fly", mission, "--speedup", speedup, "--page", "0", "--yes", "--auto-swap"]
        if simulator is not None:
            # it goes on where the browser is closed
            background_tasks.create(flown_in(app, simulator, flight, vehicles), name="practise")


async def flown_in(app: App, simulator: Job, flight: Sequence[str], vehicles: int) -> None:
    """Fly in a simulator once it has printed the URLs of its vehicles, and end it after that.

    Both go on where this is cancelled, because the page ends.
    """
    while simulator.runs and len(urls := _urls_of(simulator)) < vehicles:  # noqa: ASYNC110 - no event
        await asyncio.sleep(LOOK_S)
    if not simulator.runs:
        return  # its last line says why
    try:
        job = app.jobs.begin([*flight, *(word for url in urls for word in ("--connect", url))])
        await asyncio.to_thread(job.process.wait)
    except UavmapError as error:
        _LOG.info(str(error))
    simulator.interrupt()


def _urls_of(simulator: Job) -> list[str]:
    return [line for line in simulator.lines() if _URL.match(line)]


class RealAircraft:
    """Preflight and Fly: the links, what the doctor says, and the take-off."""

    def __init__(self, visitor: Visitor, *, flies: bool) -> None:
        self._visitor = visitor
        ui.label(
            "Fly a mission with real aircraft." if flies
            else "Ask each vehicle whether it could fly a mission. Nothing is armed or set."
        )  # fmt: skip
        self._mission = visitor.select("mission", visitor.app.workspace.missions)
        self._urls = ui.textarea(
            "links, a line for each vehicle", value="udpin://0.0.0.0:14550"
        ).classes("app-wide").mark("links")  # fmt: skip
        if flies:
            visitor.button("Fly", self._fly, grave=True).mark("fly")
            visitor.button("Dry run", self._dry_run).mark("dry-run")
        else:
            visitor.button("Ask the vehicles", self._examine).mark("examine")

    def _linked(self, command: str) -> list[str] | None:
        urls = (self._urls.value or "").split()
        if not self._mission.value:
            ui.notify("no mission: make one under Areas")
            return None
        if wrong := [url for url in urls if not _URL.match(url)]:
            ui.notify(f"{wrong[0]}: is no link; give one such as udpin://0.0.0.0:14550")
            return None
        return [command, self._mission.value, *(w for url in urls for w in ("--connect", url))]

    def _examine(self) -> None:
        if (words := self._linked("doctor")) is not None:
            self._visitor.run(words)

    def _dry_run(self) -> None:
        if (words := self._linked("fly")) is not None:
            self._visitor.run([*words, "--dry-run"])

    async def _fly(self) -> None:
        words = self._linked("fly")
        question = "Vehicles arm and take off once all checks are good. Is the field clear?"
        if words is not None and await asked(question, "Take off", "Cancel") is not None:
            self._visitor.run([*words, "--page", "0", "--yes"])


def free_ports(count: int, kind: socket.SocketKind = socket.SOCK_DGRAM) -> int:
    """Return the first of so many ports in a row that are free now. Raises `OSError`."""
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
    raise OSError("no port is free")
