"""`uavmap resume DIR --page`: what was found before is on the page, and it goes on from there."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from missions.events import FrameSeen, from_json
from tests.golden.recording import STOPS
from tests.support.plans import named_text, plan_of
from tests.unit.uavmap.ui.page.test_flight_page import Feed
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import JOURNAL
from uavmap.ui.cli import flight_options, main
from uavmap.ui.page.board import Board
from uavmap.ui.page.feed import Wishes
from uavmap.ui.page.page_scene import STATES


class Ready(Feed):
    """Takes everything at once."""

    idle = True


def interrupted(folder: Path) -> Path:
    """The journal of a recorded flight, up to its first pictures of the region."""
    source = named_text(STOPS.mission)
    plan = plan_of(source.source, source.text, STOPS.strategy, 1, STOPS.seed)
    events = [from_json(line) for line in STOPS.lines()]
    seen = [i for i, event in enumerate(events) if isinstance(event, FrameSeen)]
    with Journal.create(folder / JOURNAL, {"plan": plan.as_json()}) as journal:
        for event in events[: seen[20]]:
            journal.append(event)
    return folder


def test_the_page_of_a_resumed_flight_has_all_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    feed, asked = Ready(), []

    @contextlib.contextmanager
    def opened(wishes: Wishes, config: Any) -> Iterator[Any]:
        asked.append((wishes.port, config["steers"]))
        yield feed

    monkeypatch.setattr(flight_options, "opened", opened)
    folder = interrupted(tmp_path / "cut")
    assert main(["resume", str(folder), "--page", "0", "--from-home"]) == 0
    assert asked == [(0, False)]
    first, *deltas = [words["delta"] for words, _ in feed.told if words["kind"] == "delta"]
    board = Board()
    board.apply(first)
    assert board.cells
    assert board.since(0)["tracks"]
    for delta in deltas:
        board.apply(delta)
    summary = json.loads((folder / "summary.json").read_text())
    explored = [STATES[code] for code in board.cells.values()].count("explored")
    assert explored == summary["cells_roi"] > 0
    assert board.field("completed")
    kinds = [words["kind"] for words, _ in feed.told]
    assert (kinds[0], kinds.count("scene"), kinds[-1]) == ("scene", 1, "ended")


def test_what_cannot_be_gone_on_with_has_no_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["resume", str(tmp_path), "--page", "0"]) == 2
    assert "journal.jsonl" in capsys.readouterr().err
    assert main(["resume", str(tmp_path), "--tiles", "x.mbtiles"]) == 2
    assert "go with --page" in capsys.readouterr().err
