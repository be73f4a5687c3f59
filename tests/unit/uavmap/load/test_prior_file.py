"""`search.prior` as the path of a GeoJSON file: it is written into the text of the mission."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from missions.errors import MissionFileError
from missions.mission.sections.search_sections import PriorPlace
from uavmap.load.mission_source import load

RING = [[11.0002, 48.0002], [11.0008, 48.0002], [11.0008, 48.0008], [11.0002, 48.0002]]
HOLE = [[11.0006, 48.0003], [11.0007, 48.0003], [11.0007, 48.0004], [11.0006, 48.0003]]
MISSION = """
name = "prior"   # a word that is not the key
start.position = [48.0, 11.0]
fence.polygon = [[47.999, 10.999], [47.999, 11.002], [48.002, 11.002], [48.002, 10.999]]
# prior = "not this one"
[search]
prior = "where.geojson"                 # but this
box = [[48.0, 11.0], [48.0, 11.001], [48.001, 11.001], [48.001, 11.0]]
"""


def feature(kind: str, coordinates: object, **properties: object) -> dict[str, object]:
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def collection(*features: object) -> str:
    return json.dumps({"type": "FeatureCollection", "features": list(features)})


def loaded(folder: Path, content: str, mission: str = MISSION) -> tuple[PriorPlace, ...]:
    (folder / "where.geojson").write_text(content, encoding="utf-8")
    (folder / "field.toml").write_text(mission, encoding="utf-8")
    return load(str(folder / "field.toml")).search.prior


POINT = feature("Point", [11.0005, 48.0004, 530.0], weight=2, spread_m=15.5)
AREA = feature("Polygon", [RING, HOLE])


def test_points_and_polygons_become_places_of_the_mission(tmp_path: Path) -> None:
    point, area = loaded(tmp_path, collection(POINT, AREA))
    assert point == PriorPlace(position=(48.0004, 11.0005), weight=2.0, spread_m=15.5)
    assert area.polygon == ((48.0002, 11.0002), (48.0002, 11.0008), (48.0008, 11.0008))
    assert len(area.holes[0]) == 3


@pytest.mark.parametrize("prior", ["'prior' = 'where.geojson'", 'prior = """where.geojson"""'])
def test_a_path_is_read_however_it_is_written(tmp_path: Path, prior: str) -> None:
    text = MISSION.replace('prior = "where.geojson"', prior)
    assert len(loaded(tmp_path, collection(POINT), text)) == 1


BAD = {
    "no JSON": ("{", "not JSON"),
    "a list": ("[1]", "no FeatureCollection with features"),
    "nothing in it": (collection(), "no FeatureCollection with features"),
    "no geometry": (collection({"type": "Feature"}), "features[0]: no feature with a geometry"),
    "a line": (collection(feature("LineString", RING)), "geometry.type = 'LineString'"),
    "swapped": (collection(feature("Point", [48.0, 111.0])), "are they swapped, or in metres?"),
    "text for a number": (collection(feature("Point", ["a", 48.0])), "coordinates = 'a'"),
    "a weight of none": (collection(feature("Point", [11.0, 48.0], weight=0)), "weight = 0"),
    "a weight that is text": (
        collection(POINT, feature("Point", [11.0, 48.0], weight="much")),
        "features[1]: properties.weight = 'much': give a number",
    ),
    "an endless spread": (
        collection(POINT).replace("15.5", "1" + 400 * "0"),
        "properties.spread_m = '1000000000",
    ),
    "a ring that is open": (
        collection(feature("Polygon", [RING[:3]])),
        "a ring needs three vertices",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_a_fault_names_file_key_value_and_remedy(tmp_path: Path, name: str) -> None:
    content, said = BAD[name]
    with pytest.raises(MissionFileError) as caught:
        loaded(tmp_path, content)
    line = str(caught.value)
    assert re.match(r".*field\.toml:\d+: search\.prior = 'where\.geojson'", line)
    assert said in line
    assert "\n" not in line


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    (tmp_path / "field.toml").write_text(MISSION)
    with pytest.raises(MissionFileError, match=r"'where.geojson': cannot be read \(No such file"):
        load(str(tmp_path / "field.toml"))
