"""Ground that nobody judged is in every map, and in none where all of it was."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace

from missions.units import GridPoint
from uavmap.output.drawing.map_scene import map_scene
from uavmap.output.drawing.sheet import draw_sheet
from uavmap.output.facts.map_model import MapData
from uavmap.output.formats import geojson_encoder as geojson
from uavmap.output.formats import kml_encoder as kml


def with_a_gap(full: MapData) -> MapData:
    lane = (
        full.grid.position(GridPoint(0.0, 4.0)),
        full.grid.position(GridPoint(20.0, 4.0)),
    )
    return replace(full, unsearched=(lane,))


def test_geojson_has_a_line_for_each_stretch(make_map: Callable[..., MapData]) -> None:
    full = make_map()
    kinds = [f["properties"]["kind"] for f in json.loads(geojson.encode_map(full))["features"]]
    assert "unsearched" not in kinds
    gap = with_a_gap(full)
    (line,) = (
        f for f in json.loads(geojson.encode_map(gap))["features"] if f["id"] == "unsearched 1"
    )
    assert line["geometry"]["type"] == "LineString"
    (start, _), place = gap.unsearched[0], line["geometry"]["coordinates"][0]
    assert place == [round(start.lon_deg, 7), round(start.lat_deg, 7)]


def test_kml_has_a_folder_of_them(make_map: Callable[..., MapData]) -> None:
    full = make_map()
    assert b"Not searched" not in kml.encode_map(full)
    assert kml.encode_map(with_a_gap(full)).count(b"without a judged frame") == 1


def test_the_picture_shows_them(make_map: Callable[..., MapData]) -> None:
    full = make_map()
    texts = [entry.text for entry in map_scene(with_a_gap(full)).legend]
    assert "search lane without a judged frame" in texts
    assert draw_sheet(map_scene(full)) != draw_sheet(map_scene(with_a_gap(full)))
