"""A recorded flight on a board: the cells of its map, the figures of its summary."""

import json

import numpy as np
import pytest
from shapely.geometry import LineString, Point

from missions.classes import ClassShare
from missions.events import Tracked, from_json
from missions.fleet_events import Fact, FactsShared
from missions.flight.setting_of import setting_of
from missions.flight.step import step
from missions.flight.vehicle_state import Phase
from missions.orders import FlyPath, FlyTo, Sweep
from missions.units import Cell
from tests.golden.recording import PASSES, SPILL, STOPS
from tests.support.small_missions import mission_text, square
from tests.unit.uavmap.output.flown_folders import CLASS_EVENTS, CLASS_NAMES, CLASS_PLAN, CLASSES
from uavmap.load.mission_source import mission_of_text
from uavmap.output.drawing import palette
from uavmap.output.facts.figures import figures
from uavmap.output.results import map_data
from uavmap.ui.page import watching
from uavmap.ui.page.board import Board
from uavmap.ui.page.page_scene import STATES, scene_of
from uavmap.ui.page.paths_ahead import UNTIMED_S, Ahead
from uavmap.ui.page.watching import Watcher

MEMBERS = mission_text(
    square(-6.0, 12.0, 28.0, 16.0), square(-20.0, -14.0, 56.0, 62.0), vehicles=2,
    homes=[(0.0, 0.0), (16.0, 0.0)], strategy="swath",
)  # fmt: skip


def test_board_of_a_flight_is_its_map(monkeypatch):
    monkeypatch.setattr(watching, "MAX_CELLS", 7)
    setting = STOPS.setting()
    events = [from_json(line) for line in STOPS.lines()]
    state, copy = setting.initial_state(), Board()
    watcher = Watcher(state, now_s=lambda: 0.0)
    for index, event in enumerate(events):
        state, _ = step(state, event)
        watcher.apply(event, state)
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


def test_board_of_classes_has_the_cells_the_legend_and_the_areas_of_its_map():
    setting = CLASS_PLAN.known_setting()
    state, copy = setting.initial_state(), Board()
    watcher = Watcher(state, now_s=lambda: 0.0)
    for event in CLASS_EVENTS:
        state, _ = step(state, event)
        watcher.apply(event, state)
        if watcher.refresh():
            copy.apply(json.loads(json.dumps(watcher.board.since(copy.version))))
    watcher.refresh(whole=True)
    copy.apply(watcher.board.since(copy.version))
    found = map_data(*figures(setting, CLASS_EVENTS), None).class_areas
    scene = scene_of(setting)
    legend = [name for name, _ in scene["states"]]
    for one in found:
        shown = {Cell(*cell) for cell, code in copy.cells.items() if legend[code] == one.name}
        assert shown == set(one.cells)
        assert [one.name, palette.css(palette.class_colour(one.number))] in scene["states"]
    assert scene["classes"] == [one.name for one in found] == list(CLASS_NAMES)
    assert copy.field("class_areas_m2") == [one.area_m2 for one in found]
    assert "explored" not in {legend[code] for code in copy.cells.values()}


def test_board_of_a_member_has_the_cells_of_another_by_class():
    setting = setting_of(mission_of_text(MEMBERS + CLASSES, "test"), 1)
    there, beside = Cell(2, 4), Cell(3, 4)
    classes = (ClassShare(there, 2, 0.3), ClassShare(there, 4, 0.6), ClassShare(beside, 2, 0.2))
    event = FactsShared(
        2, 30.0, 0, (Fact(20.0, ((there, True), (beside, False)), classes=classes),)
    )
    watcher = Watcher(setting.initial_state(), now_s=lambda: 0.0)
    watcher.apply(event, step(setting.initial_state(), event)[0])
    watcher.refresh()
    names = [name for name, _ in scene_of(setting)["states"]]
    shown = {cell: names[code] for cell, code in watcher.board.cells.items()}
    assert shown == {there: "wet & <dry>", beside: "not region"}


def test_board_of_a_station_has_the_unsure_cells_of_a_member():
    setting = setting_of(mission_of_text(MEMBERS, "test"), 0)
    state, watcher = setting.initial_state(), Watcher(setting.initial_state(), now_s=lambda: 0.0)
    there, names = Cell(2, 4), [name for name, _ in scene_of(setting)["states"]]
    for number, (unsure, name) in enumerate(((True, "unsure: "), (False, "not region"))):
        fact = Fact(20.0 + number, ((there, unsure),), doubt=True)
        state, _ = step(state, event := FactsShared(2, 30.0, number, (fact,)))
        watcher.apply(event, state)
        watcher.refresh()
        shown = {cell: names[code] for cell, code in watcher.board.cells.items()}
        assert shown.keys() == {there}
        assert shown[there].startswith(name)


def test_figures_of_a_flight_without_stopping_agree_at_any_time():
    setting = PASSES.setting()
    state, said = setting.initial_state(), set[str]()
    watcher = Watcher(state, now_s=lambda: 0.0)
    for line in PASSES.lines():
        state, _ = step(state, event := from_json(line))
        watcher.apply(event, state)
        watcher.refresh()
        if "ROI cells decided" in (known := watcher.board.field("known")):
            assert known.startswith(f"{watcher.board.field('roi')} ")
            said.add(known)
    assert len(said) > 3


def test_scene_is_for_json():
    setting = STOPS.setting()
    scene = json.loads(json.dumps(scene_of(setting)))
    assert scene["states"][0][0] == "explored"
    assert len(scene["box"]) == len(setting.mission.search.box)
    assert scene["drift_m_s"] == [0.0, 0.0]


MAX_M = 4.0
"""Maximum distance of a copter from its path in these flights, with the position error, m."""


@pytest.mark.parametrize(
    ("recording", "kinds"), [(STOPS, {"FlyTo", "Sweep"}), (PASSES, {"FlyPath"})]
)
def test_path_ahead_is_the_path_flown(recording, kinds):
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
                assert LineString(points).distance(here) < MAX_M
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
    assert news < len(lines) / 2  # it is sent again for a new order only


def test_path_ahead_over_a_drifting_region_is_where_it_will_be():
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


def test_vehicle_not_under_our_control_has_no_path():
    setting = STOPS.setting()
    vehicle = setting.initial_state().vehicles[1]
    ahead = Ahead(setting)
    assert ahead.news(vehicle, 0.0) == []
    assert ahead.news(vehicle, 1.0) is None
    assert vehicle.phase is not Phase.AIRBORNE
