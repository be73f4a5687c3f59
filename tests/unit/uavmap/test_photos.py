"""Geotags and pixels of photographs: written here with Pillow, and real ones where present."""

from __future__ import annotations

import io
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from missions.errors import ImageError
from missions.ground.grid import Grid
from missions.units import Quaternion
from tests.unit.uavmap.photographs import DJI, dji, write_photo
from uavmap.offline.photos import list_photos
from uavmap.pictures import read_image
from vision.camera import Camera, rotation
from vision.look import Frame
from vision.upright import upside_down

REAL = Path(__file__).resolve().parents[3] / "../shared/data/brighton_beach"


def test_tags_of_a_photo(tmp_path: Path) -> None:
    (photo,) = list_photos(write_photo(tmp_path / "a.JPG"))
    assert photo.pose.position.lat_deg == pytest.approx(46 + 50 / 60 + 33.3855 / 3600)
    assert photo.pose.position.lon_deg == pytest.approx(-(91 + 59 / 60 + 40.4156 / 3600))
    assert photo.pose.height_m == 39.8
    assert (photo.width_px, photo.height_px, photo.taken_s) == (64, 36, 0.0)
    assert photo.hfov_rad == pytest.approx(2 * math.atan(18 / 20))
    forward, _, down = rotation(photo.pose.attitude).T
    assert forward == pytest.approx([0, 0, 1], abs=1e-9)
    up = math.sqrt(0.5)  # the upper edge lies to the north-east
    assert -down == pytest.approx([up, up, 0], abs=1e-9)


def test_southern_and_eastern_letters(tmp_path: Path) -> None:
    gps = {1: "S", 2: (33.0, 30.0, 0.0), 3: "E", 4: (151.0, 15.0, 0.0)}
    (photo,) = list_photos(write_photo(tmp_path / "a.jpg", gps=gps))
    assert (photo.pose.position.lat_deg, photo.pose.position.lon_deg) == (-33.5, 151.25)


@pytest.mark.parametrize(
    ("xmp", "yaw_deg"),
    [
        (dji(GimbalYawDegree=None), 12.0),
        (dji(GimbalRollDegree=None), 45.0),
        (
            DJI.format(attributes='drone-dji:RelativeAltitude="40"')
            .replace("/></rdf:RDF>", "></rdf:Description></rdf:RDF>")
            .replace(
                "</rdf:Description>",
                '<c:Yaw xmlns:c="http://pix4d.com/camera/1.0/">77</c:Yaw>'
                '<c:Pitch xmlns:c="http://pix4d.com/camera/1.0/"> -90 </c:Pitch>'
                '<c:Roll xmlns:c="http://pix4d.com/camera/1.0/">0</c:Roll></rdf:Description>',
            )
            .encode(),
            77.0,
        ),
    ],
)
def test_other_sets_of_angles(tmp_path: Path, xmp: bytes, yaw_deg: float) -> None:
    (photo,) = list_photos(write_photo(tmp_path / "a.jpg", xmp=xmp))
    expected = Quaternion.from_euler(0.0, -math.pi / 2, math.radians(yaw_deg))
    assert photo.pose.attitude == pytest.approx(expected)


def test_photos_are_in_the_order_of_exposure_then_of_name(tmp_path: Path) -> None:
    write_photo(tmp_path / "a.jpg", taken="2016:06:23 16:32:06")
    write_photo(tmp_path / "c.jpg", taken="2016:06:23 16:31:59")
    write_photo(tmp_path / "b.jpeg", taken="2016:06:23 16:32:06", film_mm=None)
    write_photo(tmp_path / "d.jpg", taken="2016:06:23 16:33:00", film_mm=0)
    (tmp_path / "LICENSE").write_text("no photo")
    photos = list_photos(tmp_path)
    assert [p.path.name for p in photos] == ["c.jpg", "a.jpg", "b.jpeg", "d.jpg"]
    assert [p.taken_s for p in photos] == [0.0, 7.0, 7.0, 61.0]
    assert photos[2].hfov_rad is photos[3].hfov_rad is None


@pytest.mark.parametrize(
    ("photo", "blamed"),
    [
        ({"gps": {}}, "no geotag: EXIF GPSLatitude is missing"),
        ({"gps": {1: "N", 2: (46.0, 50.0, 0.0)}}, "EXIF GPSLongitude is missing"),
        ({"gps": {1: "N", 2: (146.0, 50.0, 0.0), 3: "E", 4: (0.0, 0.0, 0.0)}}, "not a place"),
        ({"gps": {1: "E", 2: (46.0, 50.0, 0.0), 3: "E", 4: (0.0, 0.0, 0.0)}}, "not a place"),
        ({"xmp": dji(RelativeAltitude=None)}, "RelativeAltitude is missing.*exiftool"),
        ({"xmp": dji(RelativeAltitude="high")}, "RelativeAltitude is 'high'"),
        ({"xmp": dji(GimbalPitchDegree="nan")}, "GimbalPitchDegree is 'nan'"),
        ({"xmp": dji(GimbalPitchDegree=None)}, "GimbalPitchDegree"),
        ({"xmp": dji(GimbalYawDegree=None, FlightYawDegree=None)}, "GimbalYawDegree"),
        ({"xmp": b"<x:xmpmeta"}, "not well-formed"),
        ({"orientation": 3}, "Orientation is 3"),
        ({"taken": None}, "DateTimeOriginal is missing"),
        ({"taken": "yesterday"}, "DateTimeOriginal is 'yesterday'"),
    ],
)
def test_what_is_missing_is_named_with_the_file(
    tmp_path: Path, photo: dict[str, object], blamed: str
) -> None:
    write_photo(tmp_path / "bad.jpg", **photo)  # type: ignore[arg-type]
    with pytest.raises(ImageError, match=f"(?s)bad.jpg.*{blamed}"):
        list_photos(tmp_path)


def test_folders_without_photos(tmp_path: Path) -> None:
    with pytest.raises(ImageError, match="no JPEG"):
        list_photos(tmp_path)
    with pytest.raises(ImageError, match="no such file"):
        list_photos(tmp_path / "nowhere")
    (tmp_path / "a.jpg").write_bytes(b"not a picture")
    with pytest.raises(ImageError, match=r"a\.jpg: not a readable picture"):
        list_photos(tmp_path)


def jpeg_bytes() -> bytes:
    rng = np.random.default_rng(2)
    picture = Image.fromarray(rng.integers(0, 256, (120, 160, 3), dtype=np.uint8))
    out = io.BytesIO()
    picture.save(out, "JPEG", quality=90)
    return out.getvalue()


def test_read_image_is_blue_green_red() -> None:
    out = io.BytesIO()
    Image.new("RGB", (4, 2), (10, 120, 240)).save(out, "PNG")
    image = read_image(out.getvalue(), "p.png")
    assert image.dtype == np.uint8
    assert image.shape == (2, 4, 3)
    assert image[0, 0].tolist() == [240, 120, 10]


@pytest.mark.parametrize("part", [0.0, 0.01, 0.3, 0.7, 0.95])
def test_a_truncated_jpeg_is_refused(part: float) -> None:
    data = jpeg_bytes()
    cut = data[: int(len(data) * part)]
    with pytest.raises(ImageError, match=r"frame7\.jpg: not a readable picture"):
        read_image(cut, "frame7.jpg")


def test_any_damage_is_an_image_error_or_a_picture(tmp_path: Path) -> None:
    """Bytes of the head overwritten: nothing but ImageError may come out."""
    data = bytearray(write_photo(tmp_path / "a.jpg").read_bytes())
    rng = np.random.default_rng(11)
    refused = 0
    for _ in range(300):
        bad = bytearray(data)
        for at in rng.integers(2, len(bad), 6):
            bad[int(at)] = int(rng.integers(0, 256))
        (tmp_path / "a.jpg").write_bytes(bad)
        try:
            list_photos(tmp_path)
            read_image(bytes(bad), "a.jpg")
        except ImageError:
            refused += 1
    assert 0 < refused < 300


# --- real photographs --------------------------------------------------------------------------
needs_real = pytest.mark.skipif(not REAL.is_dir(), reason=f"no photographs in {REAL}")


@needs_real
def test_real_tags() -> None:
    photos = list_photos(REAL)
    assert [p.path.stem for p in photos] == [f"DJI_00{k}" for k in range(18, 36)]
    assert photos[-1].taken_s == 124.0
    assert all(39.0 < p.pose.height_m < 41.0 for p in photos)


@needs_real
def test_real_photographs_agree_on_the_ground_once_upright() -> None:
    """Those of the second leg are stored upside down, which their tags do not say."""
    photos = [p for p in list_photos(REAL) if p.path.stem[-2:] in ("24", "25", "33", "34")]
    grid = Grid.at(photos[0].pose.position, 4.0)
    frames = []
    for photo in photos:
        full = read_image(photo.path.read_bytes(), photo.path.name)
        image = cv2.resize(full, (500, 281), interpolation=cv2.INTER_AREA).astype(np.uint8)
        assert photo.hfov_rad is not None
        frames.append(Frame(image, photo.pose, photo.taken_s, Camera(photo.hfov_rad, 500, 281)))
    turned = upside_down(frames, grid)
    assert turned == (True, True, False, False)
    upright = [
        Frame(np.ascontiguousarray(f.image[::-1, ::-1]), f.pose, f.t_s, f.camera) if t else f
        for f, t in zip(frames, turned, strict=True)
    ]
    assert ground_offset_m(upright[0], upright[3], grid) < 3.0
    assert ground_offset_m(upright[1], upright[2], grid) < 3.0


def ground_offset_m(first: Frame, second: Frame, grid: Grid) -> float:
    """How far the second must be moved over ground to match 16 m by 16 m of the first."""
    places = [grid.fixed(f.pose.position) for f in (first, second)]
    middle = [(a + b) / 2 for a, b in zip(*places, strict=True)]

    def ground(frame: Frame, half_m: float) -> np.ndarray:
        """North up, five pixels a metre."""
        size = round(10 * half_m)
        to_ground = np.array(
            [[0.2, 0, middle[0] - half_m], [0, -0.2, middle[1] + half_m], [0, 0, 1.0]]
        )
        matrix = frame.camera.homography(frame.pose, grid, frame.t_s) @ to_ground
        gray = cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY)
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        return cv2.warpPerspective(gray, matrix, (size, size), flags=flags)

    found = cv2.matchTemplate(ground(second, 14.0), ground(first, 8.0), cv2.TM_CCOEFF_NORMED)
    row, column = np.unravel_index(np.argmax(found), found.shape)
    assert found[row, column] > 0.6
    return math.hypot(row - 30, column - 30) / 5.0
