"""Geotags and pixels of photographs: written here with Pillow, and real ones if present."""

from __future__ import annotations

import io
import math
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from missions.errors import ImageError
from missions.geo.grid import Grid
from missions.units import Quaternion
from tests.support.photographs import DJI, dji, write_photo
from tests.unit.vision.scene import upside_down
from uavmap.base.image_files import decoded
from uavmap.photos.sources.inventory import gather, open_source
from uavmap.photos.sources.photo_file import eight_bits
from uavmap.photos.sources.photo_tags import tags_of
from uavmap.photos.sources.picture_record import Picture, Placed, Refused, credible
from vision.camera import Camera, rotation
from vision.projection import Frame


def tagged(path: Path) -> tuple[Picture, ...]:
    return gather(open_source(path)).pictures


def placed(path: Path) -> list[Placed]:
    entries = credible(tagged(path))
    assert all(isinstance(entry, Placed) for entry in entries), entries
    return [entry for entry in entries if isinstance(entry, Placed)]


REAL = Path(__file__).resolve().parents[5] / "../shared/data/brighton_beach"


def test_tags_of_a_photo_give_its_pose(tmp_path: Path) -> None:
    (photo,) = placed(write_photo(tmp_path / "a.JPG"))
    assert photo.pose.position.lat_deg == pytest.approx(46 + 50 / 60 + 33.3855 / 3600)
    assert photo.pose.position.lon_deg == pytest.approx(-(91 + 59 / 60 + 40.4156 / 3600))
    assert photo.pose.height_m == 39.8
    assert (photo.picture.width_px, photo.picture.height_px, photo.taken_s) == (64, 36, 0.0)
    assert photo.picture.lens is not None
    # 20 mm on a diagonal of 43.27 mm; a picture of 16:9 is cut from a sensor of 4:3
    diagonal_px = math.hypot(64, 48)
    assert photo.picture.lens.fx_px == pytest.approx(20.0 * diagonal_px / math.hypot(36, 24))
    forward, _, down = rotation(photo.pose.attitude).T
    assert forward == pytest.approx([0, 0, 1], abs=1e-9)
    up = math.sqrt(0.5)  # the upper edge lies to the north-east
    assert -down == pytest.approx([up, up, 0], abs=1e-9)


def test_tags_with_southern_and_eastern_letters_are_read(tmp_path: Path) -> None:
    gps = {1: "S", 2: (33.0, 30.0, 0.0), 3: "E", 4: (151.0, 15.0, 0.0)}
    (photo,) = placed(write_photo(tmp_path / "a.jpg", gps=gps))
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
def test_tags_with_other_sets_of_angles_are_read(
    tmp_path: Path, xmp: bytes, yaw_deg: float
) -> None:
    (photo,) = placed(write_photo(tmp_path / "a.jpg", xmp=xmp))
    expected = Quaternion.from_euler(0.0, -math.pi / 2, math.radians(yaw_deg))
    assert photo.pose.attitude == pytest.approx(expected)


def test_photos_are_in_the_order_of_exposure_then_of_name(tmp_path: Path) -> None:
    write_photo(tmp_path / "a.jpg", taken="2016:06:23 16:32:06")
    write_photo(tmp_path / "c.jpg", taken="2016:06:23 16:31:59")
    shadow = Image.new("RGB", (160, 120), (40, 60, 30))  # else it would be a.jpg, saved again
    write_photo(tmp_path / "b.jpeg", taken="2016:06:23 16:32:06", film_mm=None, image=shadow)
    write_photo(tmp_path / "d.jpg", taken="2016:06:23 16:33:00", film_mm=0)
    (tmp_path / "LICENSE").write_text("no photo")
    # of the same content but for their tags
    photos = placed(tmp_path)
    assert [p.picture.name for p in photos] == ["c.jpg", "a.jpg", "b.jpeg", "d.jpg"]
    assert [p.taken_s for p in photos] == [0.0, 7.0, 7.0, 61.0]
    assert photos[2].picture.lens is photos[3].picture.lens is None


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
    ],
)
def test_missing_tag_is_named_with_the_file(
    tmp_path: Path, photo: dict[str, object], blamed: str
) -> None:
    write_photo(tmp_path / "bad.jpg", **photo)  # type: ignore[arg-type]
    (reason,) = credible(tagged(tmp_path))
    assert isinstance(reason, str)
    assert re.search(f"(?s){blamed}", reason)


@pytest.mark.parametrize("taken", [None, "yesterday"])
def test_photo_without_a_date_comes_last(tmp_path: Path, taken: str | None) -> None:
    write_photo(tmp_path / "a.jpg", taken=taken)
    write_photo(tmp_path / "b.jpg")
    assert [p.picture.name for p in placed(tmp_path)] == ["b.jpg", "a.jpg"]
    notes = placed(tmp_path)[1].picture.notes
    assert [("yesterday" in note) for note in notes] == [True] * (taken is not None)


def test_mirrored_photo_is_refused(tmp_path: Path) -> None:
    write_photo(tmp_path / "a.jpg", orientation=5)
    (refused,) = open_source(tmp_path).pictures()
    assert isinstance(refused, Refused)
    assert "Orientation is 5" in refused.reason
    with pytest.raises(ImageError, match=r"no picture can be read: a\.jpg: "):
        tagged(tmp_path)


def test_decoded_picture_is_blue_green_red() -> None:
    out = io.BytesIO()
    Image.new("RGB", (4, 2), (10, 120, 240)).save(out, "PNG")
    image = decoded(out.getvalue(), "p.png")
    assert image.dtype == np.uint8
    assert image.shape == (2, 4, 3)
    assert image[0, 0].tolist() == [240, 120, 10]


def test_thermal_picture_is_spread_over_its_levels() -> None:
    thermal = np.linspace(7000, 7400, 4000).astype(np.uint16).reshape(40, 100)
    levels = eight_bits(thermal)
    assert levels.shape == (40, 100, 3)
    assert levels.min() == 0
    assert levels.max() == 255
    full = np.linspace(0, 65535, 4000).astype(np.uint16).reshape(40, 100)
    assert (eight_bits(full)[:, :, 0] == full >> 8).all()


# --- focal lengths -------------------------------------------------------------------------------
def lens_width_deg(exif: dict[int, object], xmp: str, size: tuple[int, int]) -> float:
    picture, tags = Image.new("RGB", size), Image.Exif()
    tags.get_ifd(0x8769).update(exif)
    picture.info["xmp"] = f'<a xmlns:d="u:d" {xmp}/>'.encode() if xmp else b""
    picture.info["exif"] = tags.tobytes()
    lens = tags_of(picture)["lens"]
    assert lens is not None
    return lens.hfov_deg


FOCAL, PLANE_X, PLANE_UNIT, FILM = 0x920A, 0xA20E, 0xA210, 0xA405


@pytest.mark.parametrize(
    ("exif", "xmp", "size", "hfov_deg"),
    [
        ({FOCAL: 5.0, PLANE_X: 64.0, PLANE_UNIT: 4}, "", (640, 480), 90.0),
        ({FOCAL: 5.0, PLANE_X: 640.0, PLANE_UNIT: 3, FILM: 99}, "", (640, 480), 90.0),
        ({FILM: 24}, "", (400, 300), 71.6),
        ({FILM: 24}, "", (600, 400), 73.7),
        ({FILM: 24}, 'd:CalibratedFocalLength="20000.0"', (400, 300), 71.6),  # of one degree
        ({}, 'd:CalibratedFocalLength="320.0"', (640, 480), 90.0),
        ({FILM: 24}, 'd:DewarpData="2022-01-01;320,320,1,-2,0.1,0,0,0,0"', (640, 480), 90.0),
        ({FILM: 24}, 'd:DewarpData="2022-01-01;1,2" d:CalibratedFocalLength="x"', (400, 300), 71.6),
    ],
)
def test_angle_of_view_is_read_from_the_tags(
    exif: dict[int, object], xmp: str, size: tuple[int, int], hfov_deg: float
) -> None:
    assert lens_width_deg(exif, xmp, size) == pytest.approx(hfov_deg, abs=0.1)


# --- real photographs --------------------------------------------------------------------------
needs_real = pytest.mark.skipif(not REAL.is_dir(), reason=f"no photographs in {REAL}")


@needs_real
def test_tags_of_real_photographs_are_read() -> None:
    photos = placed(REAL)
    assert [p.picture.name for p in photos] == [f"DJI_00{k}.JPG" for k in range(18, 36)]
    assert photos[-1].taken_s == 124.0
    assert all(39.0 < p.pose.height_m < 41.0 for p in photos)
    # 3.61 mm on a sensor 6.16 mm wide
    lens = photos[0].picture.lens
    assert lens is not None
    assert lens.hfov_deg == pytest.approx(80.9, abs=0.1)


@needs_real
def test_real_photographs_upside_down_are_found() -> None:
    """Those of the second leg are stored upside down, which their tags do not state."""
    photos = [p for p in placed(REAL) if p.picture.name[-6:-4] in ("24", "25", "33", "34")]
    grid = Grid.at(photos[0].pose.position, 4.0)
    frames = []
    for photo in photos:
        image = photo.picture.content.decode(500).astype(np.uint8)
        lens, (rows, columns) = photo.picture.lens, image.shape[:2]
        assert lens is not None
        frames.append(Frame(image, photo.pose, 0.0, Camera(lens.hfov_rad, columns, rows)))
    turned = upside_down(frames, grid)
    assert turned == (True, True, False, False)
