"""The journal of another process as a page: while it is written, and when it is whole."""

from __future__ import annotations

import contextlib
import json
import math
import os

import numpy as np
import pytest

from missions.errors import JournalError
from missions.events import FrameSeen, FrameWeighed, Vote
from missions.units import Cell, Pose, Quaternion
from tests.golden.recording import STOPS
from tests.support import journals
from tests.support.page.page_feed import Feed
from tests.unit.uavmap.output.flown_folders import EVENTS, PLAN
from uavmap.journal.event_log import Journal, JournalReader
from uavmap.journal.flight_plan import JOURNAL
from uavmap.journal.kept_frames import FrameKeeper, KeptFrame
from uavmap.output.facts.figures import figures
from uavmap.ui.cli import flight_options, main
from uavmap.ui.cli.commands import watch
from uavmap.ui.page import following
from uavmap.ui.page.board import Board
from uavmap.ui.page.following import WATCHES, Follower, Pictures
from uavmap.ui.page.page_pipe import Message
from uavmap.ui.page.page_scene import STATES


class EnoughError(Exception):
    """Raised when no browser watches any longer."""


def begun(folder, **meta):
    return Journal.create(folder / JOURNAL, {"plan": PLAN.as_json(), **meta})


def opened_in(module, feed, monkeypatch):
    """Serve pages of a module by a feed; return the list of its requests."""
    asked = []

    @contextlib.contextmanager
    def opened(*served):
        asked.append(served)
        yield feed

    monkeypatch.setattr(module, "serve_page", opened)
    return asked


def test_journal_is_followed_while_it_is_written(tmp_path):
    feed = Feed()
    third = len(EVENTS) // 3
    with begun(tmp_path) as journal:
        journal.append_all(EVENTS[:third])
        follower = Follower(JournalReader(tmp_path / JOURNAL))
        assert follower.title == STOPS.setting().mission.name
        parts = iter([EVENTS[third : 2 * third], EVENTS[2 * third :], None])

        def sleep(_):
            """Continue the flight while no event is new."""
            part = next(parts)
            if part is None:
                raise EnoughError
            assert feed.board.field("hands_off") == WATCHES
            journal.append_all(part)

        with pytest.raises(EnoughError):
            follower.run(feed, sleep)
    state, _ = figures(STOPS.setting(), EVENTS)
    assert feed.board.field("over")
    assert feed.board.field("roi") == len(state.belief.roi)
    assert feed.board.field("hands_off") == "the flight is over"
    times = [delta["fields"].get("t_s") for delta in feed.deltas]
    assert len([t for t in times if t is not None]) > 30


def test_read_only_folder_can_be_watched(tmp_path):
    with begun(tmp_path) as journal:
        journal.append_all(EVENTS[:9])
    (tmp_path / JOURNAL).chmod(0o400)
    tmp_path.chmod(0o500)
    try:
        assert len(JournalReader(tmp_path / JOURNAL).new_events()) == 9
    finally:
        tmp_path.chmod(0o700)


def test_exchanged_journal_is_reported(tmp_path):
    with begun(tmp_path) as journal:
        journal.append_all(EVENTS[:9])
    reader = JournalReader(tmp_path / JOURNAL)
    assert len(reader.new_events()) == 9
    lines = (tmp_path / JOURNAL).read_bytes().splitlines(keepends=True)
    (tmp_path / JOURNAL).write_bytes(b"".join(lines[:6]))
    with pytest.raises(JournalError, match="exchanged"):
        reader.new_events()


def test_command_watches_until_control_c(tmp_path, monkeypatch):
    with begun(tmp_path) as journal:
        journal.append_all(EVENTS)
    before = (tmp_path / JOURNAL).read_bytes()

    class Interrupted(Feed):
        def orders(self) -> list[Message]:  # requested after all events
            raise KeyboardInterrupt

    feed = Interrupted()
    asked = opened_in(watch, feed, monkeypatch)
    monkeypatch.setattr(following, "LOOK_S", 0.0)
    assert main(["watch", str(tmp_path), "--port", "9123", "--page-host", "0.0.0.0"]) == 0
    ((config, *served),) = asked
    assert served == [9123, "--port", "0.0.0.0"]
    assert (config["steers"], config["timeline"]) == (False, True)
    assert feed.board.field("over")
    assert os.listdir(tmp_path) == [JOURNAL]
    assert (tmp_path / JOURNAL).read_bytes() == before


def test_kept_pictures_are_found_by_their_events(tmp_path):
    setting = STOPS.setting()
    pictures = Pictures(tmp_path, setting)
    seen = FrameSeen(1, 12.5, None, (Vote(Cell(0, 0), True, 0.9), Vote(Cell(1, 0), False, 0.1)))
    pictures.note(seen)
    assert pictures.newest() is None
    with FrameKeeper(tmp_path, lambda text: None) as keeper:
        down = Quaternion.from_euler(0.0, -math.pi / 2, 0.0)
        pose = Pose(setting.mission.home, 12.0, down)
        keeper.keep(KeptFrame("", 1, 12.5, pose, 80.0), np.zeros((24, 32, 3), np.uint8))
    with (tmp_path / "frames" / "poses.csv").open("a") as file:
        file.write("damaged\n")
    pictures.note(seen)
    found = pictures.newest()
    assert found["id"] == "1-000012.500.jpg"
    first, second = found["cells"]
    assert (first[8:], second[8:]) == ([1, 0.9], [0, 0.1])
    assert sum(first[0:8:2]) / 4 == pytest.approx(0.5, abs=0.01)  # right below the camera
    assert sum(first[1:8:2]) / 4 == pytest.approx(0.5, abs=0.01)
    assert pictures.newest() is None


@pytest.mark.parametrize("weighed", [True, False])
def test_recorded_pictures_are_shown_by_their_rule(weighed, tmp_path):
    with begun(tmp_path, replay="photos") as journal:
        for t_s, positive in enumerate((True, True, True, False)):
            votes = (Vote(Cell(0, 0), positive, 0.9 * positive), Vote(Cell(1, 0), False, 0.0))
            journal.append(FrameSeen(1, float(t_s), None, votes))
            if weighed:
                journal.append(FrameWeighed(1, float(t_s), (0.5, 0.5)))
    follower, feed = Follower(JournalReader(tmp_path / JOURNAL)), Feed()
    with pytest.raises(EnoughError):
        follower.run(feed, enough)
    shown = {cell: STATES[code] for cell, code in feed.board.cells.items()}
    assert shown == {(0, 0): "explored", (1, 0): "non-roi"}
    assert feed.board.vehicles == ()
    assert feed.board.field("hands_off") == following.RECORDED
    assert feed.board.field("frames") == [4, 0]


def enough(_):
    """End: no event is new."""
    raise EnoughError


# --- a flight that is resumed with a page ------------------------------------------------------
class Ready(Feed):
    idle = True


def interrupt(folder):
    seen = [i for i, event in enumerate(EVENTS) if isinstance(event, FrameSeen)]
    return journals.begun(folder, PLAN, EVENTS[: seen[20]])


def test_page_of_a_resumed_flight_has_all_of_it(tmp_path, monkeypatch):
    feed = Ready()
    asked = opened_in(flight_options, feed, monkeypatch)
    folder = interrupt(tmp_path / "cut")
    assert main(["resume", str(folder), "--page", "0", "--from-home"]) == 0
    ((config, port, *_),) = asked
    assert (port, config["steers"]) == (0, False)
    first, *deltas = feed.deltas
    board = Board()
    board.apply(first)
    assert board.cells
    assert board.since(0)["tracks"]
    for delta in deltas:
        board.apply(delta)
    summary = json.loads((folder / "summary.json").read_text())
    explored = [STATES[code] for code in board.cells.values()].count("explored")
    assert explored == summary["cells_roi"] > 0
    assert board.field("phase") == "over, complete"
    kinds = feed.kinds
    assert (kinds[0], kinds.count("scene"), kinds[-1]) == ("scene", 1, "ended")


def test_flight_that_cannot_be_resumed_has_no_page(tmp_path, refused):
    assert "journal.jsonl" in refused("resume", tmp_path, "--page", "0")
    assert "need --page" in refused("resume", tmp_path, "--tiles", "x.mbtiles")
