"""`uavmap replay`, `uavmap check`, and what the command says of bad input."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path
from socket import AF_INET, SOCK_STREAM, socket

import cv2
import numpy as np
import pytest
from shapely.geometry import shape

from tests.e2e.rig import LOOPBACK, SHARED, free_ports, mission, simulator, uavmap
from uavmap.cli import main
from uavmap.mission_source import shipped_missions

PHOTOGRAPHS = SHARED / "brighton_beach"

needs_photographs = pytest.mark.skipif(
    not PHOTOGRAPHS.is_dir(), reason="the photographs of Brighton Beach are not here"
)


@needs_photographs
def test_photographs_make_a_map_of_the_road(tmp_path):
    done = uavmap("replay", PHOTOGRAPHS, "--mission", "road", "--json", "--out", tmp_path / "map")
    assert done.code == 0
    assert done.summary["photographs"] == 18
    assert done.summary["completed"] is True
    assert done.summary["iou_cells"] is None
    found = json.loads((tmp_path / "map" / "map.geojson").read_text("utf-8"))["features"]
    cells = [f for f in found if f["properties"]["kind"] == "cell"]
    roi = [f for f in cells if f["properties"]["state"] != "non-roi"]
    assert len(roi) == done.summary["cells_roi"]
    assert 0.02 < len(roi) / len(cells) < 0.5  # a road between grass and trees
    (outline,) = (f for f in found if f["properties"]["kind"] == "outline")
    west, south, east, north = shape(outline["geometry"]).bounds
    assert 46.8415 < south < north < 46.8438
    assert -91.9957 < west < east < -91.9923
    assert (north - south) * 111_200 > 80.0  # it runs through the whole set


@needs_photographs
def test_a_bad_photograph_is_named(tmp_path, capsys):
    photos = tmp_path / "photos"
    photos.mkdir()
    shutil.copy(PHOTOGRAPHS / "DJI_0018.JPG", photos)
    whole = (PHOTOGRAPHS / "DJI_0019.JPG").read_bytes()
    bad = {
        "plain.jpg": cv2.imencode(".jpg", np.zeros((60, 80, 3), np.uint8))[1].tobytes(),
        "torn.jpg": whole[: len(whole) // 3],
    }
    for name, data in bad.items():
        (photos / name).write_bytes(data)
        folder = tmp_path / f"map of {name}"
        assert main(["replay", str(photos), "--mission", "road", "--out", str(folder)]) == 2
        (photos / name).unlink()
        _, err = capsys.readouterr()
        (line,) = [line for line in err.splitlines() if line.startswith("uavmap: ")]
        assert name in line


def test_check_says_what_would_be_flown(tmp_path):
    figures = uavmap("check", "runway", "--json", cwd=tmp_path).summary
    assert figures["mission"] == "runway"
    assert figures["search_length_m"] > 100.0
    assert figures["search_time_s"] > 20.0
    assert figures["search_sorties"] >= 1
    assert list(tmp_path.iterdir()) == []  # checking leaves nothing behind


@pytest.mark.parametrize("name", ["road", "runway", "spill"])
def test_the_shipped_missions_are_sound(name, capsys):
    assert name in shipped_missions()
    assert main(["check", name]) == 0
    out, err = capsys.readouterr()
    assert "nothing wrong" in out
    assert "search_length_m" in out
    assert err == ""


# --- bad input: a line, exit code 2 ------------------------------------------------------------
SPOILT = {
    "a misspelt key": ("cell_m = 4.0", "cel_m = 4.0", "grid.cel_m"),
    "a missing key": ("position = [47.3, 8.5]", "", "start.position"),
    "a cell of no size": ("cell_m = 4.0", "cell_m = 0.0", "grid.cell_m"),
    "swapped too far": (
        "position = [47.3, 8.5]",
        "position = [98.5, 47.3]",
        "start.position",
    ),
    "too narrow a view": ("interval_s = 0.25", "interval_s = 0.25\nhfov_deg = 30.0", "hfov_deg"),
    "not TOML": ('name = "tiny"', "name = tiny", "TOML"),
    "not a number": ("speed_m_s = 5.0", 'speed_m_s = "fast"', "flight.speed_m_s"),
    "too strong a drift": ("[[vehicles]]", "[drift]\nspeed_m_s = 6.0\n[[vehicles]]", "drift"),
}


def test_a_faulty_mission_file_stops_a_flight_before_it_begins(tmp_path):
    before, after, key = SPOILT["a misspelt key"]
    text = Path(mission("tiny")).read_text("utf-8")
    assert before in text
    file = tmp_path / "my mission.toml"
    file.write_text(text.replace(before, after, 1), "utf-8")
    done = uavmap("fly", file, "--sim", cwd=tmp_path)
    assert done.code == 2
    assert done.out == ""
    (line,) = done.err.splitlines()
    assert key in line
    assert str(file) in line
    assert [path.name for path in tmp_path.iterdir()] == [file.name]  # no results folder


@pytest.mark.parametrize("fault", sorted(SPOILT))
def test_a_faulty_mission_file_is_described_in_a_line(fault, tmp_path, capsys):
    before, after, key = SPOILT[fault]
    text = Path(mission("tiny")).read_text("utf-8")
    assert before in text
    file = tmp_path / "my mission.toml"
    file.write_text(text.replace(before, after, 1), "utf-8")
    assert main(["check", str(file)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    (line,) = err.splitlines()
    assert key in line
    assert str(file) in line


def test_nobody_answers(tmp_path):
    port, _ = free_ports(1)
    url = f"udpout://{LOOPBACK}:{port}"
    folder = tmp_path / "out"
    done = uavmap("fly", mission("speck"), "--connect", url, "--speedup", 20, "--out", folder)
    assert done.code == 2
    assert url in done.err.splitlines()[-1]


def test_a_port_that_is_taken_is_named():
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
def test_a_folder_that_cannot_be_written(tmp_path):
    tmp_path.chmod(0o500)
    try:
        done = uavmap("fly", mission("speck"), "--sim", "--out", tmp_path / "out")
    finally:
        tmp_path.chmod(0o700)
    assert done.code == 2
    assert str(tmp_path) in done.err
