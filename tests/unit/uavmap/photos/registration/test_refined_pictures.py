"""`uavmap replay` on photographs whose headings, heights and positions are wrong."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from missions.errors import ImageError
from missions.geo.geodesy import LocalPlane
from missions.units import GridPoint, LatLon, Quaternion
from tests.support.photographs import dji, write_photo
from tests.unit.vision.scene import CAMERA, GRID, Shot, meadow, passes
from uavmap.photos.registration.calibration import read_calibration
from uavmap.photos.registration.refinement import attitude
from uavmap.photos.scratch_file import FeatureFile
from uavmap.ui.cli import main
from vision.camera import euler, rotation
from vision.registration.ground_plane import bearing
from vision.registration.views import Features

ORIGIN = GRID.position(GridPoint(0.0, 0.0))
PLANE = LocalPlane(ORIGIN)
SHOTS = passes(2, 3, 5.0, seed=12)
UPSIDE_DOWN = 4
FILM_MM = 36.0 / 2.0 / math.tan(CAMERA.hfov_rad / 2.0)


def dms(degrees: float) -> tuple[float, float, float]:
    whole = math.floor(abs(degrees))
    return (float(whole), (abs(degrees) - whole) * 60.0, 0.0)


def photographs(folder: Path, *, xmp: bool = True) -> list[Shot]:
    """Write six photographs of a meadow with inexact tags, and one of another place.

    Their tags are off by metres and degrees. Without `xmp` they have positions only.
    """
    folder.mkdir()
    rng = np.random.default_rng(4)
    shots = [*SHOTS, Shot(1.0, 2.0)]
    for k, shot in enumerate(shots):
        gray = shot.picture(meadow(1 if k < len(SHOTS) else 2), k)
        image = gray[::-1, ::-1] if k == UPSIDE_DOWN else gray
        off = rng.normal(0.0, 0.7, 2)
        place = PLANE.to_wgs84(shot.east_m + off[0], shot.north_m + off[1])
        yaw_deg = math.degrees(float(bearing(shot.axes()[None])[0])) + rng.normal(0.0, 4.0)
        write_photo(
            folder / f"{k}.jpg",
            gps={1: "N", 2: dms(place.lat_deg), 3: "W", 4: dms(place.lon_deg)},
            taken=f"2026:05:01 10:00:0{k}",
            film_mm=round(FILM_MM),
            xmp=dji(RelativeAltitude=f"{shot.height_m:+.2f}", GimbalYawDegree=f"{yaw_deg:+.2f}")
            if xmp
            else b"",
            image=Image.fromarray(image).convert("RGB"),
        )
    return shots


def ring(half_m: float) -> list[list[float]]:
    corners = [(-half_m, -half_m), (half_m, -half_m), (half_m, half_m), (-half_m, half_m)]
    places = [PLANE.to_wgs84(e, n) for e, n in corners]
    return [[p.lat_deg, p.lon_deg] for p in places]


@pytest.fixture(scope="module")
def mission(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("mission") / "meadow.toml"
    file.write_text(
        f"""
        start.position = [{ORIGIN.lat_deg}, {ORIGIN.lon_deg}]
        search.box = {ring(20.0)}
        fence.polygon = {ring(60.0)}
        grid.cell_m = 2.0
        flight.altitude_m = 11.0
        camera = {{width_px = 320, height_px = 240, mounting = "gimbal"}}
        detector = {{intensity = 100, dilations = 0, share = 0.5, view = "all"}}
        votes = {{frames = 1, positive = 1}}
        """,
        "utf-8",
    )
    return file


def replayed(folder: Path, mission: Path, *options: str) -> tuple[dict[str, Any] | None, str]:
    """Return registration.json, if there is one, and the tracks of the map."""
    out = folder / "-".join(["map", *options])
    line = ["replay", str(folder / "photos"), "--mission", str(mission), "--out", str(out)]
    assert main([*line, "--no-ortho", *options]) in (0, 3)
    file = out / "registration.json"
    told = json.loads(file.read_text("utf-8")) if file.exists() else None
    return told, (out / "map.geojson").read_text("utf-8")


def test_photographs_with_wrong_tags_are_refined(
    tmp_path: Path, mission: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shots = photographs(tmp_path / "photos")
    told, map_refined = replayed(tmp_path, mission)
    err = capsys.readouterr().err
    assert told is not None
    assert told["pictures_refined"] == len(SHOTS)
    *good, other = told["pictures"]
    for entry, shot in zip(good, shots, strict=False):
        place = PLANE.to_plane(LatLon(entry["lat_deg"], entry["lon_deg"]))
        assert math.dist(place, (shot.east_m, shot.north_m)) < 1.5
        turned = entry["name"] == f"{UPSIDE_DOWN}.jpg"
        heading_deg = math.degrees(float(bearing(shot.axes()[None])[0])) + 180.0 * turned
        assert abs(math.remainder(entry["heading_deg"] - heading_deg, 360.0)) < 6.0
        assert entry["upside_down"] is turned
    assert other == {
        "name": "6.jpg",
        "refined": False,
        "why": "no overlap with another picture was found",
    }
    assert "6 of 7 pictures refined" in err
    rows = csv.DictReader((tmp_path / "map" / "pictures.csv").read_text("utf-8").splitlines())
    assert [row["picture"] for row in rows if row["upside_down"]] == [f"{UPSIDE_DOWN}.jpg"]
    assert "4.jpg: stored upside down" in err
    assert "6.jpg: left as tagged: no overlap" in err
    apart = told["held_apart"]
    assert apart["as_tagged"]["median_m"] > 1.0
    assert apart["refined"]["median_m"] < 0.1

    nothing, map_tagged = replayed(tmp_path, mission, "--refine", "off")
    assert nothing is None
    assert "registration" not in capsys.readouterr().err
    assert map_tagged != map_refined


def test_photographs_with_positions_only_are_refined(
    tmp_path: Path, mission: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """No heading, no height: without refinement none of them can be used."""
    photographs(tmp_path / "photos", xmp=False)
    told, _ = replayed(tmp_path, mission)
    assert told is not None
    assert told["pictures_refined"] == len(SHOTS)
    assert told["held_apart"]["as_tagged"] is None
    assert told["held_apart"]["refined"]["p90_m"] < 0.1
    rows = list(csv.DictReader((tmp_path / "map" / "pictures.csv").read_text("utf-8").splitlines()))
    assert [row["used"] for row in rows] == ["yes"] * 6 + ["no"]
    assert all(not row["height_m"] and row["refined_height_m"] for row in rows[:6])
    line = ["replay", str(tmp_path / "photos"), "--mission", str(mission), "--refine", "off"]
    capsys.readouterr()
    assert main([*line, "--out", str(tmp_path / "none")]) == 2
    assert "no height" in capsys.readouterr().err


@pytest.mark.parametrize(
    "angles", [(0.0, -math.pi / 2, 2.0), (0.3, -1.4, -2.5), (-3.0, -1.5, 0.1), (0.0, 0.2, 3.0)]
)
def test_attitude_is_converted_there_and_back(angles: tuple[float, float, float]) -> None:
    turn = Quaternion.from_euler(*angles)
    assert np.allclose(rotation(Quaternion.from_euler(*euler(turn))), rotation(turn), atol=1e-9)
    forward, right, down = rotation(turn).T
    axes = np.array([[v[1], v[0], -v[2]] for v in (right, down, forward)]).T
    assert np.allclose(rotation(attitude(axes)), rotation(turn), atol=1e-9)


def test_features_are_read_back_unchanged() -> None:
    rng = np.random.default_rng(3)
    given = [
        Features(rng.normal(size=(n, 2)), rng.integers(0, 256, (n, 128), np.uint8), 320 + n, 240)
        for n in (5, 0, 1200)
    ]
    with FeatureFile() as file:
        kept = [file.put(features) for features in given]
        for found, features in reversed(list(zip(kept, given, strict=True))):
            assert np.array_equal(found.points, features.points)
            assert np.array_equal(found.descriptors, features.descriptors)
            assert (found.width_px, found.height_px) == (features.width_px, features.height_px)


# --- calibration ---------------------------------------------------------------------------------
YAML = """%YAML:1.0
---
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 400., 0., 310., 0., 401., 245., 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -0.2, 0.05, 0., 0., 0. ]
"""
XML = """<?xml version="1.0"?>
<opencv_storage>
<image_width>640</image_width><image_height>480</image_height>
<camera_matrix type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt>
<data>400. 0. 310. 0. 401. 245. 0. 0. 1.</data></camera_matrix>
<distortion_coefficients type_id="opencv-matrix"><rows>5</rows><cols>1</cols><dt>d</dt>
<data>-0.2 0.05 0. 0. 0.</data></distortion_coefficients>
</opencv_storage>
"""
JSON = json.dumps(
    {
        "image_width": 640,
        "image_height": 480,
        "camera_matrix": [[400.0, 0, 310.0], [0, 401.0, 245.0], [0, 0, 1]],
        "distortion_coefficients": [-0.2, 0.05, 0, 0, 0],
    }
)


@pytest.mark.parametrize("text", [YAML, XML, JSON, YAML.replace("%YAML:1.0\n", "")])
def test_calibration_of_a_camera_is_read(text: str, tmp_path: Path) -> None:
    path = tmp_path / "camera.any"
    path.write_text(text)
    lens = read_calibration(path)
    assert (lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px) == (400.0, 401.0, 310.0, 245.0)
    assert lens.distortion == (-0.2, 0.05, 0.0, 0.0, 0.0)
    assert lens.model == "brown"


@pytest.mark.parametrize(
    ("text", "blamed"),
    [
        ("nothing", "camera.any"),
        ("{}", "camera_matrix"),
        ("{", "JSON"),
        (JSON.replace("640", "0"), "image_width"),
        (JSON.replace("310.0", "-9.0"), "principal point"),
        (JSON.replace("-0.2, 0.05, ", ""), "coefficients"),
    ],
)
def test_invalid_calibration_is_named(text: str, blamed: str, tmp_path: Path) -> None:
    path = tmp_path / "camera.any"
    path.write_text(text)
    with pytest.raises(ImageError, match=rf"camera\.any: .*{blamed}|{blamed}"):
        read_calibration(path)
