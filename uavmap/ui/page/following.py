"""A page of a flight of another process, or of the past: it follows the journal as it grows."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Final

from missions.errors import OutputError
from missions.events import Event, FrameSeen
from missions.flight.state import Setting
from missions.flight.step import step
from uavmap.journal.event_log import JournalReader
from uavmap.journal.flight_plan import FlightPlan
from uavmap.journal.kept_frames import FRAMES, POSES, KeptFrame, read_kept
from uavmap.output.drawing.mosaic_file import ORTHO, Ground, raster_of
from uavmap.output.facts.flown_mission import DERIVED
from uavmap.ui.page.feed import Feed
from uavmap.ui.page.live_board import send_scene
from uavmap.ui.page.page_scene import (
    background_from_mosaic,
    background_from_tiles,
    marks_of,
    scene_of,
)
from uavmap.ui.page.watching import Watcher

LOOK_S: Final = 0.2
"""Time between two reads of the journal, real s."""
STEP_S: Final = 0.5
"""Minimum mission time between two updates, s."""
MAX_STEPS: Final = 2000
"""Approximate maximum number of updates of a long flight."""
WATCHES: Final = (
    "this page only watches; give orders with the keys at the terminal of `uavmap fly`, or on the "
    "page of `uavmap fly --page`"
)
PAST: Final = "the flight is over"
RECORDED: Final = "recorded pictures: no vehicle flies"
GONE: Final = "the live page has ended; run uavmap watch again"
_UNMATCHED: Final = 64
"""Maximum number of frames without a kept picture."""


class Follower:
    """A sender of a journal, and of all that is added to it, to a page.

    `tiles` is a map file beneath; by default the folder's mosaic is. Raises `MissionFileError` for
    a mission that this program does not fly, and `OutputError` for the tiles.
    """

    def __init__(self, reader: JournalReader, tiles: Path | None = None) -> None:
        self._reader = reader
        self._folder = reader.path.parent
        self.recorded = "replay" in reader.meta
        plan = FlightPlan.read(reader)
        self.setting, self._real = plan.known_setting(), not plan.simulated
        self._drawn = plan.mission_source != DERIVED
        self._background = (
            background_from_mosaic(self._folder / ORTHO, self.setting)
            if tiles is None
            else background_from_tiles(tiles, self.setting)
        )
        self._pictures = Pictures(self._folder, self.setting)
        self._version = 0

    @property
    def title(self) -> str:
        """The name of the mission."""
        return self.setting.mission.name

    def run(self, feed: Feed, sleep: Callable[[float], None] = time.sleep) -> None:
        """Follow until `KeyboardInterrupt`. Raises `OutputError` if the page ends."""
        events = self._reader.new_events()
        state = self.setting.initial_state()
        watcher = Watcher(
            state,
            recorded=self.recorded,
            weighed=self.recorded and any(event.kind == "weighed" for event in events),
            real=self._real,
            dear_s=math.inf,
        )
        ground = Ground.read(self._folder, self.setting.grid)
        raster = raster_of(self.setting) if ground is None else ground.raster
        scene = scene_of(
            self.setting, self._background, raster, recorded=self.recorded, drawn=self._drawn
        )
        send_scene(feed, scene, self._background)
        last_s = events[-1].t_s if events else 0.0
        step_s = max(STEP_S, last_s / MAX_STEPS)
        due_s = float("-inf")
        while True:
            for event in events:
                state, _ = step(state, event)
                watcher.apply(event, state)
                self._pictures.note(event)
                if state.t_s >= due_s:
                    due_s = state.t_s + step_s
                    self._send(watcher, feed)
            fresh, events = bool(events), self._reader.new_events()
            if fresh and not events:
                self._send(watcher, feed, whole=True)
            elif not events:
                sleep(LOOK_S)
                feed.orders()  # there are none; the call detects the end of the process
                if feed.dead:
                    raise OutputError(GONE)

    def _send(self, watcher: Watcher, feed: Feed, *, whole: bool = False) -> None:
        board = watcher.board
        over = watcher.state.is_over
        board.set_field("hands_off", RECORDED if self.recorded else PAST if over else WATCHES)
        if (picture := self._pictures.newest()) is not None:
            board.set_field("picture", picture)
        watcher.refresh(whole=whole)
        delta = board.since(self._version)
        if delta["v"] == self._version:
            return
        while not feed.put({"kind": "delta", "delta": delta}, wait_s=LOOK_S):
            if feed.dead:
                raise OutputError(GONE)
        self._version = delta["v"]


class Pictures:
    """The kept pictures of a flight, found by their events; they may be written later."""

    def __init__(self, folder: Path, setting: Setting) -> None:
        self._folder = folder
        self._setting = setting
        self._size = -1
        self._kept: dict[tuple[int, float], KeptFrame] = {}
        self._seen: deque[FrameSeen] = deque(maxlen=_UNMATCHED)

    def note(self, event: Event) -> None:
        """Note an event."""
        if isinstance(event, FrameSeen):
            self._seen.append(event)

    def newest(self) -> dict[str, object] | None:
        """Return the newest judged picture for a board; None if there is no newer one."""
        if not self._seen:
            return None
        self._read()
        while self._seen:
            event = self._seen[-1]
            kept = self._kept.get((event.vehicle, event.t_s))
            if kept is not None:
                self._seen.clear()
                return {"id": kept.frame, **marks_of(self._setting, kept, event.votes)}
            self._seen.pop()
        return None

    def _read(self) -> None:
        poses = self._folder / FRAMES / POSES
        try:
            size = poses.stat().st_size
            if size == self._size:
                return
            found = [kept for kept in read_kept(self._folder) if not isinstance(kept, str)]
        except (OSError, UnicodeDecodeError):
            return
        self._size = size
        self._kept = {(kept.vehicle, kept.t_s): kept for kept in found}
