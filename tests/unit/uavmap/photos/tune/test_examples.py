"""Masks and polygons of unusual kinds, and the page for painting, which needs its address."""

from __future__ import annotations

import http.client
import io
import json
import socket
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from PIL import Image

from missions.errors import ImageError
from tests.unit.uavmap.photos.test_replay import painted
from tests.unit.uavmap.ui.cli.commands.test_tune import SMALL, WIDE, region_file
from uavmap.photos.tune.examples import load_examples
from uavmap.photos.tune.paint_page import MAX_BYTES, Easel, served
from uavmap.ui.cli import main

MASK = np.zeros((90, 160), np.uint8)
MASK[:40] = 255
CLEAR = np.dstack([np.full((90, 160, 3), 255, np.uint8), MASK])


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return painted(tmp_path_factory.mktemp("masks") / "images")


@pytest.fixture
def mask_folder(tmp_path: Path) -> Path:
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
def test_mask_in_any_format_is_read(
    name: str, picture: Image.Image, images: Path, mask_folder: Path
) -> None:
    picture.save(mask_folder / name)
    (example,) = load_examples(images, mask_folder, WIDE)
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
def test_grey_part_of_a_mask_is_undecided(
    picture: np.ndarray, known: float, region: float, images: Path, mask_folder: Path
) -> None:
    Image.fromarray(picture).save(mask_folder / "1.png")
    Image.fromarray(MASK).save(mask_folder / "2.png")
    one, _ = load_examples(images, mask_folder, WIDE)
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
def test_mask_that_means_nothing_is_refused(
    name: str, picture: Image.Image, why: str, images: Path, mask_folder: Path
) -> None:
    picture.save(mask_folder / name)
    with pytest.raises(ImageError, match=why):
        load_examples(images, mask_folder, WIDE)


def test_two_masks_of_one_picture_are_refused_in_a_line(
    images: Path, mask_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("1.png", "1.jpg.png"):
        Image.fromarray(MASK).save(mask_folder / name)
    line = ["tune", str(images), "--examples", str(mask_folder), "--out", str(tmp_path / "eyes")]
    assert main([*line, *SMALL]) == 2
    (told,) = capsys.readouterr().err.splitlines()
    assert told.startswith("uavmap: ")
    assert "is also a mask of 1.jpg; keep one" in told


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
        (away, r"no polygon of the region is in any picture; .* longitude before latitude\?"),
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


@pytest.fixture
def easel(tmp_path: Path) -> Easel:
    images, masks = tmp_path / "images", tmp_path / "masks"
    images.mkdir()
    masks.mkdir()
    rng = np.random.default_rng(2)
    for name in ("a", "b"):
        picture = Image.fromarray(rng.integers(0, 255, (60, 80, 3), dtype=np.uint8))
        picture.save(images / f"{name}.jpg")
    return Easel(images, masks, 64)


@pytest.fixture
def address(easel: Easel) -> Iterator[str]:
    with served(easel) as url:
        yield url


def ask(
    method: str, url: str, body: bytes | None = None, headers: dict[str, str] | None = None
) -> tuple[int, bytes]:
    parts = urlsplit(url)
    connection = http.client.HTTPConnection(parts.hostname or "", parts.port, timeout=120)
    try:
        connection.request(method, parts.path, body, headers or {})
        answer = connection.getresponse()
        return answer.status, answer.read()
    finally:
        connection.close()


def png(size: tuple[int, int]) -> bytes:
    values = np.zeros((size[1], size[0], 3), np.uint8)
    values[: size[1] // 2] = 255
    out = io.BytesIO()
    Image.fromarray(values).save(out, "PNG")
    return out.getvalue()


def test_painted_mask_is_an_example(easel: Easel, address: str, tmp_path: Path) -> None:
    status, page = ask("GET", address)
    assert status == 200
    assert b"http://" not in page
    assert b"https://" not in page
    assert ask("GET", f"{address}mask/1")[0] == 204
    status, jpeg = ask("GET", f"{address}picture/1")
    assert Image.open(io.BytesIO(jpeg)).size == (64, 48)
    assert ask("PUT", f"{address}mask/1", png((64, 48))) == (200, b"saved b.png")
    assert ask("GET", f"{address}mask/1")[0] == 200
    assert ask("GET", f"{address}pictures")[1] == (
        b'[{"name": "a", "painted": false}, {"name": "b", "painted": true}]'
    )
    (example,) = load_examples(tmp_path / "images", easel.masks, 64)
    assert example.known.all()
    assert example.region.mean() == pytest.approx(0.5)
    assert not easel.done.is_set()
    assert ask("POST", f"{address}done")[0] == 200
    assert easel.done.wait(20)


def test_request_of_another_host_or_path_is_refused(easel: Easel, address: str) -> None:
    root = address.rsplit("/", 2)[0]
    for path in ("/", "/x/", "/x/pictures", "/x/mask/0"):
        assert ask("GET", root + path)[0] == 404
    rebound = {"Host": "evil.example:80"}
    assert ask("GET", f"{address}pictures", headers=rebound)[0] == 404
    assert ask("PUT", f"{address}mask/0", png((64, 48)), rebound)[0] == 404
    assert ask("POST", f"{address}done", headers=rebound)[0] == 404
    assert list(easel.masks.iterdir()) == []
    assert not easel.done.is_set()


@pytest.mark.parametrize("path", ["mask/2", "mask/-1", "mask/..%2f..%2fx", "mask/x", "mask", "x/0"])
def test_mask_of_an_unknown_picture_is_refused(easel: Easel, address: str, path: str) -> None:
    assert ask("PUT", address + path, png((64, 48)))[0] == 404
    assert list(easel.masks.iterdir()) == []


def test_mask_that_is_no_picture_is_refused(easel: Easel, address: str) -> None:
    assert ask("PUT", f"{address}mask/0", b"no picture")[0] == 422
    huge = {"Content-Length": str(MAX_BYTES + 1)}
    assert ask("PUT", f"{address}mask/0", b"", huge)[0] == 413
    assert list(easel.masks.iterdir()) == []


def test_missing_picture_is_reported(
    easel: Easel, address: str, capfd: pytest.CaptureFixture[str]
) -> None:
    easel.pictures[0].unlink()
    (easel.masks / "b.png").mkdir()
    for path in ("picture/0", "mask/1"):
        status, text = ask("GET", address + path)
        assert (status, b"cannot be read" in text) == (422, True)
    assert capfd.readouterr().err == ""


def test_browser_that_goes_away_causes_no_traceback(
    address: str, capfd: pytest.CaptureFixture[str]
) -> None:
    parts = urlsplit(address)
    with socket.create_connection((parts.hostname or "", parts.port or 0)) as wire:
        # closed with unread input: the next read of the other side is refused
        wire.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        wire.sendall(f"PUT {parts.path}mask/0 HTTP/1.1\r\n".encode())
        wire.sendall(f"Host: {parts.netloc}\r\nContent-Length: 1000\r\n\r\n".encode())
    assert ask("GET", f"{address}pictures")[0] == 200  # after it, in a thread of its own
    assert "Traceback" not in capfd.readouterr().err


def test_masks_do_not_lie_among_the_pictures(tmp_path: Path) -> None:
    for name in ("a.jpg", "a.png"):
        Image.new("RGB", (80, 60)).save(tmp_path / name)
    with pytest.raises(ImageError, match="masks need one of their own"):
        Easel(tmp_path, tmp_path, 64)
    with pytest.raises(ImageError, match="masks need one of their own"):
        load_examples(tmp_path, tmp_path / "." / "", 64)
    with pytest.raises(
        ImageError, match=r"a\.(jpg|png) and a\.(jpg|png): a mask a\.png would fit both"
    ):
        Easel(tmp_path, tmp_path / "masks", 64)


# --- classes -------------------------------------------------------------------------------------
TWO = "oil = {number = 2}\nweed = {number = 7}\n"
NUMBERS = np.zeros((90, 160), np.uint8)
NUMBERS[:40], NUMBERS[60:80], NUMBERS[80:] = 7, 2, 255


def indexed(numbers: np.ndarray) -> Image.Image:
    picture = Image.fromarray(numbers, "P")
    picture.putpalette(np.random.default_rng(1).integers(0, 256, 768).tolist())
    return picture


@pytest.mark.parametrize(
    "picture",
    [
        Image.fromarray(NUMBERS),
        indexed(NUMBERS),
        Image.fromarray(NUMBERS.astype(np.uint16)),
        Image.fromarray(np.dstack([NUMBERS] * 3)),
        Image.fromarray(np.dstack([NUMBERS * (NUMBERS < 255), 255 - NUMBERS // 255 * 255])),
    ],
)
def test_mask_beside_classes_has_numbers_in_any_format(
    picture: Image.Image, images: Path, mask_folder: Path
) -> None:
    (mask_folder / "classes.toml").write_text(TWO)
    picture.save(mask_folder / "1.png")
    (example,) = load_examples(images, mask_folder, WIDE)
    parts = [float((example.painted == number).mean()) for number in (7, 0, 2, 255)]
    assert parts == pytest.approx([40 / 90, 20 / 90, 20 / 90, 10 / 90], abs=0.01)
    assert example.known.mean() == pytest.approx(80 / 90, abs=0.01)
    assert example.region.mean() == pytest.approx(60 / 90, abs=0.01)


@pytest.mark.parametrize(
    ("toml", "picture", "why"),
    [
        (TWO, Image.fromarray(NUMBERS + (NUMBERS == 2)), r"1.png: holds 3, .* 2 oil, 7 weed"),
        (TWO, Image.fromarray(red(NUMBERS)), "1.png: is in colour"),
        ("oil = 3", Image.fromarray(NUMBERS), r"classes.toml: oil: must be a table"),
        ("", Image.fromarray(NUMBERS), r"classes.toml: no class; add one"),
        ("oil", Image.fromarray(NUMBERS), r"classes.toml: not a TOML file"),
    ],
)
def test_mask_or_table_of_classes_that_means_nothing_is_refused(
    toml: str, picture: Image.Image, why: str, images: Path, mask_folder: Path
) -> None:
    (mask_folder / "classes.toml").write_text(toml)
    picture.save(mask_folder / "1.png")
    with pytest.raises(ImageError, match=why):
        load_examples(images, mask_folder, WIDE)


@pytest.mark.parametrize("told", ["oil", 2])
def test_polygon_has_a_class_by_name_or_number(
    told: str | int, images: Path, tmp_path: Path
) -> None:
    path = region_file(tmp_path / "region.geojson")
    plain = load_examples(images, path, WIDE)
    (tmp_path / "classes.toml").write_text(TWO)
    with pytest.raises(ImageError, match=r"class is None: expected one of oil \(2\), weed \(7\)"):
        load_examples(images, path, WIDE)
    root = json.loads(path.read_text("utf-8"))
    root["features"][0]["properties"] = {"class": told}
    path.write_text(json.dumps(root), "utf-8")
    found = load_examples(images, path, WIDE)
    assert [set(np.unique(example.painted)) for example in found] == [{0, 2}] * len(plain)
    for one, other in zip(found, plain, strict=True):
        assert np.array_equal(one.region, other.region)


def test_class_that_one_picture_shows_is_refused(
    images: Path, mask_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (mask_folder / "classes.toml").write_text(TWO)
    Image.fromarray(NUMBERS).save(mask_folder / "1.png")
    Image.fromarray(NUMBERS * (NUMBERS != 2)).save(mask_folder / "2.png")
    line = ["tune", str(images), "--examples", str(mask_folder), "--out", str(tmp_path / "eyes")]
    assert main([*line, *SMALL]) == 2
    assert "1 of 2 painted pictures shows oil (2); paint at least two" in capsys.readouterr().err


def test_page_has_a_button_for_each_class(easel: Easel, address: str, tmp_path: Path) -> None:
    kinds = json.loads(ask("GET", f"{address}kinds")[1])
    assert [(one["name"], one["level"]) for one in kinds] == [
        ("region", 255), ("surround", 0), ("undecided", 128),
    ]  # fmt: skip
    (easel.masks / "classes.toml").write_text(TWO)
    with served(Easel(tmp_path / "images", easel.masks, 64)) as several:
        kinds = json.loads(ask("GET", f"{several}kinds")[1])
        assert [(one["name"], one["level"]) for one in kinds] == [
            ("oil", 2), ("weed", 7), ("surround", 0), ("undecided", 255),
        ]  # fmt: skip
        out = io.BytesIO()
        Image.fromarray(np.dstack([NUMBERS[:60, :80]] * 3)).save(out, "PNG")
        assert ask("PUT", f"{several}mask/1", out.getvalue())[0] == 200
    with Image.open(easel.masks / "b.png") as kept:
        assert np.array_equal(np.asarray(kept), NUMBERS[:60, :80])
