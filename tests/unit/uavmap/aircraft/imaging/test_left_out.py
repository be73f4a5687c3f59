"""If pictures of a path come faster than they are judged, the newest count; a line reports it."""

import asyncio
from types import SimpleNamespace
from typing import Any, cast

from missions.events import FrameLost
from uavmap.aircraft.cameras.source import FrameSource
from uavmap.aircraft.imaging.frames import MAX_WAITING, Frames
from uavmap.base.clock import VirtualClock, run


class SlowCamera:
    def __init__(self):
        self.indices = []

    async def judge_picture(self, picture, vantage):
        await asyncio.sleep(1.0)
        self.indices.append(picture.index)
        return True

    def lost(self, reason, picture=None):
        return FrameLost(1, 0.0, reason)

    def ask_again(self, index):
        raise AssertionError(f"picture {index} is asked for again")


def take_pictures(anywhere):
    """Take ten pictures a second for ten seconds; judging them takes thirty."""
    camera = SlowCamera()
    events = []

    async def body():
        source = cast("FrameSource", camera)
        frames = Frames(source, camera.judge_picture, camera.lost, 0.1, anywhere=anywhere)

        async def judge():
            async for lost in frames.judged(None):
                if lost is not None:
                    events.append(lost)

        judging = asyncio.create_task(judge())
        for index in range(100):
            frames.receive_announcement(cast("Any", SimpleNamespace(index=index)))
            await asyncio.sleep(0.1)
        await asyncio.sleep(3.0)
        judging.cancel()

    run(body(), VirtualClock())
    return camera, events


def test_newest_waiting_picture_is_judged_next():
    camera, events = take_pictures(anywhere=True)
    assert camera.indices == sorted(camera.indices)
    assert camera.indices[-1] == 99
    # each is judged soon after its exposure: the queue never grows
    steps = [b - a for a, b in zip(camera.indices, camera.indices[1:], strict=False)]
    assert max(steps) <= 10 + MAX_WAITING
    assert [event.reason for event in events] == [
        "detection is slower than the frame rate: pictures are dropped from now on"
    ]


def test_pictures_of_a_lane_are_all_judged():
    camera, events = take_pictures(anywhere=False)
    assert camera.indices == list(range(len(camera.indices)))
    assert not events
