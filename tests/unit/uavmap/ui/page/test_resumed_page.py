"""`uavmap resume DIR --page`: what was found before is on the page, and it goes on from there."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from missions.events import FrameSeen
from tests.support.journals import begun
from tests.support.page_feed import Feed
from tests.unit.uavmap.output.flown_folders import EVENTS, PLAN
from uavmap.ui.cli import flight_options, main
from uavmap.ui.page.board import Board
from uavmap.ui.page.page_scene import STATES


class Ready(Feed):
    """Takes everything at once."""

    idle = True


def interrupted(folder: Path) -> Path:
    """The journal of a recorded flight, up to its first pictures of the region."""
    seen = [i for i, event in enumerate(EVENTS) if isinstance(event, FrameSeen)]
    return begun(folder, PLAN, EVENTS[: seen[20]])


def test_the_page_of_a_resumed_flight_has_all_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    feed, asked = Ready(), []

    @contextlib.contextmanager
    def opened(config: Any, port: int, *served: object) -> Iterator[Any]:
        asked.append((port, config["steers"]))
        yield feed

    monkeypatch.setattr(flight_options, "opened", opened)
    folder = interrupted(tmp_path / "cut")
    assert main(["resume", str(folder), "--page", "0", "--from-home"]) == 0
    assert asked == [(0, False)]
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


def test_what_cannot_be_gone_on_with_has_no_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["resume", str(tmp_path), "--page", "0"]) == 2
    assert "journal.jsonl" in capsys.readouterr().err
    assert main(["resume", str(tmp_path), "--tiles", "x.mbtiles"]) == 2
    assert "go with --page" in capsys.readouterr().err
