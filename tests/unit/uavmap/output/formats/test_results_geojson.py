"""map.geojson, read back with json and shapely."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import shapely
from pyproj import Geod
from shapely.geometry import MultiPolygon, shape

from missions.units import Cell
from uavmap.output.facts.map_model import MapData
from uavmap.output.formats import geojson_encoder as geojson

MapMaker = Callable[..., MapData]

GEOD = Geod(ellps="WGS84")


def read(data: MapData) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(geojson.encode_map(data))
    return found


def of_kind(found: dict[str, Any], kind: str) -> list[dict[str, Any]]:
    return [f for f in found["features"] if f["properties"]["kind"] == kind]


def test_every_geometry_is_valid(make_map: MapMaker) -> None:
    found = read(make_map())
    assert found["type"] == "FeatureCollection"
    assert len(found["features"]) == len(make_map().cells) + 2
    for feature in found["features"]:
        assert feature["type"] == "Feature"
        assert shape(feature["geometry"]).is_valid


def test_longitude_comes_first(make_map: MapMaker) -> None:
    for feature in read(make_map())["features"]:
        west, south, east, north = shape(feature["geometry"]).bounds
        assert west == pytest.approx(9.53, abs=0.001)
        assert east == pytest.approx(9.53, abs=0.001)
        assert south == pytest.approx(47.6, abs=0.001)
        assert north == pytest.approx(47.6, abs=0.001)


def test_the_outline_is_the_union_with_its_hole(make_map: MapMaker) -> None:
    (outline,) = of_kind(read(make_map()), "outline")
    region = shape(outline["geometry"])
    assert isinstance(region, MultiPolygon)
    assert sorted(len(part.interiors) for part in region.geoms) == [0, 1]
    cells = 24
    assert outline["properties"]["area_m2"] == cells * 16.0
    area_m2, _ = GEOD.geometry_area_perimeter(region)
    assert area_m2 == pytest.approx(cells * 16.0, rel=1e-3)


def test_a_cell_carries_its_votes(make_map: MapMaker) -> None:
    (loner,) = [f for f in of_kind(read(make_map()), "cell") if f["id"] == "cell 5 5"]
    assert loner["properties"] == {
        "kind": "cell",
        "column": 5,
        "row": 5,
        "state": "unexplored",
        "positive": 4,
        "votes": 5,
    }


def test_a_cell_lies_where_the_grid_says(make_map: MapMaker) -> None:
    data = make_map()
    (cell,) = [f for f in read(data)["features"] if f["id"] == "cell 3 1"]
    centre = shape(cell["geometry"]).centroid
    place = data.grid.centre(Cell(3, 1), data.t_s)
    assert (centre.x, centre.y) == pytest.approx((place.lon_deg, place.lat_deg), abs=1e-7)


def test_a_drifting_map_is_drawn_where_the_region_is(make_map: MapMaker) -> None:
    still, drifting = (read(make_map(drift_m_s=v))["features"][0] for v in (0.0, 0.4))
    a, b = (shape(f["geometry"]).centroid for f in (still, drifting))
    bearing_deg, _, distance_m = GEOD.inv(a.x, a.y, b.x, b.y)
    assert distance_m == pytest.approx(40.0, abs=0.05)
    assert bearing_deg == pytest.approx(90.0, abs=0.1)


def test_tracks_have_heights_and_times(make_map: MapMaker) -> None:
    found = read(make_map())
    (track,) = of_kind(found, "track")
    assert found["bbox"][2::3] == [12.0, 16.0]
    assert [place[2] for place in track["geometry"]["coordinates"]] == [12, 13, 14, 15, 16]
    assert track["properties"]["start_s"] == 0.0
    assert track["properties"]["end_s"] == 100.0


def test_numbers_have_seven_decimals_at_most(make_map: MapMaker) -> None:
    for feature in read(make_map())["features"]:
        for lon, *_ in shapely.get_coordinates(shape(feature["geometry"])).tolist():
            assert lon == round(lon, 7)


def test_a_map_of_nothing(empty_map: MapData) -> None:
    found = read(empty_map)
    (outline,) = found["features"]
    assert outline["geometry"] is None
    assert outline["properties"]["area_m2"] == 0
    assert "bbox" not in found


def test_written_whole(tmp_path: Path, make_map: MapMaker) -> None:
    path = tmp_path / "map.geojson"
    path.write_text("old")
    geojson.write(make_map(), path)
    assert path.read_text() == geojson.encode_map(make_map())
    assert [p.name for p in tmp_path.iterdir()] == ["map.geojson"]


def test_a_map_has_its_date_where_anybody_knows_it(make_map: MapMaker) -> None:
    """A region that drifts is somewhere else by now."""
    date = "2024-05-01T10:11:12.000Z"
    found = json.loads(geojson.encode_map(make_map(), date))
    (outline,) = (f for f in found["features"] if f["properties"]["kind"] == "outline")
    assert found["utc"] == outline["properties"]["utc"] == date
    assert "utc" not in geojson.encode_map(make_map())
