"""Masks and polygons of unusual kinds: read as they were meant, or refused in a line."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from missions.errors import ImageError
from tests.unit.uavmap.photos.test_replay import painted
from tests.unit.uavmap.ui.cli.commands.test_tune import SMALL, WIDE, region_file
from uavmap.photos.tune.examples import load_examples
from uavmap.ui.cli import main

MASK = np.zeros((90, 160), np.uint8)
MASK[:40] = 255
CLEAR = np.dstack([np.full((90, 160, 3), 255, np.uint8), MASK])


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return painted(tmp_path_factory.mktemp("masks") / "images")


@pytest.fixture
def where(tmp_path: Path) -> Path:
    folder = tmp_path / "painted"
    folder.mkdir()
    return folder


def palette(array: np.ndarray) -> Image.Image:
    return Image.fromarray(array).convert("P")


@pytest.mark.parametrize(
    ("name", "picture"),
    [
        ("1.png", Image.fromarray(MASK)),
        ("1.PNG", Image.fromarray(np.dstack([MASK] * 3))),
        ("1.jpg.png", Image.fromarray(MASK)),
        ("1.png", Image.fromarray(MASK.astype(np.uint16) * 257)),
        ("1.png", Image.fromarray(MASK > 0)),
        ("1.png", palette(MASK)),
        ("1.png", Image.fromarray(np.dstack([MASK, np.full_like(MASK, 255)]))),
        ("1.png", Image.fromarray(MASK).resize((32, 18), Image.Resampling.NEAREST)),
    ],
)
def test_a_mask_is_read_in_whatever_way_it_was_saved(
    name: str, picture: Image.Image, images: Path, where: Path
) -> None:
    picture.save(where / name)
    (example,) = load_examples(images, where, WIDE)
    assert example.name == "1"
    assert example.known.all()
    assert abs(example.region.mean() - 40 / 90) < 0.01


def half_grey(mask: np.ndarray, grey: int) -> np.ndarray:
    grown = mask.copy()
    grown[:20] = grey
    return grown


@pytest.mark.parametrize(
    ("picture", "known", "region"),
    [
        (half_grey(MASK, 128), 70 / 90, 20 / 70),
        (half_grey(MASK.astype(np.uint16) * 257, 32768), 70 / 90, 20 / 70),
        (CLEAR, 40 / 90, 1.0),  # what is transparent
    ],
)
def test_what_is_neither_white_nor_black_is_undecided(
    picture: np.ndarray, known: float, region: float, images: Path, where: Path
) -> None:
    Image.fromarray(picture).save(where / "1.png")
    Image.fromarray(MASK).save(where / "2.png")
    one, _ = load_examples(images, where, WIDE)
    assert one.known.mean() == pytest.approx(known, abs=0.01)
    assert one.region[one.known].mean() == pytest.approx(region, abs=0.01)


def red(mask: np.ndarray) -> np.ndarray:
    return np.dstack([mask, np.zeros_like(mask), np.zeros_like(mask)])


@pytest.mark.parametrize(
    ("name", "picture", "why"),
    [
        ("1.png", Image.fromarray(red(MASK)), "is in colour; paint white where the region is"),
        ("1.png", Image.fromarray(MASK // 255), "its brightest pixel has 1 of 255; paint"),
        ("1.png", Image.fromarray(MASK.astype(np.uint16)), "its brightest pixel has 1 of 255"),
        ("1.jpg", Image.fromarray(MASK), "a mask is a PNG, .* save it as 1.png"),
        ("9.png", Image.fromarray(MASK), "no picture has this name; .* such as 0.png"),
        ("1.png", Image.fromarray(MASK * 0), "nothing is painted as region"),
        ("1.png", Image.fromarray(MASK | 255), "nothing is painted as surround"),
        ("1.png", Image.fromarray(MASK[:, :90]), "is not the shape of 1.jpg"),
        ("1.png", Image.fromarray(CLEAR * 0), "nothing is painted as region"),
    ],
)
def test_a_mask_that_means_nothing_is_refused_in_a_line(
    name: str,
    picture: Image.Image,
    why: str,
    images: Path,
    where: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    picture.save(where / name)
    with pytest.raises(ImageError, match=why) as caught:
        load_examples(images, where, WIDE)
    line = ["tune", str(images), "--examples", str(where), "--out", str(tmp_path / "eyes")]
    assert main([*line, *SMALL]) == 2
    assert capsys.readouterr().err.splitlines() == [f"uavmap: {caught.value}"]


def test_two_masks_of_one_picture_are_refused(images: Path, where: Path) -> None:
    for name in ("1.png", "1.jpg.png"):
        Image.fromarray(MASK).save(where / name)
    with pytest.raises(ImageError, match=r"is a mask of 1\.jpg, too; keep one"):
        load_examples(images, where, WIDE)


def away(told: dict[str, object]) -> None:
    (feature,) = told["features"]  # type: ignore[misc]
    (outline,) = feature["geometry"]["coordinates"]
    feature["geometry"]["coordinates"] = [[[lat, lon] for lon, lat in outline]]


def metres(told: dict[str, object]) -> None:
    (feature,) = told["features"]  # type: ignore[misc]
    feature["geometry"]["coordinates"] = [[[5e5, 5e6], [5.1e5, 5e6], [5e5, 5.1e6], [5e5, 5e6]]]


def named(told: dict[str, object]) -> None:
    told["crs"] = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32632"}}


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (away, r"no polygon of the region lies in any picture; .* longitude before latitude\?"),
        (metres, "no places on Earth; coordinates are longitude and latitude in WGS84"),
        (named, "EPSG::32632.*; export the polygons as GeoJSON"),
    ],
)
def test_polygons_that_lie_elsewhere_are_refused_in_a_line(
    change: Callable[[dict[str, object]], None], why: str, images: Path, tmp_path: Path
) -> None:
    path = region_file(tmp_path / "region.geojson")
    told = json.loads(path.read_text("utf-8"))
    change(told)
    path.write_text(json.dumps(told), "utf-8")
    with pytest.raises(ImageError, match=why) as caught:
        load_examples(images, path, WIDE)
    assert str(path) in str(caught.value)
