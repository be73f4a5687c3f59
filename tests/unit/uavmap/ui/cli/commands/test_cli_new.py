"""`uavmap new` and `uavmap check --map` as a user runs them, in process."""

import io
import json
import re
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from missions.mission.messages import section_of
from missions.mission.schema import Mission, VehicleSection
from missions.mission.sections import LATER
from missions.mission.sim_section import Sim
from tests.support.areas.area_files import (
    FIELD,
    KINDS,
    collection,
    feature,
    kml,
    kml_polygon,
    placemark,
    saved,
)
from tests.support.page.html_page import Page
from tests.support.plans import named_text
from uavmap.aircraft.imaging.classifier import detector_of
from uavmap.load.areas.key_comments import COMMENTS, SECTIONS
from uavmap.load.mission_source import load
from uavmap.output.drawing.palette import FENCE
from uavmap.ui.cli import main
from vision.detectors import FINDS, detector_names, detector_parameters, threshold

SVG = "http://www.w3.org/2000/svg"
"""The name of a language, and nothing to load."""


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def field(tmp_path):
    return KINDS["google_earth_pro"](tmp_path).name


class Terminal(io.StringIO):
    def isatty(self):
        return True


def new(*arguments):
    assert main(["new", *map(str, arguments)]) == 0


# --- what is written --------------------------------------------------------------------------
def test_kml_becomes_a_mission_that_check_takes(field, capsys):
    new(field, "--drone", "x500", "--detector", "threshold", "--out", "field.toml")
    out, err = capsys.readouterr()
    assert "Untitled Polygon, 105 m x 114 m" in out
    assert "52.45593 N 13.30378 E, UTM zone 33N (EPSG:32633); check the place" in out
    assert "https://www.openstreetmap.org/?mlat=52.45593&mlon=13.30378#map=17" in out
    assert "region = darker than 150 of 255 (fits the simulator; for real ground" in out
    assert "no home was drawn" in err
    with Image.open("field.png") as picture:
        assert picture.size[0] > 800
    assert main(["check", "field.toml"]) == 0
    output = capsys.readouterr().out
    assert "no fault" in output
    assert "region = darker than 150 of 255" in output
    mission = load("field.toml")
    assert (mission.name, mission.battery.capacity_wh, mission.wind.speed_m_s) == ("field", 74, 5)


def keys(model, prefix=""):
    found = set()
    for key, field in model.model_fields.items():
        inner = section_of(field.annotation)
        if inner is not None and not prefix and key != "vehicles":
            found |= keys(inner, f"{key}.")
        elif key != "vehicles":
            found.add(f"{prefix}{key}")
    return found


def test_every_key_of_a_mission_has_a_comment_and_every_comment_a_key():
    known = keys(Mission) | {f"vehicles.{key}" for key in VehicleSection.model_fields}
    assert set(COMMENTS) == known - {"detector.tables"}
    tables = {k for k, f in Mission.model_fields.items() if section_of(f.annotation) is not None}
    assert set(SECTIONS) == tables - {"vehicles"}


def test_defaults_are_written_into_the_mission(field):
    new(field, "--drone", "sim", "--out", "field.toml")
    text = Path("field.toml").read_text("utf-8")
    shown = tomllib.loads(text)
    assert shown["team"] == {"separation_m": 4.0, "layer_m": 6.0}
    assert shown["drift"] == {"speed_m_s": 0.0, "toward_deg": 0.0}
    assert {k for k in Sim.model_fields if k not in shown["sim"]} == {
        "terrain", "quirks", "parameters", "faults", "tag_m", "tag_dictionary", "world",
        "traffic",
    }  # fmt: skip
    for words in ("capacity_wh = 60.0", "Wh, above 0", "degrees, above 1, below 170"):
        assert words in text
    assert "amsl_m" not in shown["start"]  # its default depends on the place


def test_options_override_the_table_of_drones(field):
    new(
        field, "--drone", "solo", "--camera", "rpi-hq-6mm", "--battery", 90, "--pixels", "1280x720",
        "--wind", 7, "--vehicles", 2, "--cell", 5, "--height", 40, "--name", "two", "--strategy",
        "rdfs", "--mounting", "gimbal", "--out", "a.toml", "--preview", "a.html",
    )  # fmt: skip
    mission = load("a.toml")
    assert (mission.battery.capacity_wh, mission.battery.hover_power_w) == (90.0, 231.0)
    assert (mission.camera.width_px, mission.camera.height_px) == (1280, 720)
    assert (mission.camera.hfov_deg, mission.camera.mounting) == (55.3, "gimbal")
    assert (mission.wind.speed_m_s, len(mission.vehicles), mission.grid.cell_m) == (7.0, 2, 5.0)
    assert (mission.flight.altitude_m, mission.name, mission.strategy) == (40.0, "two", "rdfs")
    assert Path("a.html").exists()
    assert not Path("a.png").exists()


def test_rectangle_by_its_middle_is_laid_out_south_of_the_equator():
    new("--at", "-33.8,151.2", "--size", "200x150", "--drone", "sim", "--home", "-33.8,151.2")
    mission = load("area.toml")
    assert mission.start.position == (-33.8, 151.2)
    lats = [lat for lat, _ in mission.search.box]
    assert (max(lats) - min(lats)) * 110_900 == pytest.approx(150, abs=6)


def test_areas_of_a_file_are_taken_together_or_by_name(tmp_path):
    east = [(x + 0.003, y) for x, y in FIELD]
    saved(tmp_path, "two.geojson", collection(feature(name="A"), feature(east, name="B")))
    new("two.geojson", "--together", "--drone", "sim", "--out", "both.toml")
    new("two.geojson", "--area", "b", "--drone", "sim", "--out", "b.toml")
    both, only = (load(name).search.box for name in ("both.toml", "b.toml"))
    assert min(lon for _, lon in both) < min(lon for _, lon in only)


def test_table_of_drones_is_listed(capsys):
    new("--drone", "list")
    out = capsys.readouterr().out
    assert "x500" in out
    assert "sony-a6000-16mm" in out


# --- asking -----------------------------------------------------------------------------------
def test_missing_options_are_asked_at_a_terminal(monkeypatch, capsys):
    monkeypatch.setattr(sys, "stdin", Terminal("52.4565, 13.30375\n120x80\nsim\npaved\n"))
    new()
    err = capsys.readouterr().err
    assert "area (a file, or LAT,LON of its centre):" in err
    assert "drone:" in err
    for name, text in FINDS.items():
        assert re.search(rf"\d  {name} +{re.escape(text)}", err)
    assert "later" in err
    assert "detector (number, name, or a folder made by `uavmap tune`):" in err
    mission = load("area.toml")
    assert mission.battery.capacity_wh == 60.0
    assert detector_of(mission) == threshold.PavedDetector()


def test_new_answer_is_no_detector_lists_the_detectors(field, tmp_path, monkeypatch, capsys):
    for answer, expected in (("grass", "grass cannot be read"), ("4", "samples is missing")):
        monkeypatch.setattr(sys, "stdin", Terminal(f"{answer}\n"))
        assert main(["new", field, "--drone", "sim"]) == 2
        assert expected in capsys.readouterr().err
    assert len(list(tmp_path.iterdir())) == 1


def test_choice_of_an_area_is_asked_at_a_terminal(tmp_path, monkeypatch, capsys):
    saved(tmp_path, "two.geojson", collection(feature(name="A"), feature(name="B")))
    monkeypatch.setattr(sys, "stdin", Terminal("two.geojson\n2\nlater\n"))
    new("--drone", "sim")
    assert "  2  B" in capsys.readouterr().err
    assert "B, 105 m" not in Path("two.toml").read_text("utf-8")
    assert "somewhere in 'B' (two.geojson)" in Path("two.toml").read_text("utf-8")


def test_terminal_without_an_answer_is_an_error(monkeypatch, capsys):
    monkeypatch.setattr(sys, "stdin", Terminal(""))
    assert main(["new"]) == 2
    assert "no answer" in capsys.readouterr().err


# --- what to look for -------------------------------------------------------------------------
def test_new_without_a_terminal_names_no_detector_and_only_the_simulator_flies_it(
    field, capsys, refused
):
    new(field, "--drone", "sim", "--out", "a.toml")
    told = capsys.readouterr().out
    assert "region = not chosen yet; the simulator takes threshold: darker than 150" in told
    assert "next: uavmap fly a.toml --sim" in told
    assert load("a.toml").detector.name == LATER
    assert detector_of(load("a.toml")) == threshold.ThresholdDetector()
    reason = 'a.toml: detector.name = "later": no detector is chosen'
    for command in (
        ["check", "a.toml"],
        ["doctor", "a.toml"],
        ["fly", "a.toml", "--connect", "udpin://127.0.0.1:14999", "--yes"],
        ["replay", "somewhere", "--mission", "a.toml"],
        ["look", "some.jpg", "--mission", "a.toml"],
    ):
        line = refused(*command)
        assert reason in line
        assert "set one of threshold, paved, adaptive" in line
    assert not Path("results").exists()


@pytest.mark.parametrize(
    ("name", "made"),
    [
        ("threshold", threshold.ThresholdDetector()),
        ("paved", threshold.PavedDetector()),
        ("adaptive", threshold.AdaptiveDetector()),
        ("index", threshold.IndexDetector()),
    ],
)
def test_new_detector_by_name_has_its_parameters_in_the_mission(field, name, made):
    new(field, "--drone", "sim", "--detector", name, "--out", "a.toml")
    mission = load("a.toml")
    assert detector_of(mission) == made
    assert main(["check", "a.toml"]) == 0
    section = tomllib.loads(Path("a.toml").read_text("utf-8"))["detector"]
    keys = section if name == "threshold" else section[name]
    assert set(detector_parameters(name)) <= set(keys)


def test_detector_by_name_judges_in_place_of_the_missions(field):
    new(field, "--drone", "sim", "--out", "a.toml")
    assert detector_of(load("a.toml", "paved")) == threshold.PavedDetector()


def test_each_detector_has_an_explanation():
    assert set(FINDS) == set(detector_names())


# --- what is refused --------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["field.kml"], "no drone; give --drone NAME"),
        (["field.kml", "--hover", "300", "--camera", "rpi-v2"], "or --battery WH"),
        (["field.kml", "--drone", "x50"], "did you mean 'x500'?"),
        (["field.kml", "--drone", "dji-m300"], "accept no orders over MAVLink"),
        (["field.kml", "--drone", "sim", "--camera", "rpi"], "--camera rpi: not in the table"),
        (["field.kml", "--drone", "sim", "--pixels", "640"], "--pixels 640 is not WxH"),
        (["fields.kml", "--drone", "sim"], "did you mean 'field.kml'?"),
        (["field.kml", "--at", "1,2", "--drone", "sim"], "give one of them"),
        (["field.kml", "--size", "1x2", "--drone", "sim"], "needs --at"),
        (["--at", "52,13.3", "--size", "1x2", "--drone", "sim"], "each side from 4"),
        (["--at", "95,13.3", "--drone", "sim"], "latitude is from -90 to 90"),
        (["--at", "north", "--drone", "sim"], "is not LAT,LON"),
        (["field.kml", "--drone", "sim", "--home", "52.5,13.303"], "4.8 km from the area"),
        (["field.kml", "--drone", "sim", "--home", "13.303,52.456"], "longitude are swapped"),
        (["field.kml", "--drone", "sim", "--out", "field.kml"], "must end with .toml"),
        (["field.kml", "--drone", "sim", "--preview", "a.jpg"], "must end with .html or .png"),
        (["field.kml", "--drone", "sim", "--out", "no/a.toml"], "there is no folder no"),
        (["field.kml", "--drone", "sim", "--area", "x"], "there are 'Field'"),
        (["field.kml", "--drone", "sim", "--crs", "25833"], "leave --crs out"),
        (["--drone", "sim"], "no area; give a file, or --at LAT,LON"),
        (["field.kml", "--drone", "sim", "--detector", "grass"], "grass cannot be read"),
        (["field.kml", "--drone", "sim", "--detector", "learned"], "it needs a file; give its"),
        (["field.kml", "--drone", "sim", "--like", "a.jpg"], "a.jpg: no such photo"),
    ],
)
def test_wrong_arguments_are_refused_in_a_line_and_write_nothing(
    arguments, expected, tmp_path, refused
):
    saved(tmp_path, "field.kml", kml(placemark("Field", kml_polygon())))
    assert expected in refused("new", *arguments)
    assert [path.name for path in tmp_path.iterdir()] == ["field.kml"]


def test_mission_that_could_not_be_flown_is_not_written(field, tmp_path, refused):
    lines = refused.lines("new", field, "--drone", "sim", "--battery", 3, "--out", "a.toml")
    assert "no file is written" in lines[0]
    assert "battery.capacity_wh = 3" in lines[1]
    assert len(list(tmp_path.iterdir())) == 1


def test_existing_mission_is_not_overwritten(field, tmp_path, refused):
    saved(tmp_path, "a.png", b"mine")
    assert "already exists" in refused("new", field, "--drone", "sim", "--out", "a.toml")
    assert not Path("a.toml").exists()


def test_mistyped_mission_gets_a_suggestion(tmp_path, refused):
    assert "did you mean 'runway'?" in refused("check", "runwya")
    saved(tmp_path, "meadow.toml", "")
    assert "did you mean 'meadow.toml'?" in refused("check", "medow.toml")
    assert "did you mean" not in refused("check", "qqqqqqqq")


# --- the plan ---------------------------------------------------------------------------------
def test_plan_is_written_as_a_page_of_its_own(capsys):
    assert main(["check", "spill", "--map", "spill.html"]) == 0
    assert "picture of the plan: spill.html" in capsys.readouterr().out
    page = Page(Path("spill.html").read_text("utf-8"))
    assert not page.open
    assert {value for _, value in page.attributes if "url(" in value} == {"url(#map)"}
    assert {value for _, value in page.attributes if "://" in value} <= {SVG}
    assert not {"script", "img", "link", "iframe"} & set(page.tags)
    words = " ".join(page.words)
    for expected in (
        "UTM zone",
        "(EPSG:326",
        "search box",
        "lanes of vehicle 3",
        "min",
        "grid north",
    ):
        assert expected in words
    assert page.tags.count("circle") >= 3 + 1  # three homes, and one in the legend


def test_names_in_a_page_are_escaped(tmp_path):
    text = named_text("runway").text.replace('name = "runway"', 'name = "a & b\'s"')
    saved(tmp_path, "a.toml", text)
    assert main(["check", "a.toml", "--map", "a.html"]) == 0
    assert "Plan of a &amp; b&#39;s" in Path("a.html").read_text("utf-8")


def test_plan_is_written_as_a_picture():
    assert main(["check", "runway", "--map", "plan.PNG"]) == 0
    with Image.open("plan.PNG") as picture:
        pixels = np.asarray(picture.convert("RGB")).astype(int)
    near = np.abs(pixels - np.array(FENCE)).max(axis=2) < 40
    rows, columns = np.nonzero(near)
    # the fence goes around the drawing: 900 pixels less a rim on either side
    assert np.ptp(columns) > 650
    assert np.ptp(rows) > 600


def test_figures_and_a_map_are_given_at_once(capsys):
    assert main(["check", "runway", "--json", "--map", "a.html"]) == 0
    assert json.loads(capsys.readouterr().out)["mission"] == "runway"


def test_map_of_another_kind_is_refused(tmp_path, refused):
    assert "must end with .html or .png" in refused("check", "runway", "--map", "a.pdf")
    assert "cannot be written" in refused("check", "runway", "--map", "no/a.html")


def with_fence(text, fence):
    ring = re.compile(r"^polygon = \[.*?^\]", re.MULTILINE | re.DOTALL)
    changed, count = ring.subn(f"polygon = {fence}", text, count=1)
    assert count == 1
    return changed


def test_home_far_from_the_box_is_asked_about(field, tmp_path, capsys):
    new(field, "--drone", "astro", "--detector", "threshold", "--out", "a.toml")
    wide = "[[52.44, 13.29], [52.44, 13.32], [52.49, 13.32], [52.49, 13.29]]"
    text = with_fence(Path("a.toml").read_text("utf-8"), wide)
    far = re.sub(r"^position = .*$", "position = [52.4785, 13.3030]", text, count=1, flags=re.M)
    saved(tmp_path, "b.toml", far)
    assert main(["check", "b.toml"]) == 0
    assert "start.position = [52.4785, 13.303]: 2.4 km from search.box; is that" in (
        capsys.readouterr().out
    )


def test_fence_on_another_continent_is_refused(field, tmp_path, capsys, refused):
    new(field, "--drone", "sim", "--out", "a.toml")
    there = "[[12.44, 13.29], [12.44, 13.32], [12.49, 13.32], [12.49, 13.29]]"
    saved(tmp_path, "b.toml", with_fence(Path("a.toml").read_text("utf-8"), there))
    capsys.readouterr()
    assert "fence.polygon" in refused("check", "b.toml")


def zone(name, half_deg, lat_deg=48.0, lon_deg=11.0):
    corners = [(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)]
    ring = [[lon_deg + east * half_deg, lat_deg + north * half_deg] for east, north in corners]
    geometry = {"type": "Polygon", "coordinates": [ring]}
    return {"type": "Feature", "properties": {"name": name}, "geometry": geometry}


def test_new_zones_are_left_out_of_the_fence_and_shown(tmp_path, capsys):
    (tmp_path / "zones").mkdir()
    features = {"type": "FeatureCollection", "features": [zone("Farm", 1e-4)]}
    (tmp_path / "zones" / "one.json").write_text(json.dumps(features), "utf-8")
    options = ["--at", "48,11", "--drone", "sim", "--detector", "paved", "--out", "a.toml"]
    new(*options, "--zones", "zones/one.json")
    assert "zone 'Farm': from the ground; in one.json" in capsys.readouterr().err
    made = Path("a.toml").read_text("utf-8")
    assert tomllib.loads(made)["fence"]["zones"] == ["zones/one.json"]
    mission = load("a.toml")
    assert (len(mission.fence.holes), mission.fence.zones[0].effect) == (1, "hole")
    assert main(["check", "a.toml"]) == 0
    assert "zone 'Farm'" in capsys.readouterr().out


def test_new_zone_over_the_whole_area_is_refused_by_name(tmp_path, capsys):
    features = {"type": "FeatureCollection", "features": [zone("Airport", 0.1)]}
    (tmp_path / "all.json").write_text(json.dumps(features), "utf-8")
    options = ["--at", "48,11", "--drone", "sim", "--out", "a.toml", "--zones", "all.json"]
    assert main(["new", *options]) == 2
    assert "zone 'Airport'" in capsys.readouterr().err
    assert not Path("a.toml").exists()
