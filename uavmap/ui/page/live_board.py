"""A flight on a board, for the processes that show it: a page and a TAK link."""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

from missions.events import Event, Tracked
from missions.flight.state import Setting, State
from uavmap.aircraft.process.messages import Telemetry
from uavmap.output.drawing.mosaic_file import raster_of
from uavmap.runner.operator.company import Onlooker
from uavmap.ui.page.feed import Feed
from uavmap.ui.page.page_scene import Background, scene_of
from uavmap.ui.page.watching import Watcher

_LOG: Final = logging.getLogger("uavmap.ui.page")
MAX_WAITING: Final = 500
"""Maximum number of events that wait for the next place of a vehicle."""


@dataclass(slots=True, eq=False)
class Reader:
    """A process that shows the board.

    Attributes:
        every_s: Minimum time between two updates, real s.
        reports: True if its lines are for the operator; the lines of a page are orders.
    """

    feed: Feed
    every_s: float
    reports: bool = False
    version: int = 0
    """Version of the board that the process has."""
    due_s: float = float("-inf")


class LiveBoard(Onlooker):
    """A sender of a flight and its lines to readers.

    Events wait for the next place of a vehicle, so that no work here delays an order after a
    picture. A failure here ends the readers, and nothing else. `now_s` is real time, s.
    """

    at_once = False
    """True if each event is shown at once, as on a page with pictures."""

    def __init__(
        self,
        readers: Sequence[Reader],
        *,
        simulated: bool,
        background: Background | None = None,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._readers = tuple(readers)
        self._real = not simulated
        self._background = background
        self._now_s = now_s
        self._watcher: Watcher | None = None
        self._waiting: list[tuple[Event, State]] = []
        self._looked_back = False
        """True if the watcher has earlier events, and the flight has not begun."""
        self._early_lines: list[str] = []
        """Lines from before the board was made."""
        self._broken = False

    def show(self, text: str) -> None:
        """Add a line to the log."""
        with self._harmless():
            if self._watcher is None:
                self._early_lines.append(text)
            else:
                self._watcher.log(text)

    def begin(self, setting: Setting, *, again: bool) -> None:
        """Show the start of the flight."""
        with self._harmless():
            before, self._looked_back = self._looked_back, False
            if not before:
                self._watch(setting)
            self._send(self._readers, whole=before)

    def update(self, event: Event, state: State, again: int) -> None:
        """Show an event, with the next place of a vehicle."""
        with self._harmless():
            if self._watcher is None:
                return
            self._waiting.append((event, state))
            ripe = isinstance(event, Tracked) or len(self._waiting) > MAX_WAITING
            if not (ripe or self.at_once):
                return
            now_s = self._now_s()
            due = [reader for reader in self._readers if now_s >= reader.due_s]
            for reader in due:
                reader.due_s = now_s + reader.every_s
            self._send(due)

    def see_telemetry(self, telemetry: Telemetry) -> None:
        """Note a vehicle's report; it is shown with the next event."""
        if self._watcher is not None:
            self._watcher.figures.note_telemetry(telemetry)

    def end(self) -> None:
        """Show the end of the flight."""
        with self._harmless():
            self._send(self._readers, whole=True)

    def close(self, text: str) -> None:
        """Show the reason for the end."""
        with self._harmless():
            self._send(self._readers, whole=True)
            for reader in self._readers:
                reader.feed.put({"kind": "ended", "text": text})

    def see_earlier(self, event: Event, state: State) -> None:
        """Note an event from before a resume; it is shown at the start of the flight."""
        if self._broken:
            return
        with self._harmless():
            if not self._looked_back:
                self._looked_back = True
                self._watch(state.setting)
            if self._watcher is not None:
                self._watcher.apply(event, state)

    def _watch(self, setting: Setting) -> None:
        self._watcher = Watcher(
            setting.initial_state(), real=self._real, words=False, now_s=self._now_s
        )
        scene = scene_of(setting, self._background, raster_of(setting))
        for reader in self._readers:
            send_scene(reader.feed, scene, None if reader.reports else self._background)
        for text in self._early_lines:
            self._watcher.log(text)

    def _set(self, name: str, value: Any) -> None:
        """Show a field at once."""
        with self._harmless():
            if self._watcher is not None:
                self._watcher.board.set_field(name, value)
                self._send(self._readers)

    def _send(self, readers: Sequence[Reader], *, whole: bool = False) -> None:
        """Send the changes to idle readers; a busy one gets them later."""
        watcher, free = self._watcher, []
        if watcher is not None:
            for event, state in self._waiting:
                watcher.apply(event, state)
            self._waiting.clear()
        for reader in readers:
            if reader.reports:
                self._report(reader.feed)
            if watcher is not None and (whole or reader.feed.idle):
                free.append(reader)
            elif reader.feed.dead:
                reader.feed.put({})  # this logs its end
        if watcher is None or not free:
            return
        watcher.refresh(whole=whole)
        for reader in free:
            delta = watcher.board.since(reader.version)
            news = delta["v"] != reader.version
            if news and reader.feed.put({"kind": "delta", "delta": delta}):
                reader.version = delta["v"]

    @staticmethod
    def _report(feed: Feed) -> None:
        if not feed.dead:
            log_reports(feed.orders())

    @contextlib.contextmanager
    def _harmless(self) -> Iterator[None]:
        """End only the readers if the code in the context fails."""
        try:
            yield
        except Exception as failure:
            if self._broken:
                return
            self._broken, self._watcher = True, None
            self._waiting.clear()
            names = " and ".join(reader.feed.title for reader in self._readers)
            _LOG.info(
                f"{names} {'has' if len(self._readers) == 1 else 'have'} failed "
                f"({type(failure).__name__}: {failure}); the flight continues without"
                f"{' it' if len(self._readers) == 1 else ' them'}"
            )


def log_reports(lines: Sequence[dict[str, Any]]) -> None:
    """Log what a process reports to the operator."""
    for message in lines:
        if text := message.get("report"):
            _LOG.info(str(text))


def send_scene(feed: Feed, scene: dict[str, Any], background: Background | None) -> None:
    """Send a process the constant parts: the background of the map, then the scene."""
    if background is not None and background.jpeg:
        feed.put({"kind": "background"}, background.jpeg)
    feed.put({"kind": "scene", "scene": scene})
