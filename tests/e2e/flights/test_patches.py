"""Several patches of a region in one box: the search continues until all of it is seen."""

from __future__ import annotations

import json
import re
from itertools import pairwise
from pathlib import Path

import pytest

from missions.events import FrameSeen, Tracked, from_json
from missions.flight.setting_of import setting_of
from missions.flight.step import step
from tests.e2e import rig
from uavmap.load.mission_source import load
from uavmap.output.facts.figures import figures
from uavmap.output.results import map_data
from uavmap.ui.page.page_scene import STATES
from uavmap.ui.page.watching import Watcher

SECOND = """
[[sim.roi]]
polygon = [
    [48.0006600, 9.0003000],
    [48.0006600, 9.0003600],
    [48.0007000, 9.0003600],
    [48.0007000, 9.0003000],
]
"""


def mission_with_two_patches() -> str:
    text = Path(rig.mission("windy")).read_text(encoding="utf-8")
    text = text.replace('strategy = "survey"', 'strategy = "swath"')
    return text.replace("48.0010072", "48.0007500") + SECOND


def test_patches_are_all_mapped_if_all_are_requested(tmp_path):
    text = mission_with_two_patches().replace("[search]", '[search]\nfind = "all"')
    summary = rig.flown_text(text, tmp_path).complete()
    found = summary["patches"]
    assert [patch["cells"] for patch in found] == sorted(
        (patch["cells"] for patch in found), reverse=True
    )
    assert len(found) == 2
    assert sum(patch["cells"] for patch in found) == summary["cells_roi"]
    assert found[0]["lat_deg"] == pytest.approx(48.00050, abs=4e-5)
    assert summary["false_positives"] == 0
    in_all = summary["patches_in_all"]
    for patch in (*found, in_all):
        assert patch["complete"]
        assert patch["open"] == {}
        assert 0.0 < patch["found_s"] < patch["decided_s"] < summary["makespan_s"]
        assert patch["took_s"] == pytest.approx(patch["decided_s"] - patch["found_s"], abs=0.11)
        assert 0.0 <= patch["lower_bound_s"] <= patch["took_s"]
    assert all(0.0 < patch["root"]["seen_s"] <= patch["found_s"] for patch in found)
    assert in_all["decided_s"] == max(patch["decided_s"] for patch in found)
    assert in_all["box"]["no_frames"] == in_all["box"]["beyond_fence"] == 0
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert f'all</td><td data-head="m²">{in_all["area_m2"]:,.0f}</td>' in page
    features = json.loads((tmp_path / "out" / "map.geojson").read_text())["features"]
    states = [feature["properties"].get("state") for feature in features]
    assert states.count("explored") == summary["cells_roi"]
    assert "2 patches of the region" in summary["finding"]
    assert "the whole box is seen" in summary["finding"]


def test_box_is_searched_from_high_up_and_mapped_from_below(tmp_path):
    text = mission_with_two_patches()
    high = '[search]\nfind = "all"\naltitude_m = 30.0'
    text = text.replace("[search]", high).replace("[[vehicles]]", "[[vehicles]]\n[[vehicles]]")
    summary = rig.flown_text(text, tmp_path).complete()
    file = tmp_path / "field.toml"
    assert "layers for the search of the box:\n    30 m:" in rig.uavmap("check", file).out
    assert len(summary["patches"]) == 2
    assert summary["false_positives"] == 0
    assert summary["min_separation_m"] > 3.0
    events = list(map(from_json, rig.bodies(tmp_path / "out")))
    heights = [event.height_m for event in events if isinstance(event, Tracked)]
    assert 29.0 < max(heights) < 38.0
    overviews = [e.overview for e in events if isinstance(e, FrameSeen)]
    assert overviews.count(True) > 10
    assert overviews.count(None) > 10
    setting = setting_of(load(str(file)))
    state = setting.initial_state()
    watcher = Watcher(state, now_s=lambda: 0.0)
    for event in events:  # the live page and the map agree
        state, _ = step(state, event)
        watcher.apply(event, state)
    watcher.refresh(whole=True)
    shown = {cell: STATES[code] for cell, code in watcher.board.cells.items()}
    table = map_data(state, figures(setting, events)[1], None).cells
    assert shown == {tuple(cell): state for cell, state, *_ in table.values()}


def test_vehicles_climb_on_paths_to_drifting_lanes_and_share_layers(tmp_path):
    text = mission_with_two_patches()
    high = '[search]\nfind = "all"\naltitude_m = 30.0\nlayer_m = 0'
    text = text.replace("[search]", high)
    text = text.replace("[flight]", "[flight]\nclimb_m_s = 4.0\ndescent_m_s = 3.0")
    text = text.replace("[[vehicles]]", "[[vehicles]]\nlayer = 0\n[[vehicles]]\nlayer = 0")
    text = re.sub(r"(?m)^interval_s = .*$", "interval_s = 0.4", text)
    text += "\n[drift]\nspeed_m_s = 0.1\ntoward_deg = 90.0\n"
    summary = rig.flown_text(text, tmp_path).complete(1)
    assert len(summary["patches"]) == 2
    assert summary["patches_in_all"]["complete"]
    assert summary["min_separation_m"] > 3.0
    events = map(from_json, rig.bodies(tmp_path / "out"))
    told = [event for event in events if isinstance(event, Tracked)]
    for number in (1, 2):
        heights = [(e.t_s, e.height_m) for e in told if e.vehicle == number]
        assert 29.0 < max(height_m for _, height_m in heights) < 31.5
        rises = [(b - a) / (t - s) for (s, a), (t, b) in pairwise(heights) if t > s]
        assert 2.0 < max(rises) < 5.0  # m/s
