"""When paths have had their time, the region is explored by hovering over cells, to its end."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from missions.flight.setting_of import setting_of
from missions.flight.state import State
from missions.flight.strategy import fallback
from missions.flight.strategy import sweep_paths as passes
from missions.mapping.tree import Tree
from missions.units import Cell
from tests.support.plans import named_text, plan_of
from uavmap.journal.flight_plan import SIM_EPOCH_UTC_S, FlightPlan
from uavmap.load.mission_source import load
from uavmap.runner.flight import fly

MISSION = str(Path(__file__).parents[3] / "golden" / "mission.toml")


def plan(folder: Path) -> FlightPlan:
    source = named_text(MISSION)
    return plan_of(source.source, source.text, "swath", 1, 3, (), None, SIM_EPOCH_UTC_S)


def test_mission_that_falls_back_maps_the_whole_region(tmp_path, monkeypatch):
    fallen: list[float] = []

    def recorded_fall_back(state: State) -> State:
        fallen.append(state.t_s)
        return fallback.fall_back(state)

    monkeypatch.setattr(passes, "patience_s", lambda state: 0.5)
    monkeypatch.setattr(passes, "fall_back", recorded_fall_back)
    summary = fly(plan(tmp_path), tmp_path)
    assert fallen
    assert summary["completed"]
    assert summary["cells_missed"] == 0
    assert summary["fence_breaches"] == summary["reserve_violations"] == 0
    assert summary["bound_held"]


def test_fallback_is_not_used_where_frames_decide(tmp_path, monkeypatch):
    def never(state: State) -> State:
        raise AssertionError(f"at {state.t_s} s")

    monkeypatch.setattr(passes, "fall_back", never)
    summary = fly(plan(tmp_path), tmp_path)
    assert summary["completed"]
    assert summary["exploration_s"] < 0.5 * summary["bound_makespan_s"]


def test_patience_grows_with_the_known_region():
    setting = setting_of(load(MISSION))
    state = setting.initial_state()
    assert fallback.patience_s(state) == fallback.MIN_PATIENCE_S
    root = Cell(0, 0)
    tree = Tree.rooted(root)
    for east in range(200):
        tree = tree.with_observation(Cell(east, 0), [Cell(east + 1, 0)])
    known = replace(state, tree=tree)
    bound_s = fallback.bound_s(setting, 201, 200)
    assert fallback.patience_s(known) == bound_s > fallback.MIN_PATIENCE_S
    assert fallback.whole_bound_s(setting, 201, 200) > 2.0 * bound_s
