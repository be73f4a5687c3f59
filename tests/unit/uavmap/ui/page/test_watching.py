"""A recorded flight on a board: the cells of its map, the figures of its summary."""

from __future__ import annotations

import json

import pytest

from missions.events import from_json
from missions.flight.state import State
from missions.flight.step import step
from tests.golden.recording import PASSES, STOPS
from uavmap.output.facts.figures import figures
from uavmap.output.write_results import map_data
from uavmap.ui.page import watching
from uavmap.ui.page.board import Board
from uavmap.ui.page.page_scene import STATES, scene_of
from uavmap.ui.page.watching import Watcher


def test_the_board_of_a_flight_is_its_map(monkeypatch: pytest.MonkeyPatch) -> None:
    """In small refreshes, each of which looks at a few cells of the tree only."""
    monkeypatch.setattr(watching, "MOST_CELLS", 7)
    setting = STOPS.setting()
    events = [from_json(line) for line in STOPS.lines()]
    state, copy = State.initial(setting), Board()
    watcher = Watcher(setting, state, now_s=lambda: 0.0)
    for index, event in enumerate(events):
        state, _ = step(setting, state, event)
        watcher.take_in(event, state)
        if index % 5 == 0 and watcher.refresh():
            copy.apply(json.loads(json.dumps(watcher.board.since(copy.version))))
    watcher.refresh(whole=True)
    copy.apply(watcher.board.since(copy.version))
    final, found = figures(setting, events)
    rows = {row.cell: row.state for row in map_data(setting, final, found, None).cells}
    shown = {cell: STATES[code] for cell, code in copy.cells.items()}
    assert shown == rows
    fields = copy.since(0)["fields"]
    assert (fields["over"], fields["phase"]) == (True, "over, complete")
    assert fields["certificate"]["exploration_s"] == found.exploration_s
    assert fields["certificate"]["lower_bound_s"] == found.lower_bound_s
    assert fields["left"]["what"] == "nothing more to explore"
    vehicle = copy.since(0)["vehicles"]["1"]
    assert vehicle["sorties"] == found.sorties
    assert vehicle["landed"]
    assert any("has taken off" in text for *_, text in copy.since(0)["log"])


def test_the_figures_of_a_flight_without_stopping_agree_at_any_time() -> None:
    """Also between two times at which what is dear is computed."""
    setting = PASSES.setting()
    state, said = State.initial(setting), set[str]()
    watcher = Watcher(setting, state, now_s=lambda: 0.0)
    for line in PASSES.lines():
        state, _ = step(setting, state, event := from_json(line))
        watcher.take_in(event, state)
        watcher.refresh()
        if "ROI cells decided" in (known := watcher.board.field("known")):
            assert known.startswith(f"{watcher.board.field('roi')} ")
            said.add(known)
    assert len(said) > 3


def test_the_scene_is_for_json() -> None:
    setting = STOPS.setting()
    scene = json.loads(json.dumps(scene_of(setting)))
    assert scene["states"][0][0] == "explored"
    assert len(scene["box"]) == len(setting.mission.search.box)
    assert scene["drift_m_s"] == [0.0, 0.0]
