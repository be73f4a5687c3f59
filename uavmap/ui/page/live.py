"""A flight's page, on the side of the flight: it sends events and receives orders."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.events import Event, FrameSeen
from missions.flight.state import Setting, State
from uavmap.journal.kept_frames import KeptFrame
from uavmap.runner.service import Service
from uavmap.ui.page.feed import Feed
from uavmap.ui.page.live_board import LiveBoard, Reader
from uavmap.ui.page.page_pipe import Message
from uavmap.ui.page.page_scene import Background, marks_of

_LOG: Final = logging.getLogger("uavmap.ui.page")
UPDATE_S: Final = 0.1
"""Minimum time between two updates of the page, real s."""
PICTURE_S: Final = 1.0
"""Minimum time between two pictures, real s."""
SIMULATED: Final = "a flight with --sim accepts no orders, so that it can be repeated"
NOT_YET: Final = "orders are accepted when the vehicles have answered"
LANDED: Final = "the flight is over"


class FlightPage(LiveBoard):
    """The page of a flight, and other readers of the same board.

    A `simulated` flight accepts no orders; `now_s` is real time, s.
    """

    at_once = True

    def __init__(
        self,
        feed: Feed,
        *,
        simulated: bool,
        background: Background | None = None,
        others: Sequence[Reader] = (),
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        readers = (Reader(feed, UPDATE_S), *others)
        super().__init__(readers, simulated=simulated, background=background, now_s=now_s)
        self._feed = feed
        self._hands_off = SIMULATED if simulated else NOT_YET
        self._picture_due_s = float("-inf")
        self._pictures: dict[int, tuple[KeptFrame, bytes | NDArray[np.uint8]]] = {}
        self._shown = 0
        """Number of pictures shown so far."""

    def update(self, event: Event, state: State, again: int) -> None:
        """Show an event, and the picture of a judged frame."""
        if isinstance(event, FrameSeen):
            with self._harmless():
                self._show_picture(event, self._now_s())
        super().update(event, state, again)

    def end(self) -> None:
        """Show that the flight is over."""
        if self._watcher is not None:
            self._watcher.board.set_field("hands_off", LANDED)
        super().end()

    def _watch(self, setting: Setting) -> None:
        super()._watch(setting)
        assert self._watcher is not None
        self._watcher.board.set_field("hands_off", self._hands_off)

    def keep(self, frame: KeptFrame, picture: bytes | NDArray[np.uint8]) -> None:
        """Keep a picture until its verdicts come."""
        if not self._broken:
            self._pictures[frame.vehicle] = (frame, picture)

    @contextlib.contextmanager
    def steering(self, service: Service) -> Iterator[None]:
        """Carry out the page's orders."""
        loop, file = asyncio.get_running_loop(), self._feed.orders_file

        def receive() -> None:
            with self._harmless():
                for order in self._feed.orders():
                    answer = carry_out(service, order)
                    _LOG.info(f"page: {answer}")
                    self._feed.put({"kind": "answer", "id": order.get("id"), "text": answer})
            if self._feed.dead or self._broken:
                loop.remove_reader(file)

        self._feed.orders()  # drop clicks from before the vehicles could fly
        self._set("hands_off", "")
        with contextlib.suppress(OSError, ValueError):
            loop.add_reader(file, receive)
        try:
            yield
        finally:
            with contextlib.suppress(OSError, ValueError):
                loop.remove_reader(file)
            self._set("hands_off", LANDED)

    def _show_picture(self, event: FrameSeen, now_s: float) -> None:
        frame, picture = self._pictures.pop(event.vehicle, (None, b""))
        if now_s < self._picture_due_s or not self._feed.idle or self._watcher is None:
            return
        if frame is None or frame.t_s != event.t_s:
            return
        self._picture_due_s = now_s + PICTURE_S
        self._shown += 1
        setting = self._watcher.setting
        message: Message = {"kind": "picture", "id": str(self._shown)}
        if not isinstance(picture, bytes):
            message, picture = {**message, "shape": picture.shape}, picture.tobytes()
        if self._feed.put(message, picture):
            marks = marks_of(setting, frame, event.votes)
            self._watcher.board.set_field("picture", {"id": message["id"], **marks})


def carry_out(service: Service, order: Message) -> str:
    """Carry out one of the page's three orders; return the answer in message."""
    if not service.flying:
        return "no vehicle flies now: no order is given"
    match order:
        case {"do": "pause"}:
            done = service.pause()
            return "paused: all vehicles hold" if done else "it is paused already"
        case {"do": "continue"}:
            return "the mission continues" if service.go_on() else "it is not paused"
        case {"do": "return", "vehicle": int(number)} if not isinstance(number, bool):
            if number not in service.state.vehicles:
                return f"there is no vehicle {number}"
            if service.recall_vehicle(number):
                return f"vehicle {number} returns and stays there; the others continue"
            return f"vehicle {number} is recalled already"
        case {"do": "return", "vehicle": None}:
            service.recall()
            return "all vehicles return; the mission can be resumed"
    return "unknown order: nothing is done"
