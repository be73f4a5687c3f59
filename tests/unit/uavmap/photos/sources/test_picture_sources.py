"""Every kind of source gives the same kind of record; the tests write each source."""

from __future__ import annotations

import json
import math
import shutil
import struct
import threading
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import ImageError
from missions.units import LatLon, Pose, Quaternion
from tests.support.photographs import write_photo
from tests.unit.uavmap.photos.test_replay import field_text, shot
from uavmap.journal.kept_frames import WAITING, FrameKeeper, KeptFrame, read_kept
from uavmap.output.facts.flown_mission import BOUNDARY_FILE
from uavmap.photos.sources.inventory import gather, open_source
from uavmap.photos.sources.photo_file import eight_bits
from uavmap.photos.sources.photo_folder import read_geo_file
from uavmap.photos.sources.picture_record import Picture, Placed, Refused, credible
from uavmap.photos.sources.video import parse_srt, read_tlog
from uavmap.ui.cli import main

LOG = Path(__file__).resolve().parents[5] / "../shared/data/arducopter/flight-4.6.tlog"
RNG = np.random.default_rng(5)
SRT = """\
{n}
00:00:{n:02},000 --> 00:00:{n:02},500
<font size="28">FrameCnt: {n}, DiffTime: 33ms
2024-05-01 10:11:12.123
[iso: 100] [latitude: 46.8{n:02}] [longitude: -91.99] [rel_alt: 40.100 abs_alt: 198.600] \
[gb_yaw: -15.0 gb_pitch: -90.0 gb_roll: 0.0] [focal_len: 24.00] </font>

"""


def jpegs(folder: Path) -> Path:
    shot(folder / "a.jpg", 1)
    (folder / "b").mkdir()
    shot(folder / "b" / "a.JPEG", 2)
    return folder


def pngs_and_tiffs(folder: Path) -> Path:
    Image.fromarray(RNG.integers(0, 256, (40, 64, 3), dtype=np.uint8)).save(folder / "a.png")
    Image.fromarray(RNG.integers(0, 256, (40, 64), dtype=np.uint8)).save(folder / "b.tif")
    cv2.imwrite(str(folder / "c.tif"), RNG.integers(0, 65536, (40, 64, 3), dtype=np.uint16))
    cv2.imwrite(str(folder / "d.tiff"), RNG.integers(7000, 7600, (40, 64), dtype=np.uint16))
    cv2.imwrite(str(folder / "e.tiff"), RNG.normal(20.0, 9.0, (40, 64)).astype(np.float32))
    return folder


def video(folder: Path) -> Path:
    path = folder / "DJI_0001.MP4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 10.0, (64, 48))
    for number in range(31):
        writer.write(np.full((48, 64, 3), 8 * number, np.uint8))
    writer.release()
    (folder / "DJI_0001.SRT").write_text("".join(SRT.format(n=n) for n in range(4)))
    return path


def kept(folder: Path) -> Path:
    (folder / "frames").mkdir()
    shot(folder / "frames" / "1-000012.500.jpg", 1)
    (folder / "frames" / "poses.csv").write_text(
        "frame,vehicle,t_s,lat_deg,lon_deg,height_m,qw,qx,qy,qz,hfov_deg\n"
        "1-000012.500.jpg,1,12.5,46.1,7.2,12.0,0.7071068,0.0,-0.7071068,0.0,80.0\n"
        "nonsense,1\n"
    )
    return folder


KINDS: dict[str, tuple[Callable[[Path], Path], int]] = {
    "photographs": (jpegs, 2),
    "one photograph": (lambda folder: jpegs(folder) / "a.jpg", 1),
    "PNG and TIFF": (pngs_and_tiffs, 5),
    "a video": (video, 4),
    "kept frames": (kept, 1),
}


@pytest.mark.parametrize("kind", KINDS)
def test_source_keeps_the_contract(kind: str, tmp_path: Path) -> None:
    make, count = KINDS[kind]
    source = open_source(make(tmp_path))
    found = [picture for picture in source.pictures() if isinstance(picture, Picture)]
    assert len(found) == count
    assert len({picture.name for picture in found}) == count
    assert len({picture.content.digest() for picture in found}) == count
    again = [p for p in source.pictures() if isinstance(p, Picture)]
    assert [(p.name, p.position, p.taken_s) for p in again] == [
        (p.name, p.position, p.taken_s) for p in found
    ]
    for picture in reversed(found):  # in any order
        whole = picture.content.decode(10_000)
        assert whole.shape[:2] == (picture.height_px, picture.width_px)
        assert whole.dtype in (np.uint8, np.uint16)
        small = picture.content.decode(32)
        assert small.shape[1] == 32
        assert small.dtype == whole.dtype
        assert picture.content.decode(32).tobytes() == small.tobytes()
        assert eight_bits(small).shape == (small.shape[0], 32, 3)
    assert isinstance(source.left_out(), tuple)


def test_video_is_read_with_its_captions(tmp_path: Path) -> None:
    path = video(tmp_path)
    pictures = gather(open_source(path)).pictures
    assert [picture.name for picture in pictures] == [f"DJI_0001.MP4#{n}" for n in (0, 10, 20, 30)]
    levels = [int(picture.content.decode(64).mean()) for picture in pictures]
    assert levels == pytest.approx([0, 80, 160, 240], abs=6)
    placed = [entry for entry in credible(pictures) if isinstance(entry, Placed)]
    assert [entry.pose.position.lat_deg for entry in placed] == [46.8, 46.801, 46.802, 46.803]
    assert placed[0].pose.height_m == 40.1
    lens = pictures[0].lens
    assert pictures[0].yaw_deg == (345.0, 5.0)
    assert lens is not None
    assert lens.hfov_deg == pytest.approx(71.6, abs=0.1)
    for captions in ("", "no captions", "999999999999:00:00,0 --> "):
        (tmp_path / "DJI_0001.SRT").write_text(captions)
        with pytest.raises(ImageError, match=r"DJI_0001\.SRT: no positions; was the recording"):
            open_source(path)
    (tmp_path / "DJI_0001.SRT").unlink()
    with pytest.raises(ImageError, match=r"no DJI_0001\.SRT"):
        open_source(path)


def test_video_is_read_with_a_telemetry_log(tmp_path: Path) -> None:
    path = video(tmp_path)
    (tmp_path / "DJI_0001.SRT").unlink()
    codec, start_s, log = mav.MAVLink(None, srcSystem=1, srcComponent=1), 1_700_000_000.0, b"\x07"
    for number in range(4):
        place = (int(46.8e7) + number * 1000, int(7.2e7), 440_000, 40_000)
        for message in (
            codec.attitude_encode(0, 0.0, 0.0, math.radians(-15.0), 0.0, 0.0, 0.0),
            codec.mount_orientation_encode(0, 0.0, -88.0, 0.0),
            codec.global_position_int_encode(0, *place, 0, 0, 0, 9000),
        ):
            log += struct.pack(">Q", round((start_s + number) * 1e6)) + message.pack(codec)
        log += b"noise \xfd\xfe"
    (tmp_path / "DJI_0001.tlog").write_bytes(log)
    with pytest.raises(ImageError, match="--video-start"):
        open_source(path)
    pictures = gather(open_source(path, start_s)).pictures
    places = [picture.position.lat_deg for picture in pictures if picture.position]
    assert places == pytest.approx([46.8, 46.8001, 46.8002, 46.8003], abs=1e-6)
    first = pictures[0]
    assert (first.height_m, first.pitch_deg) == ((40.0, 2.0), (-88.0, 1.0))
    assert first.yaw_deg == pytest.approx((0.0, 5.0))  # the mount's own angle, stated as absolute
    late = open_source(path, start_s - 3600.0).pictures()
    assert all(isinstance(found, Refused) and "no telemetry" in found.reason for found in late)


@pytest.mark.skipif(not LOG.is_file(), reason=f"no {LOG}")
def test_log_of_an_autopilot_has_moments() -> None:
    moments = read_tlog(LOG)
    assert len(moments) > 10
    assert max(moment.height_m or 0.0 for moment in moments) > 2.0
    assert all(moment.yaw_deg is not None for moment in moments[5:])


OLD = "1\n00:00:01,000 --> 00:00:02,000\n"


@pytest.mark.parametrize(
    ("text", "height_m"),
    [
        ("HOME(149.0251,-20.2532) 2017.08.05 14:11:51\nGPS(149.02,-20.25,16) BAROMETER:1.9", 1.9),
        ("F/2.8, SS 206, ISO 150, GPS (149.02, -20.25, 19), D 24.26m, H 6.00m, H.S 0.00m/s", 6.0),
        ("[latitude : -20.25] [longtitude : 149.02] [altitude: 99.0]", None),
        ("[latitude: -20.25] [longitude: 149.02] [rel_alt: 1.300 abs_alt: 132.860]", 1.3),
    ],
)
def test_captions_of_several_models_are_read(text: str, height_m: float | None) -> None:
    (moment,) = parse_srt(OLD + text)
    assert moment.position == LatLon(-20.25, 149.02)
    assert moment.height_m == height_m


def test_kept_frames_bring_their_poses(tmp_path: Path) -> None:
    source = open_source(kept(tmp_path))
    (picture,) = source.pictures()
    assert isinstance(picture, Picture)
    assert picture.position == LatLon(46.1, 7.2)
    yaw, pitch, lens = picture.yaw_deg, picture.pitch_deg, picture.lens
    assert yaw is not None
    assert pitch is not None
    assert lens is not None
    assert (round(yaw.value) % 360, round(pitch.value), round(lens.hfov_deg)) == (0, -90, 80)
    assert source.left_out() == ("line 3 of poses.csv is damaged",)


def test_flight_keeps_its_frames_for_a_replay(tmp_path: Path) -> None:
    """Detector, pictures and poses are those of the flight, and so are the cells."""
    mission = str(Path(__file__).resolve().parents[4] / "data" / "speck.toml")
    flown, again = tmp_path / "flown", tmp_path / "again"
    arguments = ["--mission", mission, "--out", str(again)]
    assert main(["fly", mission, "--sim", "--keep-frames", "--out", str(flown)]) == 0
    assert main(["replay", str(flown), *arguments]) == 0

    def region(folder: Path) -> set[str]:
        features = json.loads((folder / "map.geojson").read_text("utf-8"))["features"]
        return {f["id"] for f in features if f["properties"].get("state") == "explored"}

    assert region(again) == region(flown)
    found = [json.loads((folder / BOUNDARY_FILE).read_text("utf-8")) for folder in (flown, again)]
    areas = [each["features"][0]["properties"]["area_m2"] for each in found]
    assert areas[0] > 0.0
    assert areas[1] == pytest.approx(areas[0], rel=0.1)  # poses are refined in a replay
    report = (flown / "report.html").read_text("utf-8")
    assert "boundary by pixels" in report  # written again once the boundary is known
    assert report.count('src="data:image/jpeg') == 8 + 1  # along the boundary, and judged.jpg
    assert main(["resume", str(again)]) == 2


def frame_at(t_s: float) -> KeptFrame:
    return KeptFrame("", 1, t_s, Pose(LatLon(46.1, 7.2), 12.0, Quaternion(1.0, 0, 0, 0)), 80.0)


@pytest.mark.parametrize("aside", [False, True])
def test_picture_is_kept_once_and_a_refusal_reported_once(aside: bool, tmp_path: Path) -> None:
    lines: list[str] = []

    def keep() -> None:
        with FrameKeeper(tmp_path, lines.append, aside=aside) as keeper:
            for t_s in (1.0, 2.0):
                keeper.keep(frame_at(t_s), b"a picture")

    keep()
    keep()  # the same flight, resumed
    assert [f.t_s for f in read_kept(tmp_path) if isinstance(f, KeptFrame)] == [1.0, 2.0]
    assert lines == []
    shutil.rmtree(tmp_path / "frames")
    (tmp_path / "frames").write_text("in the way")
    keep()
    assert len(lines) == 1
    assert lines[0].startswith(f"pictures are kept no longer: {tmp_path / 'frames'}")


def test_disk_that_hangs_delays_no_flight(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lines: list[str] = []
    free = threading.Event()
    write_bytes = Path.write_bytes

    def slowly(self: Path, data: bytes) -> int:
        free.wait()
        return write_bytes(self, data)

    monkeypatch.setattr(Path, "write_bytes", slowly)
    with FrameKeeper(tmp_path, lines.append, aside=True) as keeper:
        for number in range(WAITING + 7):
            keeper.keep(frame_at(float(number)), b"a picture")
        free.set()
    assert len(list(read_kept(tmp_path))) == WAITING
    assert lines[0].startswith("7 pictures were not kept: ")


# --- geo.txt -------------------------------------------------------------------------------------
def test_geo_txt_places_pictures_without_tags(tmp_path: Path) -> None:
    photos = tmp_path / "photos"
    photos.mkdir()
    for seed in range(2):
        shot(photos / f"{seed}.jpg", seed, gps={})
    (photos / "geo.txt").write_text(
        "EPSG:4326\n0.jpg 7.25 46.5 440.0 30 2.0 0 0.5 0.8 label\n"
        "1.jpg 7.26 46.5 441\n2.jpg 7 46\nwrong\n# a comment\n"
    )
    source = open_source(photos)
    first, second = (p for p in source.pictures() if isinstance(p, Picture))
    assert first.position == LatLon(46.5, 7.25)
    assert first.position_sigma_m == 0.5
    told = (first.amsl_m, first.yaw_deg, first.pitch_deg)
    assert told == ((440.0, 0.8), (30.0, 5.0), (-88.0, 5.0))
    assert second.position == LatLon(46.5, 7.26)
    assert second.yaw_deg == (0.0, 5.0)  # of the tags
    assert source.left_out() == (
        "1 lines of geo.txt are no positions (line 5)",
        "1 lines of geo.txt name no picture of the folder",
    )


@pytest.mark.parametrize(
    "header", ["WGS84 UTM 32N", "EPSG:32632", "+proj=utm +zone=32 +datum=WGS84"]
)
def test_geo_txt_in_metres_is_read(header: str, tmp_path: Path) -> None:
    (tmp_path / "geo.txt").write_text(f"{header}\na.jpg 500000 5150000 0 0 0 0\n")
    entry = read_geo_file(tmp_path / "geo.txt").entries["a.jpg"]
    assert entry.position.lon_deg == pytest.approx(9.0)
    assert entry.position.lat_deg == pytest.approx(46.503, abs=1e-3)
    assert entry.angles_deg is None  # 0 0 0 is "not known"


def test_geo_txt_with_photogrammetric_angles_is_read(tmp_path: Path) -> None:
    text = "EPSG:4326\n# image x y z omega phi kappa\na.jpg 7 46 0 0 0 -90\nb.jpg 7 46 0 20 0 0\n"
    (tmp_path / "geo.txt").write_text(text)
    entries = read_geo_file(tmp_path / "geo.txt").entries
    assert entries["a.jpg"].angles_deg == pytest.approx((90.0, -90.0, 0.0))
    # turned about the east by 20 degrees: it points north, and so far from straight down
    assert entries["b.jpg"].angles_deg == pytest.approx((0.0, -70.0, 0.0))


def test_geo_txt_without_a_coordinate_system_is_named(tmp_path: Path) -> None:
    (tmp_path / "geo.txt").write_text("a.jpg 7 46\n")
    with pytest.raises(ImageError, match=r"geo\.txt: line 1 .*expected the coordinate system"):
        open_source(tmp_path)


# --- look ----------------------------------------------------------------------------------------
def test_look_shows_the_result_of_the_detector(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mission = tmp_path / "m.toml"
    mission.write_text(field_text())
    image = shot(tmp_path / "a.jpg", 1, (16.0, 12.0))
    out = tmp_path / "seen.png"
    assert main(["look", str(image), "--mission", str(mission), "--json", "--out", str(out)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["height_m"] == 40.0
    assert len(found["footprint"]) == 4
    assert math.isclose(found["footprint"][0][0], found["position"][0], abs_tol=1e-3)
    regions = {(cell["column"], cell["row"]) for cell in found["cells"] if cell["roi"]}
    assert (4, 3) in regions  # 16 m east, 12 m north
    assert len(regions) < len(found["cells"]) / 2
    with Image.open(out) as drawn:
        assert drawn.width == 640
    assert main(["look", str(image), "--out", str(out)]) == 0
    assert "cells are region" in capsys.readouterr().out
    write_photo(tmp_path / "b.jpg", gps={})
    assert main(["look", str(tmp_path / "b.jpg"), "--out", str(out)]) == 2
