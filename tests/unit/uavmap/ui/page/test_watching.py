"""A recorded flight on a board: the cells of its map, the figures of its summary."""

import json

import numpy as np
import pytest
from shapely.geometry import LineString, Point

from missions.events import Tracked, from_json
from missions.flight.step import step
from missions.flight.vehicle_state import Phase
from missions.orders import FlyPath, FlyTo, Sweep
from tests.golden.recording import PASSES, SPILL, STOPS
from uavmap.output.facts.figures import figures
from uavmap.output.results import map_data
from uavmap.ui.page import watching
from uavmap.ui.page.board import Board
from uavmap.ui.page.page_scene import STATES, scene_of
from uavmap.ui.page.watching import UNTIMED_S, Ahead, Watcher


def test_the_board_of_a_flight_is_its_map(monkeypatch):
    monkeypatch.setattr(watching, "MOST_CELLS", 7)
    setting = STOPS.setting()
    events = [from_json(line) for line in STOPS.lines()]
    state, copy = setting.initial_state(), Board()
    watcher = Watcher(state, now_s=lambda: 0.0)
    for index, event in enumerate(events):
        state, _ = step(state, event)
        watcher.take_in(event, state)
        if index % 5 == 0 and watcher.refresh():
            copy.apply(json.loads(json.dumps(watcher.board.since(copy.version))))
    watcher.refresh(whole=True)
    copy.apply(watcher.board.since(copy.version))
    final, found = figures(setting, events)
    table = map_data(final, found, None).cells
    rows = {tuple(cell): state for cell, state, *_ in table.values()}
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


def test_the_figures_of_a_flight_without_stopping_agree_at_any_time():
    setting = PASSES.setting()
    state, said = setting.initial_state(), set[str]()
    watcher = Watcher(state, now_s=lambda: 0.0)
    for line in PASSES.lines():
        state, _ = step(state, event := from_json(line))
        watcher.take_in(event, state)
        watcher.refresh()
        if "ROI cells decided" in (known := watcher.board.field("known")):
            assert known.startswith(f"{watcher.board.field('roi')} ")
            said.add(known)
    assert len(said) > 3


def test_the_scene_is_for_json():
    setting = STOPS.setting()
    scene = json.loads(json.dumps(scene_of(setting)))
    assert scene["states"][0][0] == "explored"
    assert len(scene["box"]) == len(setting.mission.search.box)
    assert scene["drift_m_s"] == [0.0, 0.0]


MOST_M = 4.0
"""A copter is so far off its path at most, in these flights, and its position a little wrong."""


@pytest.mark.parametrize(
    ("recording", "kinds"), [(STOPS, {"FlyTo", "Sweep"}), (PASSES, {"FlyPath"})]
)
def test_it_is_flown(recording, kinds):
    setting, lines = recording.setting(), recording.lines()[:160]
    state, ahead = setting.initial_state(), Ahead(setting)
    told = {}
    begun = {}
    seen = set()
    news = 0
    for line in lines:
        state, _ = step(state, event := from_json(line))
        for number, vehicle in state.vehicles.items():
            here = Point(setting.grid.to_moving(vehicle.position, state.t_s))
            if isinstance(event, Tracked) and event.vehicle == number and told.get(number):
                path = told[number]
                points = [begun[number], *zip(path[1::3], path[2::3], strict=True)]
                assert LineString(points).distance(here) < MOST_M
            if (path := ahead.news(vehicle, state.t_s)) is not None:
                news += 1
                told[number], begun[number] = path, here
                seen.add(type(vehicle.order).__name__)
                if isinstance(vehicle.order, FlyPath):
                    assert path[::3] == sorted(path[::3])
                    assert path[-3] == pytest.approx(vehicle.order.trajectory.end_s, abs=0.06)
                elif path:
                    assert isinstance(vehicle.order, FlyTo | Sweep)
                    assert set(path[::3]) == {UNTIMED_S}
                assert len(path) <= 300
    assert kinds <= seen
    assert news < len(lines) / 2  # it is told again for a new order only


def test_over_a_region_that_drifts_it_is_where_the_path_will_be():
    setting, lines = SPILL.setting(), SPILL.lines()
    state, ahead = setting.initial_state(), Ahead(setting)
    for line in lines:
        state, _ = step(state, from_json(line))
        if isinstance(order := state.vehicles[1].order, FlyPath):
            break
    path = ahead.news(state.vehicles[1], state.t_s)
    assert path
    shown = LineString(list(zip(path[1::3], path[2::3], strict=True)))
    end_s = order.trajectory.end_s
    for time_s in np.linspace(path[0], end_s, 50):
        place = setting.grid.to_moving(order.trajectory.place_at(time_s), time_s)
        assert shown.distance(Point(place)) < 0.6
    straight = setting.grid.to_moving(order.trajectory.place_at(end_s), 0.0)
    assert shown.distance(Point(straight)) > 10.0  # it does drift


def test_who_is_not_ours_has_no_path():
    setting = STOPS.setting()
    vehicle = setting.initial_state().vehicles[1]
    ahead = Ahead(setting)
    assert ahead.news(vehicle, 0.0) == []
    assert ahead.news(vehicle, 1.0) is None
    assert vehicle.phase is not Phase.AIRBORNE
