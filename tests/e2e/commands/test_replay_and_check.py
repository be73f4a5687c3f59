"""`uavmap replay`, `uavmap check`, and the command's lines for bad input."""

import json
import os
from pathlib import Path
from socket import AF_INET, SOCK_STREAM, socket

import pytest
from shapely.geometry import shape

from missions.geo.grid import Grid
from tests.benchmarks.photos.brighton import map_counts
from tests.e2e.rig import LOOPBACK, ROI_STATES, SHARED, free_ports, mission, simulator, uavmap
from uavmap.load.mission_source import load, shipped_missions
from uavmap.ui.cli import main

PHOTOGRAPHS = SHARED / "brighton_beach"

needs_photographs = pytest.mark.skipif(
    not PHOTOGRAPHS.is_dir(), reason="the photographs of Brighton Beach are not here"
)


@needs_photographs
def test_photographs_make_a_map_of_the_road(tmp_path):
    done = uavmap("replay", PHOTOGRAPHS, "--mission", "road", "--json", "--out", tmp_path / "map")
    assert done.code == 3  # a few cells look unlike all that was painted
    assert done.summary["photographs"] == 18
    assert 0 < done.summary["cells_unsure"] < 20
    assert done.summary["iou_cells"] is None
    found = json.loads((tmp_path / "map" / "map.geojson").read_text("utf-8"))["features"]
    cells = [f for f in found if f["properties"]["kind"] == "cell"]
    roi = [f for f in cells if f["properties"]["state"] in ROI_STATES]
    assert len(roi) == done.summary["cells_roi"]
    assert 0.02 < len(roi) / len(cells) < 0.5  # a road between grass and trees
    road = load("road")
    assert map_counts(tmp_path / "map", Grid.at(road.home, road.grid.cell_m)).iou > 0.65
    (outline,) = (f for f in found if f["properties"]["kind"] == "outline")
    west, south, east, north = shape(outline["geometry"]).bounds
    assert 46.8415 < south < north < 46.8438
    assert -91.9957 < west < east < -91.9923
    assert (north - south) * 111_200 > 80.0  # it runs through the whole set
    registration = json.loads((tmp_path / "map" / "registration.json").read_text("utf-8"))
    assert registration["pictures_refined"] == 18
    upside_down = [p["name"] for p in registration["pictures"] if p["upside_down"]]
    assert upside_down == [f"DJI_00{number}.JPG" for number in range(24, 30)]
    apart = registration["held_apart"]
    assert apart["as_tagged"]["median_m"] > 2.0
    assert apart["refined"]["median_m"] < 0.15
    assert apart["refined"]["p90_m"] < 0.5
    assert apart["refined"]["median_px"] < 1.0


def test_check_reports_the_planned_search(tmp_path):
    figures = uavmap("check", "runway", "--json", cwd=tmp_path).summary
    assert figures["mission"] == "runway"
    assert figures["search_length_m"] > 100.0
    assert figures["search_time_s"] > 20.0
    assert figures["search_sorties"] >= 1
    assert list(tmp_path.iterdir()) == []  # checking leaves no file behind


def test_check_of_a_flight_without_stopping_reports_its_figures(tmp_path):
    """`swath` has no look at each cell, and no stop at either end of a lane."""
    text = Path(mission("tiny")).read_text("utf-8")
    found = {}
    for strategy in ("swath", "rdfs"):
        file = tmp_path / f"{strategy}.toml"
        file.write_text(f'strategy = "{strategy}"\n{text}', "utf-8")
        found[strategy] = uavmap("check", file, "--json", cwd=tmp_path).summary
    assert "exploration_s_per_cell" not in found["swath"]
    assert found["rdfs"]["exploration_s_per_cell"] > 3.0
    # at 5 m/s, 12 m up and down; a stop takes 2.5 s, and a corner less than half of that
    lanes, flown_s = found["swath"]["lanes"], found["swath"]["search_length_m"] / 5.0
    at_least_s = flown_s + 12.0 / 1.5 + 12.0 / 0.5 + 12.0
    assert at_least_s - 1.0 < found["swath"]["search_time_s"] < at_least_s + 2.5 + 2.5 * lanes


@pytest.mark.parametrize("name", ["road", "runway", "spill"])
def test_shipped_missions_are_sound(name, capsys):
    assert name in shipped_missions()
    assert main(["check", name]) == 0
    out, err = capsys.readouterr()
    assert "no fault" in out
    assert "search_length_m" in out
    assert err == ""


AUTO = ("altitude_m = 12.0", 'altitude_m = "auto"')
FAST = ("speed_m_s = 5.0", "speed_m_s = 25.0\nmax_airspeed_m_s = 30.0")
SLOW_SHUTTER = ("interval_s = 0.25", "interval_s = 0.25\nexposure_s = 0.005\npixels_per_cell = 60")
PAIR = ("[[vehicles]]", "[[vehicles]]\n[[vehicles]]")
LAYERS = {
    "given": (
        (),
        "flight.altitude_m sets the height",
        "12 m: a picture shows 20.1 m x 15.1 m, 3.1 cm a pixel, 127.1 pixels a cell; "
        "without stopping up to 5 m/s (flight.speed_m_s)",
    ),
    "auto": (
        (AUTO,),
        "camera.pixels_per_cell sets the height",
        "19 m: a picture shows 31.9 m x 23.9 m, 5.0 cm a pixel, 80.3 pixels a cell; "
        "without stopping up to 5 m/s (flight.speed_m_s)",
    ),
    "below a ceiling": (
        (AUTO, FAST, ("[grid]", "ceiling_m = 18.0\n[grid]")),
        "fence.ceiling_m sets the height",
        "18 m: a picture shows 30.2 m x 22.7 m, 4.7 cm a pixel, 84.7 pixels a cell; "
        "without stopping up to 14.1 m/s (votes.frames)",
    ),
    "wind": (
        (
            ("speed_m_s = 2.0", "speed_m_s = 8.5"),
            ("interval_s = 0.25", 'interval_s = 0.25\nmounting = "gimbal"'),
        ),
        "flight.altitude_m sets the height",
        "12 m: a picture shows 20.1 m x 15.1 m, 3.1 cm a pixel, 127.1 pixels a cell; "
        "without stopping up to 3.5 m/s (flight.max_airspeed_m_s, less wind.speed_m_s)",
    ),
    "two layers": (
        (AUTO, FAST, SLOW_SHUTTER, PAIR),
        "camera.pixels_per_cell sets the height",
        "19.4 m: a picture shows 32.6 m x 24.4 m, 5.1 cm a pixel, 78.6 pixels a cell; "
        "without stopping up to 15.2 m/s (camera.max_blur_px)",
        "25.4 m: a picture shows 42.6 m x 32 m, 6.7 cm a pixel, 60.1 pixels a cell; "
        "without stopping up to 19.9 m/s (camera.max_blur_px)",
    ),
}


def with_the_usual_camera(text):
    small = ("width_px", "height_px", "pixels_per_cell")
    return "".join(line for line in text.splitlines(True) if not line.startswith(small))


@pytest.mark.parametrize("case", LAYERS)
def test_check_reports_height_and_speed_with_the_reason(case, tmp_path, capsys):
    changes, reason, *rows = LAYERS[case]
    text = with_the_usual_camera(Path(mission("tiny")).read_text("utf-8"))
    for before, after in changes:
        assert before in text
        text = text.replace(before, after, 1)
    file = tmp_path / "high.toml"
    file.write_text(text, "utf-8")
    assert main(["check", str(file)]) == 0
    lines = capsys.readouterr().out.splitlines()
    at = lines.index(f"  height and speed of each layer; {reason}:")
    assert lines[at + 1 : at + 1 + len(rows)] == [f"    {row}" for row in rows]
    assert not lines[at + 1 + len(rows)].startswith("    ")


def test_check_json_has_the_layers(tmp_path):
    found = uavmap("check", "spill", "--json", cwd=tmp_path).summary
    assert found["altitude_set_by"] == "flight.altitude_m"
    assert [layer["altitude_m"] for layer in found["layers"]] == [12.0, 18.0, 24.0]
    assert found["layers"][2]["footprint_m"] == [40.3, 30.2]
    assert found["layers"][2]["pixels_per_cell"] == 63.6
    assert {layer["speed_set_by"] for layer in found["layers"]} == {"flight.speed_m_s"}


def test_port_in_use_is_named():
    with simulator("speck", speedup=1.0) as (url,):
        port = int(url.rpartition(":")[2])
        _, http_port = free_ports(1)
        with socket(AF_INET, SOCK_STREAM) as squatter:
            squatter.bind((LOOPBACK, http_port))
            squatter.listen()
            done = uavmap("sitl", "--port", port + 1, "--http-port", http_port)
    assert done.code == 2
    assert str(http_port) in done.err
    assert "--http-port" in done.err


@pytest.mark.skipif(os.geteuid() == 0, reason="root writes anywhere")
def test_folder_that_cannot_be_written_is_named(tmp_path):
    tmp_path.chmod(0o500)
    try:
        done = uavmap("fly", mission("speck"), "--sim", "--out", tmp_path / "out")
    finally:
        tmp_path.chmod(0o700)
    assert done.code == 2
    assert str(tmp_path) in done.err
