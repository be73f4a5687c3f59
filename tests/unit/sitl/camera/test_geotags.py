from __future__ import annotations

import io
import json
import math
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import ExifTags, Image
from pymavlink.dialects.v20 import ardupilotmega as mav
from shapely.geometry import Polygon, shape

from missions.geo.geodesy import LocalPlane
from missions.units import LatLon, Quaternion
from sitl.camera.exif import EPOCH_UTC_S, Geotag, camera_angles, tagged
from sitl.camera.pinhole import CameraSpec
from sitl.camera.render import render
from tests.unit.sitl.conftest import Client
from uavmap.load.mission_source import load
from uavmap.photos.sources.inventory import gather, open_source
from uavmap.photos.sources.picture_record import credible
from uavmap.runner.simulation import make_vehicles
from uavmap.ui.cli import main

MISSION = Path(__file__).resolve().parents[3] / "data" / "speck.toml"
CAPTURE = mav.MAV_CMD_IMAGE_START_CAPTURE
PLAIN = cv2.imencode(".jpg", np.full((48, 64, 3), 90, np.uint8))[1].tobytes()


def angle_between(a, b):
    return 2.0 * math.acos(min(1.0, abs(sum(p * q for p, q in zip(a, b, strict=True)))))


def a_tag(**changes):
    values = {
        "position": LatLon(-33.8567844, 151.2152967),
        "amsl_m": 31.25,
        "height_m": 12.5,
        "camera": Quaternion.from_euler(0.0, -math.pi / 2, 0.7),
        "body_rad": (0.02, -0.1, 0.7),
        "taken_s": 61.25,
        "hfov_rad": math.radians(70.0),
        "width_px": 64,
    }
    return Geotag(**{**values, **changes})


def test_every_tag_is_where_a_reader_looks_for_it():
    with Image.open(io.BytesIO(tagged(PLAIN, a_tag(amsl_m=-3.5)))) as picture:
        exif, xmp = picture.getexif(), picture.info["xmp"].decode()
    gps, detail = exif.get_ifd(ExifTags.IFD.GPSInfo), exif.get_ifd(ExifTags.IFD.Exif)
    assert exif[ExifTags.Base.Make] == "uavmap"
    assert exif[ExifTags.Base.Model] == "simulated nadir camera"
    assert gps[ExifTags.GPS.GPSLatitudeRef] == "S"
    assert gps[ExifTags.GPS.GPSLongitudeRef] == "E"
    assert gps[ExifTags.GPS.GPSAltitudeRef] == b"\x01"
    assert float(gps[ExifTags.GPS.GPSAltitude]) == pytest.approx(3.5)
    assert detail[ExifTags.Base.DateTimeOriginal] == "2020:01:01 00:01:01"
    assert detail[ExifTags.Base.SubsecTimeOriginal] == "250"
    assert detail[ExifTags.Base.FocalLengthIn35mmFilm] == 26
    for text in (
        'AbsoluteAltitude="-3.50"', 'RelativeAltitude="+12.50"', 'GimbalPitchDegree="-90.00"',
        'GimbalYawDegree="+40.11"', 'GimbalRollDegree="+0.00"', 'FlightYawDegree="+40.11"',
        'FlightPitchDegree="-5.73"', 'FlightRollDegree="+1.15"',
    ):  # fmt: skip
        assert f"drone-dji:{text}" in xmp


def test_the_pixels_are_those_without_tags(flying):
    flying.command(CAPTURE, 0, 0, 1, 1)
    flying.run(0.2)
    (captured,) = flying.seen("CAMERA_IMAGE_CAPTURED")
    data = flying.vehicle.image(captured.file_url)
    assert data == flying.vehicle.image(captured.file_url)
    exposure = flying.vehicle._payload._exposures[captured.file_url]
    bare = render(flying.vehicle.world, flying.vehicle.spec.camera, exposure.shot)
    assert b"drone-dji" in data
    assert b"drone-dji" not in bare
    assert np.array_equal(
        *(cv2.imdecode(np.frombuffer(d, np.uint8), cv2.IMREAD_COLOR) for d in (data, bare))
    )


@given(
    st.floats(-math.pi, math.pi), st.floats(-math.pi / 2, math.pi / 2), st.floats(-math.pi, math.pi)
)
def test_the_angles_are_those_of_the_attitude(roll, pitch, yaw):
    attitude = Quaternion.from_euler(roll, pitch, yaw)
    yaw, pitch, roll = camera_angles(attitude)
    assert angle_between(attitude, Quaternion.from_euler(roll, pitch, yaw)) < 1e-4


@given(st.floats(-80.0, 84.0), st.floats(-180.0, 180.0), st.floats(0.0, 1e6))
def test_places_and_times_survive(tmp_path_factory, lat_deg, lon_deg, taken_s):
    tag = a_tag(position=LatLon(lat_deg, lon_deg), taken_s=taken_s)
    data = tagged(PLAIN, tag)
    path = tmp_path_factory.getbasetemp() / "tagged.jpg"
    path.write_bytes(data)
    (photo,) = gather(open_source(path)).pictures
    assert photo.position.lat_deg == pytest.approx(lat_deg, abs=2e-9)
    assert photo.position.lon_deg == pytest.approx(lon_deg, abs=2e-9)


def test_tags_in_bytes_that_are_no_jpeg_are_refused():
    with pytest.raises(ValueError, match="only a JPEG"):
        tagged(b"\x89PNG\r\n", a_tag())


def test_tags_are_cheap():
    data, tag = bytes(PLAIN), a_tag()
    best_s = math.inf
    for _ in range(5):
        start_s = time.perf_counter()
        for _ in range(50):
            tagged(data, tag)
        best_s = min(best_s, (time.perf_counter() - start_s) / 50)
    assert best_s < 0.3e-3


@pytest.mark.parametrize("fixed", [True, False])
def test_a_folder_of_saved_pictures_is_a_set_of_photographs(make_client, tmp_path, fixed):
    """Fly a small grid, save the pictures, and read the poses that were announced."""
    client = make_client(
        world={"wind_speed_m_s": 4.0, "gust_m_s": 1.0},
        gps_sigma_m=0.3,
        camera=CameraSpec(width_px=160, height_px=120, fixed=fixed),
    )
    client.take_off(10.0)
    for east, north in ((0, 0), (8, 0), (8, 8), (0, 8)):
        assert client.reposition(east, north, 10.0) == 0
        client.run(1.5)
        assert client.result(CAPTURE, 0, 0, 1, 0) == 0
        client.run(3.0)
    announced = client.seen("CAMERA_IMAGE_CAPTURED")
    assert len(announced) == 4
    for message in announced:
        data = client.vehicle.image(message.file_url)
        (tmp_path / f"{message.image_index:04d}.jpg").write_bytes(data)
    photos = credible(gather(open_source(tmp_path)).pictures)
    assert [p.picture.name for p in photos] == ["0000.jpg", "0001.jpg", "0002.jpg", "0003.jpg"]
    tilts = []
    for photo, message in zip(photos, announced, strict=True):
        assert (photo.picture.width_px, photo.picture.height_px) == (160, 120)
        assert photo.taken_s == pytest.approx(
            (message.time_boot_ms - announced[0].time_boot_ms) / 1000.0, abs=1e-3
        )
        plane = LocalPlane(LatLon(message.lat / 1e7, message.lon / 1e7))
        assert math.hypot(*plane.to_plane(photo.pose.position)) < 0.001
        assert photo.pose.height_m == pytest.approx(message.relative_alt / 1000.0, abs=0.006)
        assert math.degrees(angle_between(photo.pose.attitude, message.q)) < 0.03
        assert photo.picture.lens.hfov_deg == pytest.approx(70.0, abs=0.01)
        _, pitch, _ = camera_angles(photo.pose.attitude)
        tilts.append(90.0 + math.degrees(pitch))
    assert (max(tilts) > 3.0) is fixed  # in the wind a fixed camera looks aside


def test_camera_feedback_reports_each_picture(make_client):
    client = make_client(home_yaw_deg=90.0)
    client.take_off(8.0)
    client.command(CAPTURE, 0, 0.5, 3, 0)
    client.run(3.0)
    captured, feedback = client.seen("CAMERA_IMAGE_CAPTURED"), client.seen("CAMERA_FEEDBACK")
    assert len(captured) == len(feedback) == 3
    for i, (a, b) in enumerate(zip(captured, feedback, strict=True)):
        assert (a.get_srcComponent(), b.get_srcComponent()) == (100, 1)
        assert (a.lat, a.lon) == (b.lat, b.lng)
        assert b.alt_msl == pytest.approx(a.alt / 1000.0, abs=1e-3)
        assert b.alt_rel == pytest.approx(a.relative_alt / 1000.0, abs=1e-3)
        assert b.yaw == pytest.approx(90.0, abs=1.0)
        assert (b.img_idx, b.completed_captures) == (i + 1, i + 1)
        seconds = b.time_usec / 1e6 - EPOCH_UTC_S
        assert seconds == pytest.approx(a.time_boot_ms / 1000.0, abs=1e-3)


def test_pictures_of_a_lawnmower_become_the_map_of_the_region(tmp_path, capsys):
    """Pictures pass from the simulator over files to `uavmap replay`, without common code."""
    mission = load(str(MISSION))
    (vehicle,) = make_vehicles(mission, 3)
    client = Client(vehicle)
    client.take_off(12.0)
    box = [vehicle.world.plane.to_plane(LatLon(*corner)) for corner in mission.search.box]
    west, east = min(e for e, _ in box) - 2.0, max(e for e, _ in box) + 2.0
    south, north = min(n for _, n in box) - 2.0, max(n for _, n in box) + 2.0
    photos = tmp_path / "photos"
    photos.mkdir()
    for lane in range(4):
        n = south + lane * (north - south) / 3
        first, last = (west, east) if lane % 2 == 0 else (east, west)
        assert client.reposition(first, n, 12.0) == 0
        client.result(mav.MAV_CMD_DO_CHANGE_SPEED, 1, 3.0)  # the first target would undo it
        client.run(5.0)
        assert client.result(CAPTURE, 0, 0.5, 0, 0) == 0
        assert client.reposition(last, n, 12.0) == 0
        client.run(9.0)
        assert client.result(mav.MAV_CMD_IMAGE_STOP_CAPTURE) == 0
    for message in client.seen("CAMERA_IMAGE_CAPTURED"):
        data = vehicle.image(message.file_url)
        (photos / f"{message.image_index:04d}.jpg").write_bytes(data)
    out = tmp_path / "map"
    # as tagged: the test compares the tags with the truth
    command = ["replay", str(photos), "--mission", str(MISSION), "--refine", "off"]
    code = main([*command, "--json", "--out", str(out)])
    summary = json.loads(capsys.readouterr().out)
    assert code == 0
    assert summary["photographs"] == len(list(photos.iterdir())) > 40
    features = json.loads((out / "map.geojson").read_text("utf-8"))["features"]
    (found,) = (f for f in features if f["properties"]["kind"] == "outline")
    (truth,) = mission.sim.roi
    truth_deg = Polygon([(lon, lat) for lat, lon in truth.polygon])
    found_deg = shape(found["geometry"])
    covered = found_deg.intersection(truth_deg).area / truth_deg.area
    too_much = found_deg.difference(truth_deg.buffer(6.0 / 76_000.0)).area / truth_deg.area
    # cells of 4 m, over a region that is 16 m wide
    assert covered > 0.85
    assert too_much < 0.05
