"""A flight's page, from the side of the flight: events go out, orders come in."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable, Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from missions.events import Event, FrameSeen
from missions.flight.state import Setting, State
from uavmap.journal.kept_frames import KeptFrame
from uavmap.output.drawing.mosaic_file import raster_of
from uavmap.runner.operator.company import Onlooker
from uavmap.runner.service import Service
from uavmap.ui.page.feed import Feed
from uavmap.ui.page.page_pipe import Words
from uavmap.ui.page.page_scene import Background, marks_of, scene_of
from uavmap.ui.page.watching import Watcher

_LOG: Final = logging.getLogger("uavmap.ui.page")
UPDATE_S: Final = 0.1
"""Minimum time between two updates of the page, real seconds."""
PICTURE_S: Final = 1.0
"""Minimum time between two pictures, real seconds."""
SIMULATED: Final = "a flight that is simulated with --sim takes no orders: nobody could repeat it"
NOT_YET: Final = "orders are taken once the vehicles have answered"
LANDED: Final = "the flight is over"


class FlightPage(Onlooker):
    """Shows a flight and its lines. A `simulated` one takes no orders; `now_s` is real time."""

    def __init__(
        self,
        feed: Feed,
        *,
        simulated: bool,
        background: Background | None = None,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._feed = feed
        self._hands_off, self._real = (SIMULATED if simulated else NOT_YET), not simulated
        self._now_s = now_s
        self._background = background
        self._watcher: Watcher | None = None
        self._looked_back = False
        """Whether the watcher has earlier events, and the flight has not begun."""
        self._said: list[str] = []
        """Lines from before there was a board."""
        self._version = 0
        """Of the board, as the page knows it."""
        self._due_s = self._picture_due_s = float("-inf")
        self._pictures: dict[int, tuple[KeptFrame, bytes | NDArray[np.uint8]]] = {}
        self._shown = 0
        """How many pictures."""
        self._broken = False

    def show(self, text: str) -> None:
        """Add a line to the page's log."""
        with self._harmless():
            if self._watcher is None:
                self._said.append(text)
            else:
                self._watcher.say(text)

    def begin(self, setting: Setting, *, again: bool) -> None:
        """The flight starts."""
        with self._harmless():
            before, self._looked_back = self._looked_back, False
            if not before:
                self._watch(setting)
            self._show(whole=before)

    def update(self, event: Event, state: State, again: int) -> None:
        """An event was taken in."""
        with self._harmless():
            if self._watcher is None:
                return
            self._watcher.take_in(event, state)
            now_s = self._now_s()
            if isinstance(event, FrameSeen):
                self._show_picture(event, now_s)
            if now_s >= self._due_s:
                self._due_s = now_s + UPDATE_S
                self._show()

    def end(self) -> None:
        """The flight is over."""
        with self._harmless():
            if self._watcher is not None:
                self._watcher.board.set_field("hands_off", LANDED)
                self._show(whole=True)

    def close(self, text: str) -> None:
        """Show why nothing more will come."""
        with self._harmless():
            self._show(whole=True)
            self._feed.put({"kind": "ended", "text": text})

    def _watch(self, setting: Setting) -> None:
        self._watcher = Watcher(
            setting.initial_state(), real=self._real, words=False, now_s=self._now_s
        )
        self._watcher.board.set_field("hands_off", self._hands_off)
        scene = scene_of(setting, self._background, raster_of(setting))
        send_scene(self._feed, scene, self._background)
        for text in self._said:
            self._watcher.say(text)

    def look_back(self, event: Event, state: State) -> None:
        """Note an event before the interruption of a resumed flight; shown at its beginning."""
        if self._broken:
            return
        with self._harmless():
            if not self._looked_back:
                self._looked_back = True
                self._watch(state.setting)
            if self._watcher is not None:
                self._watcher.take_in(event, state)

    def keep(self, frame: KeptFrame, picture: bytes | NDArray[np.uint8]) -> None:
        """Keep a picture until its verdicts come."""
        if not self._broken:
            self._pictures[frame.vehicle] = (frame, picture)

    @contextlib.contextmanager
    def steering(self, service: Service) -> Iterator[None]:
        """Carry out the page's orders."""
        loop, file = asyncio.get_running_loop(), self._feed.orders_file

        def hear() -> None:
            with self._harmless():
                for order in self._feed.orders():
                    answer = carry_out(service, order)
                    _LOG.info(f"page: {answer}")
                    self._feed.put({"kind": "answer", "id": order.get("id"), "text": answer})
            if self._feed.dead or self._broken:
                loop.remove_reader(file)

        self._feed.orders()  # a click before the vehicles can fly is no order
        self._set("hands_off", "")
        with contextlib.suppress(OSError, ValueError):
            loop.add_reader(file, hear)
        try:
            yield
        finally:
            with contextlib.suppress(OSError, ValueError):
                loop.remove_reader(file)
            self._set("hands_off", LANDED)

    # --- out -------------------------------------------------------------------------------
    def _set(self, name: str, value: Any) -> None:
        with self._harmless():
            if self._watcher is not None:
                self._watcher.board.set_field(name, value)
                self._show()

    def _show(self, *, whole: bool = False) -> None:
        """Send what is new; while the page is busy nothing, and more of it later."""
        watcher, feed = self._watcher, self._feed
        if watcher is None or not (whole or feed.idle):
            if feed.dead:
                feed.put({})  # which logs it
            return
        watcher.refresh(whole=whole)
        delta = watcher.board.since(self._version)
        if delta["v"] != self._version and feed.put({"kind": "delta", "delta": delta}):
            self._version = delta["v"]

    def _show_picture(self, event: FrameSeen, now_s: float) -> None:
        frame, picture = self._pictures.pop(event.vehicle, (None, b""))
        if now_s < self._picture_due_s or not self._feed.idle or self._watcher is None:
            return
        if frame is None or frame.t_s != event.t_s:
            return
        self._picture_due_s = now_s + PICTURE_S
        self._shown += 1
        setting = self._watcher.setting
        words: Words = {"kind": "picture", "id": str(self._shown)}
        if not isinstance(picture, bytes):
            words, picture = {**words, "shape": picture.shape}, picture.tobytes()
        if self._feed.put(words, picture):
            marks = marks_of(setting, frame, event.votes)
            self._watcher.board.set_field("picture", {"id": words["id"], **marks})

    @contextlib.contextmanager
    def _harmless(self) -> Iterator[None]:
        """End the page, and nothing else, at any failure in here."""
        try:
            yield
        except Exception as failure:
            if self._broken:
                return
            self._broken, self._watcher = True, None
            self._pictures.clear()
            _LOG.info(
                f"the live page has failed ({type(failure).__name__}: {failure}); the flight goes "
                "on without it"
            )


def send_scene(feed: Feed, scene: Words, background: Background | None) -> None:
    """Send a page what does not change, the background of the map first."""
    if background is not None and background.jpeg:
        feed.put({"kind": "background"}, background.jpeg)
    feed.put({"kind": "scene", "scene": scene})


def carry_out(service: Service, order: Words) -> str:
    """Carry out one of the page's three orders; return the answer in words."""
    if not service.flying:
        return "nobody flies now: nothing is ordered"
    match order:
        case {"do": "pause"}:
            done = service.pause()
            return "paused: everybody holds" if done else "it is paused already"
        case {"do": "continue"}:
            return "the mission goes on" if service.go_on() else "it is not paused"
        case {"do": "return", "vehicle": int(number)} if not isinstance(number, bool):
            if number not in service.state.vehicles:
                return f"there is no vehicle {number}"
            if service.recall_vehicle(number):
                return f"vehicle {number} comes home and stays there; the others go on"
            return f"vehicle {number} is called home already"
        case {"do": "return", "vehicle": None}:
            service.recall()
            return "everybody comes home; the mission can be resumed"
    return "that is no order: nothing is done"
