"""A flight whose detector distinguishes classes: every file of its results names them."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from pathlib import Path

import fastkml
import pyogrio
import pytest

from tests.unit.uavmap.output.flown_folders import (
    CLASS_EVENTS,
    CLASS_NAMES,
    CLASS_PLAN,
    folder_of,
)
from uavmap.output.drawing.map_scene import map_scene
from uavmap.output.drawing.palette import class_colour
from uavmap.output.facts.flown_mission import FlownMission
from uavmap.output.results import flown_of
from uavmap.ui.cli import main


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return folder_of(tmp_path_factory.mktemp("classes"), CLASS_EVENTS, CLASS_PLAN)


@pytest.fixture(scope="module")
def flown(folder: Path) -> FlownMission:
    return flown_of(folder)


@pytest.fixture
def export(folder: Path, tmp_path: Path) -> Callable[[str], Path]:
    def exported(kind: str) -> Path:
        out = tmp_path / f"map.{kind}"
        assert main(["export", str(folder), "--to", kind, "--out", str(out)]) == 0
        return out

    return exported


def test_cells_of_the_region_are_of_the_class_that_frames_saw_most_of(flown: FlownMission) -> None:
    rest, wet = flown.data.class_areas
    assert (rest.name, wet.name) == CLASS_NAMES
    assert {cell.east % 2 for cell in rest.cells} == {1}
    assert {cell.east % 2 for cell in wet.cells} == {0}
    assert {*rest.cells, *wet.cells} == set(flown.data.roi_cells)
    told = flown.values["classes"]
    assert [one["cells"] for one in told] == [len(rest.cells), len(wet.cells)]
    assert "volume_l" not in told[0]
    assert flown.values["volume_l"] == told[1]["volume_l"]


def test_legend_and_report_have_each_class(flown: FlownMission, folder: Path) -> None:
    legend = {entry.text: entry.sample for entry in map_scene(flown.data).legend}
    for one in flown.data.class_areas:
        assert legend[f"{one.name} ({len(one.cells)})"] == class_colour(one.number)
    assert not any(text.startswith("explored") for text in legend)
    assert main(["report", str(folder)]) == 0
    page = (folder / "report.html").read_text("utf-8")
    assert '<td data-head="Name">wet &amp; &lt;dry&gt;</td>' in page
    assert "<dry>" not in page


def test_geojson_has_a_feature_for_each_class(
    export: Callable[[str], Path], flown: FlownMission
) -> None:
    found = json.loads((export("geojson") / "classes.geojson").read_text("utf-8"))["features"]
    assert [one["properties"]["name"] for one in found] == list(CLASS_NAMES)
    areas = [one["properties"]["area_m2"] for one in found]
    assert areas == [one.area_m2 for one in flown.data.class_areas]


def test_geopackage_has_a_layer_and_a_column(
    export: Callable[[str], Path], flown: FlownMission
) -> None:
    path = export("gpkg")
    assert "classes" in dict(pyogrio.list_layers(path).tolist())
    fields = pyogrio.read_info(path, layer="cells")["fields"]
    assert "class" in fields
    assert pyogrio.read_info(path, layer="classes")["features"] == 2


def test_kml_has_a_folder_of_classes(export: Callable[[str], Path], folder: Path) -> None:
    text = export("kml").read_text("utf-8")
    fastkml.KML.from_string(text.partition("?>")[2])
    assert "<name>Classes</name>" in text
    assert "<name>wet &amp; &lt;dry&gt;</name>" in text
    assert '<Style id="class-4">' in text


def test_table_of_cells_has_their_class(export: Callable[[str], Path], flown: FlownMission) -> None:
    rows = list(csv.DictReader(io.StringIO((export("csv") / "cells.csv").read_text("utf-8"))))
    counts = [sum(row["class"] == name for row in rows) for name in CLASS_NAMES]
    assert counts == [len(one.cells) for one in flown.data.class_areas]
