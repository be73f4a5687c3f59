"""From a KML to a flown mission, and files of `uavmap` read as areas again, in process."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.support.areas.area_files import kml, kml_polygon, placemark, saved
from uavmap.load.areas.reading import read_area_file
from uavmap.load.mission_source import load
from uavmap.runner import flight
from uavmap.ui.cli import main

FIELD = ((13.303, 52.456), (13.3035, 52.456), (13.3035, 52.4563), (13.303, 52.4563))
"""Corners of a field of 34 m x 33 m."""


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_kml_is_flown_in_the_simulator(tmp_path, capsys):
    saved(tmp_path, "meadow.kml", kml(placemark("Meadow", kml_polygon(FIELD))))
    # small pictures and a strategy without compiled kernels: the mission is the subject
    small = ("--pixels", "320x240", "--strategy", "rdfs", "--wind", "2")
    assert main(["new", "meadow.kml", "--drone", "sim", *small]) == 0
    assert main(["check", "meadow.toml"]) == 2  # the mission has no detector yet
    assert 'meadow.toml: detector.name = "later"' in capsys.readouterr().err
    code = main(["fly", "meadow.toml", "--sim", "--out", "flown", "--json"])
    out, err = capsys.readouterr()
    summary = json.loads(out)
    assert code == 0
    assert "the simulator takes threshold: darker than 150 of 255" in err
    assert summary["completed"]
    assert summary["cells_roi"] > 3
    assert (summary["fence_breaches"], summary["reserve_violations"]) == (0, 0)

    # no later command mistakes the simulator's detector for a choice
    assert main(["resume", "flown", "--connect", "udpin://127.0.0.1:14998"]) == 2
    assert 'meadow.toml: detector.name = "later"' in capsys.readouterr().err

    # the mapped region, as uavmap draws it, is an area for the next mission
    for kind, name in (("geojson", "outline"), ("kml", "Region")):
        areas = read_area_file(f"flown/map.{kind}").areas
        assert name in {area.name for area in areas}


def test_new_mission_maps_all_of_its_area_and_other_strategies_warn(capsys, monkeypatch):
    made = ["new", "--at", "52.4568,13.3044", "--size", "40x30", "--drone", "sim"]
    assert main([*made, "--out", "all.toml"]) == 0
    assert main([*made, "--find", "first", "--out", "first.toml"]) == 0
    assert main([*made, "--find", "all", "--strategy", "rdfs", "--out", "none.toml"]) == 2
    assert "--find all is for --strategy swath, not rdfs" in capsys.readouterr().err
    assert main([*made, "--ceiling", "20", "--out", "low.toml"]) == 0
    searches = [load(f"{name}.toml").search for name in ("all", "first", "low")]
    assert [(s.find, s.altitude_m) for s in searches] == [
        ("all", "auto"), ("first", None), ("all", None),
    ]  # fmt: skip
    capsys.readouterr()
    monkeypatch.setattr(flight.Flight, "run", lambda self: {"completed": False})
    assert main(["fly", "all.toml", "--sim", "--strategy", "rdfs", "--json"]) == 3
    assert "for swath, and are set aside" in capsys.readouterr().err
