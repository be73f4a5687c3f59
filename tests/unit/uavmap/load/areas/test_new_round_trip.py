"""`uavmap export`, then `uavmap new`: the mapped region is the box of the next mission."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from missions.events import FrameSeen, Vote
from missions.flight.setting_of import setting_of
from missions.flight.state import Setting
from missions.mission.schema import Mission, positions
from missions.units import Cell
from tests.support.journals import PLAN, begun
from tests.unit.uavmap.ui.cli.commands.test_export import mission_file, text_of
from uavmap.load.mission_source import load, mission_of_text
from uavmap.output.facts.cell_outlines import outline
from uavmap.ui.cli import main

ISLAND = frozenset(Cell(i, k) for i in range(14, 18) for k in range(9, 11))
KINDS = {
    "geojson": ("out/region.geojson", ()),
    "shp": ("out/region.shp", ()),
    "csv": ("out/region.csv", ()),
    "gpkg": ("out.gpkg", ("--area", "region")),
    "kml": ("out.kml", ("--area", "region")),
    "gpx": ("out.gpx", ()),
}


def results(tmp: Path) -> tuple[Path, Setting]:
    """Return a results folder whose journal has found the island."""
    mission = mission_of_text(text_of(), "field.toml")
    plan = replace(PLAN, mission_source="field.toml", mission=mission)
    votes = tuple(Vote(cell, True, 0.9) for cell in sorted(ISLAND))
    frames = [FrameSeen(1, 1.0 + n, None, votes) for n in range(5)]
    return begun(tmp / "flown", plan, frames), setting_of(mission)


def made_of(path: Path, *options: str) -> Mission:
    mission = path.parent / "next.toml"
    arguments = ["new", str(path), "--drone", "sim", "--out", str(mission), *options]
    assert main(arguments) == 0
    return load(str(mission))


@pytest.mark.parametrize("kind", KINDS)
def test_region_is_the_box_of_the_next_mission(kind, tmp_path):
    folder, setting = results(tmp_path)
    name, options = KINDS[kind]
    out = tmp_path / name.partition("/")[0]
    assert main(["export", str(folder), "--to", kind, "--out", str(out)]) == 0
    found = made_of(tmp_path / name, *options)
    box = shapely.Polygon([setting.grid.fixed(p) for p in positions(found.search.box)])
    region = outline(ISLAND, setting.grid)
    # degrees in a mission file have seven decimals, a centimetre
    assert box.symmetric_difference(region).area < 0.01 * region.area
    if kind in ("gpkg", "kml", "gpx"):
        assert found.start.position == pytest.approx(setting.mission.start.position, abs=1e-6)
    if kind in ("gpkg", "kml"):  # which have the fence with its hole
        fence = shapely.Polygon([setting.grid.fixed(p) for p in positions(found.fence.polygon)])
        drawn = shapely.Polygon(setting.fence.outer.exterior)
        assert fence.symmetric_difference(drawn).area < 0.001 * drawn.area
        assert len(found.fence.holes) == 1


@pytest.mark.parametrize("kind", ["plan", "waypoints"])
def test_plan_of_a_search_is_a_mission_over_the_same_ground(kind, tmp_path):
    file, setting = mission_file(tmp_path)
    plan = tmp_path / f"search.{kind}"
    options = ["--plan", str(tmp_path / "search.plan")]
    if kind == "waypoints":
        options += ["--waypoints", str(plan)]
    assert main(["export", str(file), *options]) == 0
    found = made_of(plan)
    before = setting.mission
    assert found.start.position == pytest.approx(before.start.position, abs=1e-7)
    if kind == "plan":
        fences = (sorted(mission.fence.polygon) for mission in (found, before))
        assert np.allclose(*fences, atol=1e-7)
        assert len(found.fence.holes) == len(before.fence.holes) == 1
    box = shapely.Polygon([setting.grid.fixed(p) for p in positions(found.search.box)])
    drawn = shapely.Polygon([setting.grid.fixed(p) for p in positions(before.search.box)])
    assert drawn.buffer(0.5).covers(box)  # its lanes, less the width that each shows beside itself
    assert box.area > 0.6 * drawn.area
