"""summary.json, and files that are whole or absent."""

import json
import math
import os
import stat
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from missions.geo.grid import Grid
from missions.units import Cell, LatLon
from uavmap.base import atomic_write as atomic
from uavmap.output import summary
from uavmap.output.facts.cell_outlines import outline

GRID = Grid.at(LatLon(48.0, 11.0), cell_m=4.0)


def test_figures_keep_their_order_and_nan_is_null(tmp_path):
    path = tmp_path / "summary.json"
    summary.write({"mission": "runway", "iou": math.nan, "b": [math.inf, 1.5], "a": None}, path)
    text = path.read_text()
    assert text.startswith('{\n  "mission": "runway",\n')
    assert text.endswith("}\n")
    expected = [("mission", "runway"), ("iou", None), ("b", [None, 1.5]), ("a", None)]
    assert list(json.loads(text).items()) == expected
    assert json.loads(summary.encode({"c": {"d": -math.inf}})) == {"c": {"d": None}}


def test_value_that_json_cannot_hold_is_an_error(tmp_path):
    with pytest.raises(TypeError):
        summary.write({"a": object()}, tmp_path / "summary.json")
    assert not list(tmp_path.iterdir())


def test_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "file"
    path.write_text("old")

    def full(handle):
        raise OSError("disk full")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="disk full"):
        atomic.write_text(path, "new")
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_results_have_the_permissions_of_ordinary_files(tmp_path):
    path, ordinary = tmp_path / "file", tmp_path / "ordinary"
    ordinary.write_text("")
    atomic.write_text(path, "new")
    assert stat.S_IMODE(path.stat().st_mode) == stat.S_IMODE(ordinary.stat().st_mode)


@given(st.sets(st.builds(Cell, st.integers(-6, 6), st.integers(-6, 6))))
def test_outline_has_the_area_of_its_cells_and_only_corners(cells):
    shape = outline(cells, GRID)
    assert shape.is_valid
    assert shape.area == len(cells) * 16.0
    for part in getattr(shape, "geoms", [] if shape.is_empty else [shape]):
        assert part.exterior.is_ccw
        assert not any(hole.is_ccw for hole in part.interiors)
        for ring in (part.exterior, *part.interiors):
            points = list(ring.coords)
            edges = list(pairwise(points))
            sideways = [a[1] == b[1] for a, b in edges]
            assert all(a != b for a, b in pairwise(sideways))
