"""Lines of `uavmap replay` about pictures; a bad picture among them changes no cell."""

from __future__ import annotations

import contextlib
import json
import re
import shutil
import sqlite3
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image, ImageFilter

from tests.support.photographs import dji
from tests.unit.uavmap.photos.test_replay import (
    GSD_M,
    HEIGHT,
    UP_M,
    WIDTH,
    field_text,
    shot,
)
from uavmap.ui.cli import main

PLACES = [(east_m, north_m) for north_m in (0.0, 10.0) for east_m in (0.0, 12.0, 24.0)]


def ground() -> np.ndarray:
    rng = np.random.default_rng(3)
    rows, columns = (round((span_m + side * GSD_M) / GSD_M) + 2 for span_m, side in (
        (10.0, HEIGHT), (24.0, WIDTH)
    ))  # fmt: skip
    fine = sum(
        cv2.resize(
            rng.normal(0.0, 22.0, (rows // size, columns // size, 3)), (columns, rows),
            interpolation=cv2.INTER_CUBIC,
        )
        for size in (4, 9, 25)
    )  # fmt: skip
    meadow = np.full((rows, columns, 3), (80, 130, 70), np.float64)
    meadow[:, columns // 2 : columns // 2 + 120] = (170, 165, 160)
    return np.clip(meadow + fine, 0, 255).astype(np.uint8)


def view(of: np.ndarray, east_m: float, north_m: float) -> Image.Image:
    left, top = round(east_m / GSD_M), round((10.0 - north_m) / GSD_M)
    return Image.fromarray(of[top : top + HEIGHT, left : left + WIDTH])


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder, field = tmp_path_factory.mktemp("good") / "photos", ground()
    folder.mkdir()
    for number, (east_m, north_m) in enumerate(PLACES):
        image = view(field, east_m, north_m)
        shot(
            folder / f"{number}.jpg", number, (east_m + 0.7 * (-1) ** number, north_m), image=image
        )
    return folder


@pytest.fixture(scope="module")
def good(photos: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("good") / "out"
    assert replayed(photos, folder)["photographs_refused"] == 0
    return folder


@pytest.fixture
def more(photos: Path, tmp_path: Path) -> Path:
    """Copy the photographs; tests add others."""
    return Path(shutil.copytree(photos, tmp_path / "photos"))


def replayed(photos: Path, out: Path, *more: object) -> dict[str, Any]:
    code = main(["replay", *map(str, (photos, "--no-ortho", "--out", out, *more))])
    assert code == 0
    summary: dict[str, Any] = json.loads((out / "summary.json").read_text("utf-8"))
    return summary


def cells(out: Path) -> list[Any]:
    features = json.loads((out / "map.geojson").read_text("utf-8"))["features"]
    return [feature for feature in features if feature["properties"]["kind"] == "cell"]


def blurred(image: Image.Image) -> dict[str, object]:
    return {"image": image.filter(ImageFilter.GaussianBlur(20))}


def dark(image: Image.Image) -> dict[str, object]:
    return {"image": image.point(lambda level: level // 20)}


def from_high(image: Image.Image) -> dict[str, object]:
    return {"image": image, "xmp": dji(RelativeAltitude="+400.0", GimbalYawDegree="+0.0")}


def aslant(image: Image.Image) -> dict[str, object]:
    tags = {"RelativeAltitude": f"{UP_M:+.2f}", "GimbalYawDegree": "+0.0"}
    return {"image": image, "xmp": dji(**tags, GimbalPitchDegree="-20.0")}


@pytest.mark.parametrize("bad", [blurred, dark, from_high, aslant])
def test_replay_one_bad_picture_more_changes_no_cell(bad, more, good, tmp_path):
    """It acts neither through the poses of the others nor through the derived grid."""
    image = view(ground(), 18.0, 5.0)
    shot(more / "bad.jpg", 50, (60.0, 5.0), 25.0, **bad(image))
    summary = replayed(more, tmp_path / "with")
    assert summary["photographs_refused"] == 1
    assert cells(tmp_path / "with") == cells(good)
    text = (tmp_path / "with" / "mission.toml").read_text("utf-8")
    assert text == (good / "mission.toml").read_text("utf-8")
    (row,) = [
        line
        for line in (tmp_path / "with" / "pictures.csv").read_text("utf-8").splitlines()
        if line.startswith("bad.jpg")
    ]
    assert row.startswith("bad.jpg,no,")
    assert "bad.jpg: " in (tmp_path / "with" / "report.html").read_text("utf-8")


def test_replay_the_same_picture_twice_changes_no_cell(more, good, tmp_path):
    shutil.copy(more / "2.jpg", more / "again.jpg")
    summary = replayed(more, tmp_path / "with")
    assert summary["photographs_twice"] == 1
    assert cells(tmp_path / "with") == cells(good)


def fences(out: Path) -> int:
    with contextlib.closing(sqlite3.connect(out / "map.gpkg")) as layers:
        if not layers.execute("SELECT 1 FROM sqlite_master WHERE name = 'fence'").fetchone():
            return 0
        count: int = layers.execute("SELECT COUNT(*) FROM fence").fetchone()[0]
    return count


_OF_FLIGHTS = re.compile(
    r"mission completed|makespan|sorties|explor|strategy|battery|wind\.|geofence|search box"
    r"|vehicle|\bhome\b|\d:\d\d min",
    re.IGNORECASE,
)


def test_replay_without_a_mission_explains_pictures_and_detector(photos, tmp_path, capsys):
    out = tmp_path / "out"
    summary = replayed(photos, out, "--verbose")
    told = capsys.readouterr()
    assert re.search(r"photographs\s*.\s*6 of 6 in the map", told.out)
    assert "the default detector is paved, which depends least on the light" in told.err
    assert f"uavmap tune {photos} --paint --examples painted --out my-field" in told.err
    report = (out / "report.html").read_text("utf-8")
    page = re.sub(r"<style>.*?</style>", "", report, flags=re.DOTALL)
    for text in (told.out, told.err, page):
        assert not (found := _OF_FLIGHTS.findall(text)), found
    assert not {"makespan_s", "sorties", "flight_time_s", "unsearched_m"} & set(summary)
    assert fences(out) == 0
    kml = (out / "map.kml").read_text("utf-8")
    assert not re.search(r"<name>(explored|Vehicle)", kml)
    assert "Pictures: " in page
    assert "data:image/jpeg;base64," in page
    assert "data:image/webp;base64," in page  # the mosaic, beneath the cells
    with Image.open(out / "judged.jpg") as judged:
        pixels = np.asarray(judged.convert("RGB")).astype(int)
    red = (pixels[..., 0] > 150) & (pixels[..., 1] < 90) & (pixels[..., 2] < 90)
    assert np.count_nonzero(red) > 200  # the outline of the track


def test_replay_with_a_mission_shows_the_box_and_fence_that_the_user_gave(photos, tmp_path, capsys):
    mission = tmp_path / "field.toml"
    mission.write_text(field_text())
    replayed(photos, tmp_path / "out", "--mission", mission)
    assert "the default detector is" not in capsys.readouterr().err
    assert "search box" in (tmp_path / "out" / "report.html").read_text("utf-8")
    assert fences(tmp_path / "out") == 2


def test_replay_detector_by_name_is_not_explained(photos, tmp_path, capsys):
    replayed(photos, tmp_path / "out", "--detector", "adaptive")
    told = capsys.readouterr().err
    assert "region = darker than its surroundings" in told
    assert "the default detector is" not in told
