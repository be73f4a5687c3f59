from __future__ import annotations

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import Quaternion
from sitl.camera.pinhole import CameraSpec, Shot, ground_to_pixel
from sitl.camera.render import render
from sitl.world.ground import TILE_M
from sitl.world.world import Patch, World, WorldSpec
from tests.unit.sitl.conftest import CAMERA, LENS_M, ORIGIN, decoded


def pixel(camera, shot, east_m, north_m):
    """Return the pixel of a ground point relative to the foot point."""
    u, v, depth = ground_to_pixel(camera, shot) @ (east_m, north_m, 1.0)
    return u / depth, v / depth


def shot_at(camera, height_m, roll_deg=0.0, pitch_deg=0.0, yaw_deg=0.0, east_m=0.0, north_m=0.0):
    attitude = camera.attitude(*map(math.radians, (roll_deg, pitch_deg, yaw_deg)))
    return Shot(east_m, north_m, height_m - LENS_M, attitude, 0.0, 0)


TEN_M = 10.0 * math.tan(math.radians(10.0))  # from 10 m, 10 degrees off the vertical


# focal length 200 px, centre (199.5, 149.5), height 10 m: 20 pixels a metre at nadir
@pytest.mark.parametrize(
    ("turned", "how", "place", "expected"),
    [
        ((0.0, 0.0, 0.0), {}, (2.0, 3.0), (239.5, 89.5)),  # east is right, north is up
        ((0.0, 0.0, 90.0), {}, (2.0, 3.0), (139.5, 109.5)),  # up is east, so north is left
        ((0.0, 0.0, 180.0), {}, (2.0, 3.0), (159.5, 209.5)),
        # pitched down by 10 degrees a fixed nadir camera looks 10 degrees behind the foot point,
        # which lies ahead of the axis: towards the upper edge
        ((0.0, -10.0, 0.0), {}, (0.0, -TEN_M), (199.5, 149.5)),
        ((0.0, -10.0, 0.0), {}, (0.0, 0.0), (199.5, 149.5 - 20.0 * TEN_M)),
        ((10.0, 0.0, 0.0), {}, (-TEN_M, 0.0), (199.5, 149.5)),  # rolled to the right it looks left
        ((12.0, -9.0, 0.0), {"fixed": False}, (2.0, 3.0), (239.5, 89.5)),  # a gimbal keeps to nadir
        ((0.0, 0.0, 0.0), {"yaw_deg": 90.0}, (2.0, 3.0), (139.5, 109.5)),  # as it is mounted
    ],
)
def test_a_place_on_the_ground_falls_into_its_pixel(turned, how, place, expected):
    camera = CameraSpec(hfov_deg=90.0, width_px=400, height_px=300, **how)
    assert pixel(camera, shot_at(camera, 10.0, *turned), *place) == pytest.approx(expected)


def test_attitude_is_that_of_a_nadir_camera():
    expected = Quaternion.from_euler(0.0, -math.pi / 2, math.radians(30.0))
    assert CAMERA.attitude(0.0, 0.0, math.radians(30.0)) == pytest.approx(expected)


def test_the_corner_of_the_roi_is_where_it_should_be(square):
    world = World(WorldSpec(ORIGIN, 600.0, (square,), texture=0.0, sensor_noise=0.0, seed=1))
    # 5 m east and 4 m north of the corner: it lies 100 px left of and 80 px below the centre
    picture = decoded(render(world, CAMERA, shot_at(CAMERA, 10.0, east_m=5.0, north_m=4.0)))
    dark = picture < 137
    assert dark[:225, 105:].mean() > 0.99
    assert dark[:, :94].mean() < 0.01
    assert dark[235:, :].mean() < 0.01
    left = np.median([row.nonzero()[0].min() for row in dark[60:200]])
    low = np.median([column.nonzero()[0].max() for column in dark[:, 150:350].T])
    assert left == pytest.approx(99.5, abs=1.0)
    assert low == pytest.approx(229.5, abs=1.0)


def test_corner_in_a_tilted_picture_is_where_it_should_be(square):
    world = World(WorldSpec(ORIGIN, 600.0, (square,), texture=0.0, sensor_noise=0.0, seed=1))
    shot = shot_at(CAMERA, 10.0, pitch_deg=-10.0)  # over the corner itself
    dark = decoded(render(world, CAMERA, shot)) < 137
    row = 149.5 - 200.0 * math.tan(math.radians(10.0))
    assert dark[: int(row) - 2, 203:].mean() > 0.99
    assert dark[int(row) + 3 :, :].mean() < 0.01
    assert dark[:, :196].mean() < 0.01


def test_holes_show_the_ground(square):
    plane = World(WorldSpec(ORIGIN, 600.0, ())).plane
    hole = tuple(plane.to_wgs84(e, n) for e, n in ((8, 8), (12, 8), (12, 12), (8, 12)))
    patch = Patch(square.polygon, (hole,))
    world = World(WorldSpec(ORIGIN, 600.0, (patch,), seed=1))
    picture = decoded(render(world, CAMERA, shot_at(CAMERA, 10.0, east_m=10.0, north_m=10.0)))
    assert picture[120:180, 170:230].mean() > 150 > picture[120:180, 60:140].mean()


def test_the_roi_drifts_with_time(square):
    spec = WorldSpec(ORIGIN, 600.0, (square,), drift_speed_m_s=0.5, drift_toward_deg=90.0, seed=1)
    world = World(spec)
    over_corner = shot_at(CAMERA, 10.0, east_m=1.0, north_m=10.0)
    later = Shot(1.0, 10.0, over_corner.height_m, over_corner.attitude, 20.0, 0)
    assert decoded(render(world, CAMERA, over_corner))[150, 205:].mean() < 130
    assert decoded(render(world, CAMERA, later))[150, :300].mean() > 150
    assert world.drift_at(20.0) == pytest.approx((10.0, 0.0), abs=1e-6)


def test_a_threshold_separates_roi_from_ground_in_any_light(square):
    camera = CameraSpec()
    for seed in range(3):
        world = World(WorldSpec(ORIGIN, 600.0, (square,), seed=seed))
        for t_s in (0.0, 150.0, 500.0):
            for east_m, roi in ((10.0, True), (-30.0, False)):
                shot = Shot(east_m, 10.0, 8.0, camera.attitude(0, 0, 0), t_s, 3)
                dark = (decoded(render(world, camera, shot)) < 150).mean()
                assert (dark > 0.95) if roi else (dark < 0.05)


def test_the_ground_has_dark_gaps_and_repeats_without_a_seam():
    world = World(WorldSpec(ORIGIN, 600.0, (), seed=4))
    tile = world.ground_texture
    assert 0.001 < (tile < 150).mean() < 0.03
    assert abs(tile.mean() - 190.0) < 2.0
    n = tile.shape[0] // 2
    seam = np.abs(tile[n - 1].astype(int) - tile[n].astype(int)).mean()
    inside = np.abs(tile[n // 2].astype(int) - tile[n // 2 + 1].astype(int)).mean()
    assert seam < 1.5 * inside


def test_the_ground_is_fixed_to_the_world():
    quiet = World(WorldSpec(ORIGIN, 600.0, (), sensor_noise=0.0, illumination=0.0, seed=4))
    here = decoded(render(quiet, CAMERA, shot_at(CAMERA, 10.0)))
    there = decoded(render(quiet, CAMERA, shot_at(CAMERA, 10.0, east_m=2.0, north_m=1.0)))
    moved = there[20:, :-40].astype(int) - here[:-20, 40:]
    assert np.abs(moved).mean() < 2.0
    far = decoded(render(quiet, CAMERA, shot_at(CAMERA, 10.0, east_m=TILE_M, north_m=-TILE_M)))
    assert np.abs(far.astype(int) - here).mean() < 2.0


def test_rendering_repeats(square):
    spec = WorldSpec(ORIGIN, 600.0, (square,), seed=2)
    shot = shot_at(CAMERA, 10.0, 3.0, 2.0, 50.0)
    first = render(World(spec), CAMERA, shot)
    assert first == render(World(spec), CAMERA, shot)
    other = Shot(shot.east_m, shot.north_m, shot.height_m, shot.attitude, 0.0, 1)
    assert first != render(World(spec), CAMERA, other)  # another frame's noise


def test_impossible_cameras_are_refused():
    with pytest.raises(ValueError, match="cannot be simulated"):
        CameraSpec(hfov_deg=170.0)
    with pytest.raises(ValueError, match="horizon"):
        CameraSpec(hfov_deg=100.0, width_px=640, height_px=640)


def capture(client, interval_s, count, sequence=0, component=100):
    return client.result(
        mav.MAV_CMD_IMAGE_START_CAPTURE, 0, interval_s, count, sequence, component=component
    )


def test_picture_on_command_is_taken(make_client, square):
    client = make_client(world={"patches": (square,)}, image_url_prefix="http://127.0.0.1:8123/")
    client.take_off()
    client.target(5.0, 4.0, 12.0)
    client.run(8.0)
    assert capture(client, 0.0, 1, 1) == mav.MAV_RESULT_ACCEPTED
    begin_ms = round(client.vehicle.t_s * 1000)
    assert capture(client, 0.0, 1, 1) == mav.MAV_RESULT_ACCEPTED  # the same, repeated
    client.run(1.0)
    (captured,) = client.seen("CAMERA_IMAGE_CAPTURED", 100)
    assert (captured.image_index, captured.capture_result, captured.time_utc) == (0, 1, 0)
    assert captured.time_boot_ms == begin_ms + 50  # within the next step
    assert captured.file_url == "http://127.0.0.1:8123/1/0.jpg"
    assert captured.relative_alt == pytest.approx(12_000, abs=300)
    assert captured.alt - captured.relative_alt == 600_000
    yaw = client.vehicle.truth.yaw_rad
    nadir = Quaternion.from_euler(0.0, -math.pi / 2, yaw)
    assert abs(np.dot(captured.q, nadir)) == pytest.approx(1.0, abs=1e-3)
    picture = decoded(client.vehicle.image(captured.file_url))
    assert picture.shape == (480, 640)
    assert picture[240, 320] < 150
    assert client.vehicle.image(captured.file_url) == client.vehicle.image(captured.file_url)
    assert client.vehicle.image("http://127.0.0.1:8123/1/1.jpg") is None
    again = client.command(mav.MAV_CMD_REQUEST_MESSAGE, 263, 0, component=100)
    assert again[1].file_url == captured.file_url
    lost = client.result(mav.MAV_CMD_REQUEST_MESSAGE, 263, 9, component=100)
    assert lost == mav.MAV_RESULT_FAILED


def test_series_of_pictures_is_taken_at_its_interval(ready):
    assert capture(ready, 0.5, 5) == mav.MAV_RESULT_ACCEPTED
    assert capture(ready, 0.5, 5) == mav.MAV_RESULT_TEMPORARILY_REJECTED
    ready.run(5.0)
    times = [m.time_boot_ms for m in ready.seen("CAMERA_IMAGE_CAPTURED")]
    assert np.diff(times).tolist() == [500] * 4
    assert capture(ready, 0.01, 0, component=1) == mav.MAV_RESULT_ACCEPTED  # until stopped
    ready.run(2.0)
    assert ready.result(mav.MAV_CMD_IMAGE_STOP_CAPTURE) == mav.MAV_RESULT_ACCEPTED
    count = len(ready.seen("CAMERA_IMAGE_CAPTURED"))
    assert count == 5 + 10  # the camera's own shortest interval, 0.2 s
    ready.run(2.0)
    assert len(ready.seen("CAMERA_IMAGE_CAPTURED")) == count


def test_only_the_last_pictures_are_kept(ready):
    capture(ready, 0.2, 0)
    ready.run(100.0)
    urls = [m.file_url for m in ready.seen("CAMERA_IMAGE_CAPTURED")]
    assert len(urls) == 500
    assert ready.vehicle.image(urls[0]) is None
    assert ready.vehicle.image(urls[-400]) is not None
