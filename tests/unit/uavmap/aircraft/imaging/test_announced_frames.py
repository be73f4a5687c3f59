"""A picture that a camera announces with an unusable pose is lost, without other effects."""

import asyncio
import io
import math
import random
import re

import numpy as np
import pytest
from PIL import Image
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import ImageError, LinkError
from missions.events import FrameLost, FrameSeen
from missions.flight.setting_of import setting_of
from missions.units import Cell, Quaternion
from tests.support.flights import HEIGHT_PX, WIDTH_PX, small_mission
from tests.support.mavlink_peer import Peer, heartbeat
from uavmap.aircraft.cameras.mavlink import MavlinkSource
from uavmap.aircraft.cameras.pose import Poses
from uavmap.aircraft.imaging.classifier import Classifier, PictureJudge
from uavmap.aircraft.imaging.imaging import CameraDriver
from uavmap.base.clock import VirtualClock, run
from uavmap.runner.flight_links import mount_of

DOWN = Quaternion.from_euler(0.0, -math.pi / 2, 0.0)
URL = b"http://127.0.0.1/0.jpg"
MISSION = small_mission()
SETTING = setting_of(MISSION)
CAMERA = MISSION.camera


def picture(width=CAMERA.width_px, height=CAMERA.height_px):
    out = io.BytesIO()
    noise = np.random.default_rng(1).integers(-6, 7, (height, width, 1))
    pixels = np.repeat(190 + noise, 3, axis=2).astype(np.uint8)
    Image.fromarray(pixels).save(out, "JPEG")
    return out.getvalue()


PICTURE = picture()


async def served(url):
    return PICTURE


def announced(**how):
    values = {
        "time_boot_ms": 5000,
        "lat": round(MISSION.home.lat_deg * 1e7),
        "lon": round(MISSION.home.lon_deg * 1e7),
        "relative_alt": 12_000,
        "q": list(DOWN),
        "image_index": 0,
        "file_url": URL,
    } | how
    return mav.MAVLink_camera_image_captured_message(
        values["time_boot_ms"], 0, 0, values["lat"], values["lon"], 512_000,
        values["relative_alt"], values["q"], values["image_index"], 1, values["file_url"],
    )  # fmt: skip


class Verdicts:
    def __init__(self):
        self._judge = PictureJudge({1: Classifier.for_mission(MISSION, SETTING.grid)})
        self._last = None

    async def judge(self, taken):
        self._last = self._judge.verdict(taken)
        return isinstance(self._last, FrameSeen)

    async def event_of(self, driver, picture):
        try:
            await driver.judge_picture(picture, None, anywhere=False)
        except (ImageError, LinkError) as error:
            return driver.lost(str(error), picture)
        assert self._last is not None
        return self._last


def judge_frames(*messages, fetch=served, peers=lambda peer: None):
    """Return the driver's events for announcements that arrive at 5.1 s, ordered at 5 s."""

    async def main():
        peer = Peer()
        loop = asyncio.get_running_loop()
        await asyncio.sleep(5.0)
        peer.session.feed(peer.frame(heartbeat()))
        peer.session.feed(peer.frame(place(5.0)))
        source = MavlinkSource(peer.session, fetch)
        poses = Poses(peer.session, mount_of(CAMERA), SETTING.grid)
        judge = Verdicts()
        driver = CameraDriver(1, source, poses, MISSION, judge.judge, loop.time)
        peer.answer = lambda message: peer.send(
            mav.MAVLink_command_ack_message(message.command, 0, 0, 0, 245, 191), component=100
        )
        await source.start(1.0, 1)
        await asyncio.sleep(5.1 - loop.time())
        peers(peer)
        heard = []
        source.listen(heard.append)
        for message in messages:
            peer.session.feed(peer.frame(message, 100))
        events = [await judge.event_of(driver, picture) for picture in heard]
        assert all(math.isfinite(event.t_s) for event in events)
        return events

    return run(main(), VirtualClock())


def place(t_s):
    home = MISSION.home
    return mav.MAVLink_global_position_int_message(
        round(t_s * 1000), round(home.lat_deg * 1e7), round(home.lon_deg * 1e7), 512_000, 12_000,
        0, 0, 0, 0,
    )  # fmt: skip


def test_announced_picture_is_judged():
    (event,) = judge_frames(announced())
    assert isinstance(event, FrameSeen)
    assert event.vantage == Cell(0, 0)
    assert len(event.votes) == 5
    assert event.t_s == 5.0


NAN, INF = math.nan, math.inf
NO_ATTITUDE = "it reports no attitude, and the vehicle's own at that time is unknown"


@pytest.mark.parametrize(
    ("how", "reason"),
    [
        # reported by neither the camera nor the autopilot
        ({"q": [0.0] * 4, "lat": 0, "lon": 0}, NO_ATTITUDE),
        ({"q": [0.0] * 4}, NO_ATTITUDE),
        ({"q": [NAN] * 4}, NO_ATTITUDE),
        ({"q": [NAN] * 4, "time_boot_ms": 900_000}, NO_ATTITUDE),
        ({"q": [1.0, INF, 0.0, 0.0]}, "the quaternion is not finite"),
        ({"q": [0.5, 0.0, 0.0, 0.0]}, "the quaternion is not of unit length"),
        ({"q": [3e38] * 4}, "the quaternion is not of unit length"),
        ({"lat": round(91e7)}, "the position is not on Earth"),
        ({"lat": round(214.7e7)}, "the position is not on Earth"),
        ({"lat": -(2**31)}, "the position is not on Earth"),
        ({"lon": 2**31 - 1}, "the position is not on Earth"),
        ({"lat": round(89.9e7)}, "the position is not where the vehicle was"),
        ({"lon": round(-100e7)}, "the position is not where the vehicle was"),
        ({"relative_alt": 2**31 - 1}, "the height is out of range"),
        ({"relative_alt": -(2**31)}, "the height is out of range"),
        ({"relative_alt": 900_000}, "the height is not that of the vehicle"),
    ],
)
def test_unusable_pose_loses_the_frame(how, reason):
    asked = []

    async def fetch(url):
        asked.append(url)
        return PICTURE

    (event,) = judge_frames(announced(**how), fetch=fetch)
    assert isinstance(event, FrameLost)
    assert event.reason == f"the camera reports no usable pose: {reason}"
    assert asked == []


def test_arbitrary_pose_is_judged_or_lost():
    rng = random.Random(5)
    values = [0.0, NAN, INF, -INF, 3.4e38, 1e-40, 1.0, -1.0, 0.7071068]
    many = [
        announced(
            image_index=n,
            time_boot_ms=rng.choice((0, 5000, 2**32 - 1, rng.randrange(2**32))),
            lat=rng.choice((0, 473_000_000, rng.randrange(-(2**31), 2**31))),
            lon=rng.choice((0, 85_000_000, rng.randrange(-(2**31), 2**31))),
            relative_alt=rng.choice((0, 12_000, rng.randrange(-(2**31), 2**31))),
            q=[rng.choice(values) for _ in range(4)],
            file_url=rng.randbytes(rng.randrange(0, 200)),
        )
        for n in range(300)
    ]
    events = judge_frames(*many)
    assert len(events) == 300
    for event in events:
        assert 4.5 <= event.t_s <= 5.2
        assert not isinstance(event, FrameLost) or event.reason.isprintable()


def test_frame_is_stamped_within_the_capture():
    """One camera started a minute before the autopilot, another has a broken clock."""
    (event,) = judge_frames(announced(time_boot_ms=65_000))
    assert event.t_s == pytest.approx(5.1)
    (event,) = judge_frames(announced(time_boot_ms=0))
    assert 4.5 <= event.t_s <= 5.1
    first, second = judge_frames(announced(), announced(time_boot_ms=2**32 - 1, image_index=1))
    assert first.t_s == 5.0
    assert second.t_s == 5.1


async def small(url):
    return picture(64, 64)


async def unreachable(url):
    raise LinkError(f"{url}: \x1b[2Jgone")


def forget(peer):
    peer.session.view.position = None


@pytest.mark.parametrize(
    ("how", "reason"),
    [
        ({"fetch": small}, f"picture is 64 x 64 px, the camera {WIDTH_PX} x {HEIGHT_PX} px"),
        (
            {"fetch": unreachable},
            "^http://127.0.0.1/0.jpg: gone$",
        ),  # text from outside is made printable
        ({"peers": forget}, "the vehicle has not reported where it is"),
    ],
)
def test_frame_that_is_lost_has_its_reason(how, reason):
    (event,) = judge_frames(announced(), **how)
    assert isinstance(event, FrameLost)
    assert re.search(reason, event.reason)
