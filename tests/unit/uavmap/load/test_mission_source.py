"""A mission is parsed once, its faults have lines, and a journal returns it unchanged.

`search.prior` as the path of a GeoJSON file becomes places of the mission.
"""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

import uavmap
from missions.errors import MissionFileError, NotFlownError
from missions.mission.sections import DetectorSection, PriorPlace
from tests.support.ground.hills import over, slope
from tests.support.plans import named_text, plan_of
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import JOURNAL, FlightPlan
from uavmap.load.mission_source import load, mission_of_text, shipped_missions, with_lines
from uavmap.runner import flight
from uavmap.ui.cli import flight_options, main

TEXT = """\
name = "x"
[search]
box = [
  [1.0, 2.0],
  [3.0]
]
grid = {cell_m = 1.0}
[[vehicles]]
[[vehicles]]  # the second
url = "a"
[fence]
"margin_m" = 2
a.b = 1
"""


def not_flown(*_: object, **__: object) -> dict[str, Any]:
    raise NotFlownError("only planned", could_fly=True)


def from_python() -> None:
    with pytest.raises(NotFlownError):
        uavmap.fly("runway", sim=True, quiet=True)


@pytest.mark.parametrize(
    "work",
    [
        lambda: main(["check", "runway"]),
        lambda: main(["fly", "runway", "--sim", "--seed", "4"]),
        from_python,
    ],
)
def test_mission_is_parsed_once(work, monkeypatch, tmp_path):
    parsed: list[str] = []
    parse = tomllib.loads

    def counted(text: str) -> dict[str, Any]:
        parsed.append(text)
        return parse(text)

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(tomllib, "loads", counted)
    monkeypatch.setattr(flight_options, "fly", not_flown)
    monkeypatch.setattr(flight, "fly", not_flown)
    work()
    assert parsed == [named_text("runway").text]


@pytest.mark.parametrize(
    ("fault", "line"),
    [
        ("name = 3: must be text", 1),
        ("search.box[1]: 1 given", 3),
        ("search.grid.cell_m = 1: no", 7),
        ("vehicles[1].url = 'a': no", 10),
        ("vehicles[1]: no", 9),
        ("fence.margin_m = 2: no", 12),
        ("fence.a.b = 2: no", 13),
        ("fence: no", 11),
    ],
)
def test_fault_has_the_line_of_its_key(fault, line):
    assert with_lines(f"f.toml: {fault}", "f.toml", TEXT) == f"f.toml:{line}: {fault}"


@pytest.mark.parametrize("fault", ["f.toml: start: missing; add it", "--detector x: no"])
def test_fault_without_a_key_in_the_file_has_no_line(fault):
    assert with_lines(fault, "f.toml", TEXT) == fault


def test_long_line_of_dots_is_parsed_quickly():
    text = "a." * 500_000 + "\n[grid]\ncell_m = 0"
    assert with_lines("f: grid.cell_m = 0: no", "f", text) == "f:3: grid.cell_m = 0: no"


def test_shipped_name_beside_a_folder_of_that_name_is_loaded(tmp_path, monkeypatch):
    (tmp_path / "runway").mkdir()
    monkeypatch.chdir(tmp_path)
    assert load("runway") == mission_of_text(named_text("runway").text, "runway")


@pytest.mark.parametrize("name", shipped_missions())
def test_journal_gives_the_plan_back_as_it_was(name, tmp_path):
    plan = plan_of(name, named_text(name).text, vehicles=2, seed=5)
    assert again(plan, tmp_path) == plan


def test_prior_ground_and_detector_come_back_from_a_journal(tmp_path):
    mission = over(mission_of_text(named_text("runway").text, "runway"), slope(5.0, 0.0))
    point = PriorPlace(position=mission.start.position, spread_m=3.0)
    area = PriorPlace(polygon=mission.search.box, weight=2.0)
    search = mission.search.model_copy(update={"prior": (point, area)})
    tables = {"name": "paved", "paved": {"greenness": 0.1}, "share": 0.4}
    section = DetectorSection.model_validate(tables)
    mission = mission.model_copy(update={"search": search, "detector": section})
    plan = plan_of("hills", mission)
    found = again(plan, tmp_path)
    assert found == plan
    assert found.mission.ground == mission.ground is not None


def again(plan: FlightPlan, folder: Path) -> FlightPlan:
    """Return the plan that a journal holds."""
    with Journal.create(folder / JOURNAL, {"plan": plan.as_json()}) as journal:
        return FlightPlan.read(journal)


# --- the places of `search.prior` -----------------------------------------------------------------
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


def test_points_and_polygons_become_places_of_the_mission(tmp_path):
    point, area = loaded(tmp_path, collection(POINT, AREA))
    assert point == PriorPlace(position=(48.0004, 11.0005), weight=2.0, spread_m=15.5)
    assert area.polygon == ((48.0002, 11.0002), (48.0002, 11.0008), (48.0008, 11.0008))
    assert len(area.holes[0]) == 3


@pytest.mark.parametrize("prior", ["'prior' = 'where.geojson'", 'prior = """where.geojson"""'])
def test_path_of_a_file_is_read_in_any_spelling(tmp_path, prior):
    text = MISSION.replace('prior = "where.geojson"', prior)
    assert len(loaded(tmp_path, collection(POINT), text)) == 1


BAD = {
    "no JSON": ("{", "not JSON"),
    "a list": ("[1]", "not a FeatureCollection with features"),
    "nothing in it": (collection(), "not a FeatureCollection with features"),
    "no geometry": (collection({"type": "Feature"}), "features[0]: no feature with a geometry"),
    "a line": (collection(feature("LineString", RING)), "geometry.type = 'LineString'"),
    "swapped": (collection(feature("Point", [48.0, 111.0])), "check whether they are swapped"),
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
        "a ring needs three corners",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_fault_names_file_key_value_and_remedy(tmp_path, name):
    content, said = BAD[name]
    with pytest.raises(MissionFileError) as caught:
        loaded(tmp_path, content)
    line = str(caught.value)
    assert re.match(r".*field\.toml:\d+: search\.prior = 'where\.geojson'", line)
    assert said in line
    assert "\n" not in line


def test_missing_file_is_named(tmp_path):
    (tmp_path / "field.toml").write_text(MISSION)
    with pytest.raises(MissionFileError, match=r"'where.geojson': cannot be read \(No such file"):
        load(str(tmp_path / "field.toml"))


def test_world_of_the_simulator_lies_beside_the_mission_file(tmp_path, monkeypatch, capsys):
    text = named_text("runway").text.replace("[sim]", '[sim]\nworld = ["field.geojson"]')
    file = tmp_path / "folder" / "field.toml"
    file.parent.mkdir()
    file.write_text(text, "utf-8")
    monkeypatch.chdir(tmp_path)
    (world,) = load(str(file)).sim.world
    assert Path(world) == file.parent / "field.geojson"
    assert main(["fly", str(file), "--sim", "--out", "out"]) == 2
    assert f"{world}: No such file or directory" in capsys.readouterr().err
    assert not Path("out").exists()
