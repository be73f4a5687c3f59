"""Poses of exposures that the camera does not report are interpolated from telemetry."""

import asyncio
import math
from datetime import UTC, datetime

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import ExifTags, Image
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import ImageError
from missions.geo.grid import Grid
from missions.units import LatLon, Pose, Quaternion
from sitl.camera.pinhole import CameraSpec
from tests.support.mavlink_peer import Peer, heartbeat, position
from tests.support.running import by, on_virtual_time
from tests.unit.uavmap.aircraft.cameras.conformance import LATENCY_S, folder_bench, jpeg, running
from uavmap.aircraft.cameras.pose import Mount, Poses
from uavmap.aircraft.cameras.source import Announcement, ReportedPose
from uavmap.base.clock import VirtualClock, run
from uavmap.mavlink.continuity import distance_m

HOME = LatLon(48.0, 11.0)
GRID = Grid.at(HOME, 4.0)
RADIUS_M, SPEED_M_S, BANK_RAD = 15.0, 8.0, 0.3
TURN_RAD_S = SPEED_M_S / RADIUS_M
AHEAD_S = 50.0
ANGLE = st.floats(-math.pi, math.pi)
SMALL = st.floats(-0.6, 0.6)


async def nothing():
    return b""


def truth(t_s):
    angle = TURN_RAD_S * t_s
    north_m, east_m = RADIUS_M * math.sin(angle), RADIUS_M * (1.0 - math.cos(angle))
    place = LatLon(
        HOME.lat_deg + north_m / 111_195.0,
        HOME.lon_deg + east_m / (111_195.0 * math.cos(math.radians(HOME.lat_deg))),
    )
    return place, 12.0 + 0.2 * t_s, Quaternion.from_euler(BANK_RAD, 0.05, angle)


def report_at(t_s, peer, *, attitude_off_s=0.0):
    place, height_m, _ = truth(t_s)
    heading = math.remainder(TURN_RAD_S * t_s, 2.0 * math.pi)
    velocity = (round(800 * math.cos(heading)), round(800 * math.sin(heading)), -20)
    boot_ms = round((t_s + AHEAD_S) * 1000)
    turned_ms = boot_ms + round(attitude_off_s * 1000)
    for message in (
        heartbeat(),
        position(place, t_s=t_s + AHEAD_S, up_m=height_m, amsl_m=512.0, velocity=velocity),
        mav.MAVLink_attitude_message(turned_ms, BANK_RAD, 0.05, heading, 0, 0, 0),
    ):
        peer.session.feed(peer.frame(message))


def beside_a_circling_vehicle(body, *, attitude_off_s=0.0):
    """Run a test beside a vehicle that flies circles and reports ten times a second."""
    peers = []

    async def main():
        peer = Peer()
        peers.append(peer)
        loop = asyncio.get_running_loop()

        async def telemetry():
            while True:
                report_at(loop.time(), peer, attitude_off_s=attitude_off_s)
                await asyncio.sleep(0.1)

        poses = Poses(peer.session, Mount(yaw_deg=90.0), GRID)
        async with running(telemetry):
            await asyncio.sleep(2.0)
            await body(peer, poses)

    run(main(), VirtualClock())
    return peers[0]


def angle_deg(a, b):
    cosine = abs(sum(p * q for p, q in zip(a, b, strict=True)))
    return math.degrees(2.0 * math.acos(min(cosine, 1.0)))


def test_pose_in_a_turn_lies_between_its_messages():
    errors_m, errors_deg = [], []

    async def body(peer, poses):
        for _ in range(60):
            await asyncio.sleep(0.237)
            taken_s = asyncio.get_running_loop().time()
            pose = await poses.pose_of(Announcement("a", taken_s, nothing))
            place, height_m, turned = truth(taken_s)
            errors_m.append(distance_m(pose.position, place))
            assert pose.height_m == pytest.approx(height_m, abs=0.02)
            errors_deg.append(angle_deg(pose.attitude, Mount(yaw_deg=90.0).attitude(turned)))

    beside_a_circling_vehicle(body)
    assert max(errors_m) < 0.05
    assert max(errors_deg) < 0.1


@by(beside_a_circling_vehicle)
async def test_pose_reported_by_the_camera_has_precedence(peer, poses, /):
    place, height_m, turned = truth(2.0)
    told = ReportedPose(place, height_m, turned)
    taken_s = asyncio.get_running_loop().time()
    assert await poses.pose_of(Announcement("a", taken_s, nothing, reported=told)) == Pose(
        place, height_m, turned
    )
    assert poses.streams == {}  # no stream was requested
    half = ReportedPose(place, height_m, None)
    pose = await poses.pose_of(Announcement("a", taken_s, nothing, reported=half))
    assert (pose.position, pose.height_m) == (place, height_m)
    assert angle_deg(pose.attitude, Mount(yaw_deg=90.0).attitude(turned)) < 0.1
    assert poses.streams == {mav.MAVLINK_MSG_ID_ATTITUDE: 10.0}


@pytest.mark.parametrize(
    ("late_s", "fault"), [(100.0, None), (3.0, "in the future"), (0.0, "its time cannot be right")]
)
def test_impossible_time_is_refused(late_s, fault):
    async def body(peer, poses):
        now_s = asyncio.get_running_loop().time()
        taken_s = now_s + 20.0 if fault == "in the future" else now_s - late_s
        said = fault if late_s == 0.0 else None
        with pytest.raises(ImageError, match="reports no usable pose"):
            await poses.pose_of(Announcement("a", taken_s, nothing, fault=said))

    peer = beside_a_circling_vehicle(body)
    assert sum(peer.session.view.gate.refused.values()) == 1


def test_attitude_of_another_clock_is_refused_and_counted():
    async def body(peer, poses):
        taken_s = asyncio.get_running_loop().time()
        with pytest.raises(ImageError, match="the vehicle's own at that time is unknown"):
            await poses.pose_of(Announcement("a", taken_s, nothing))

    peer = beside_a_circling_vehicle(body, attitude_off_s=-30.0)
    refused = peer.session.view.gate.refused
    assert refused["ATTITUDE", "its time is not that of the vehicle's position"] > 10


@settings(max_examples=100, deadline=None)
@given(SMALL, SMALL, ANGLE, st.floats(-180.0, 180.0), st.booleans())
def test_mount_agrees_with_the_simulator(roll, pitch, yaw, yaw_deg, fixed):
    theirs = CameraSpec(fixed=fixed, yaw_deg=yaw_deg).attitude(roll, pitch, yaw)
    ours = Mount(fixed, yaw_deg).attitude(Quaternion.from_euler(roll, pitch, yaw))
    assert angle_deg(ours, theirs) < 1e-4


def test_mount_not_level_turns_the_view():
    """Pitched up by 10 degrees the camera points forward; rolled to the right it points left."""
    level = Quaternion.from_euler(0.0, 0.0, 0.0)
    for mount, axis in (
        (Mount(pitch_deg=10.0), (math.sin(math.radians(10.0)), 0.0)),
        (Mount(roll_deg=10.0), (0.0, -math.sin(math.radians(10.0)))),
    ):
        w, x, y, z = mount.attitude(level)
        north, east = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z)
        assert (north, east) == pytest.approx(axis, abs=1e-9)


# --- the time of a file ----------------------------------------------------------------------
@by(on_virtual_time)
async def test_camera_that_writes_irregularly_keeps_its_own_times(tmp_path):
    """EXIF times have parts of a second: the delay of each file does not matter."""
    camera_ahead_s = 1_790_000_000.25
    async with folder_bench(tmp_path) as bench:
        loop = asyncio.get_running_loop()
        await bench.source.start(1.0, 0)
        times = []
        for number, late_s in enumerate((0.0, 0.9, 0.3, 0.9, 0.1, 0.7)):
            times.append(loop.time())
            stamp = datetime.fromtimestamp(loop.time() + camera_ahead_s, UTC)
            exif = Image.Exif()
            detail = exif.get_ifd(ExifTags.IFD.Exif)
            detail[ExifTags.Base.DateTimeOriginal] = stamp.strftime("%Y:%m:%d %H:%M:%S")
            detail[ExifTags.Base.SubsecTimeOriginal] = f"{stamp.microsecond // 1000:03}"
            path = bench.hardware.folder / f"{number}.jpg"
            loop.call_later(LATENCY_S + late_s, path.write_bytes, jpeg(number, exif))
            await asyncio.sleep(1.0)
        await asyncio.sleep(2.0)
        assert len(bench.announced) == 6
        for picture, exposed_s in zip(bench.announced, times, strict=True):
            assert picture.taken_s == pytest.approx(exposed_s, abs=0.05)
