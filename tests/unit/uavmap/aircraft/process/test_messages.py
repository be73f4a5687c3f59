"""Messages between mission and aircraft are decoded as they were encoded."""

import contextlib
import dataclasses

import numpy as np
import pytest

from missions import orders
from missions.errors import ImageError, LinkError
from missions.events import FrameSeen, Tracked, Vote
from missions.geo.trajectory import rounded_path
from missions.units import Cell, GridPoint, LatLon, Pose, Quaternion
from tests.support.running import by, on_virtual_time
from uavmap.aircraft.imaging.classifier import PosedPicture
from uavmap.aircraft.process import messages as msg
from uavmap.aircraft.process.host import Host

PATH = rounded_path(
    [GridPoint(0.1, 0.2), GridPoint(60.0 / 7.0, 0.0), GridPoint(60.0, 30.0)],
    begin_s=1.0 / 3.0,
    speed_m_s=6.0,
)
POSE = Pose(LatLon(47.1, 8.3), 12.0, Quaternion(1.0, 0.0, 0.0, 0.0))
SEEN = FrameSeen(1, 2.5, None, (Vote(Cell(1, -2), True, 0.125),), overview=True)
ALL = [
    msg.Attach(msg.VERSION, "word"),
    msg.Telemetry(2, "GUIDED", 10, 1.2, None, 25, 0.1),
    msg.Begin(
        3.5,
        {1: msg.EarlierFlight(flew=True)},
        msg.PreflightOptions(("a",), True, False),
        False,
        True,
    ),
    msg.Fly(-1.25),
    *(
        msg.GiveOrder(2, order)
        for order in (
            orders.TakeOff(12.0),
            orders.Sweep(GridPoint(1.0, 2.0), 3.0, 12.0),
            orders.FlyTo((GridPoint(0.1, 0.2),), Cell(3, 4), True, 12.0),
            orders.FlyPath(PATH, 12.0, None, 0.2),
            orders.Look(Cell(0, 0), 8, 12.0),
            orders.Hold(),
            orders.Land(),
            orders.ReturnToLaunch(),
            orders.AwaitBattery(),
            orders.StandDown(),
        )
    ),
    msg.LandHere(1, "commanded by the operator"),
    msg.PictureJudged(7, seen=True),
    msg.PictureJudged(8, seen=False),
    msg.SwapDone(1),
    msg.Answered(None),
    msg.Finish("the mission is over"),
    msg.Leave("the operator left"),
    msg.Beat(12.5, fates={1: "in the air"}),
    msg.Attached("flying"),
    msg.Ready(None, 4.0),
    msg.EventReport(Tracked(1, 2.0, GridPoint(0.1, 0.2), 12.0, 55.5)),
    msg.Picture(1, 1, 2.0, POSE, Cell(1, 2), False, "a picture", None, b"\xff\xd8 a file"),
    msg.SwapRequested(3),
    msg.SwapCancelled(3),
    msg.Question("fly? [y/N]"),
    msg.Line("vehicle 1: ready"),
    msg.Ended({1: "in the air"}, "LinkError", "silent", True),
]


def test_messages_in_arbitrary_pieces_are_decoded_unchanged():
    wire = b"".join(map(msg.encode, ALL))
    rng = np.random.default_rng(1)
    for _ in range(20):
        cuts = sorted(rng.integers(0, len(wire), 30).tolist())
        decoder, found = msg.Decoder(), list[msg.Message]()
        for begin, end in zip([0, *cuts], [*cuts, len(wire)], strict=True):
            found += decoder.feed(wire[begin:end])
        assert found == ALL


def test_pixels_of_a_picture_are_decoded_unchanged():
    pixels = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    sent = msg.Picture(1, 1, 2.0, POSE, None, True, "one", (2, 4, 3), pixels.tobytes())
    (found,) = msg.Decoder().feed(msg.encode(sent))
    assert isinstance(found, msg.Picture)
    assert np.array_equal(found.content, pixels)


@pytest.mark.parametrize(
    "data",
    [b"\x00\x00\x00\x02\x00\x00\x00\x00{}", b"\xff" * 8, msg.encode(ALL[3])[:8] + b"x" * 999],
)
def test_invalid_bytes_are_refused(data):
    with pytest.raises(LinkError):
        list(msg.Decoder().feed(data))


@pytest.mark.parametrize(
    ("known", "text", "picture", "fits"),
    [
        (True, msg.MAX_TEXT_BYTES, msg.MAX_PICTURE_BYTES, True),
        (True, msg.MAX_TEXT_BYTES + 1, 0, False),
        (True, 2, msg.MAX_PICTURE_BYTES + 1, False),
        (False, msg.FIRST_BYTES, 0, True),
        (False, msg.FIRST_BYTES + 1, 0, False),
        (False, 2, 1, False),
    ],
)
def test_message_too_long_is_refused_by_its_head(known, text, picture, fits):
    """An earlier version kept up to 512 MiB from any connection."""
    head = text.to_bytes(4, "big") + picture.to_bytes(4, "big")
    expected = contextlib.nullcontext() if fits else pytest.raises(LinkError, match="understand")
    with expected:
        assert not list(msg.Decoder(known=known).feed(head))


@by(on_virtual_time)
async def test_picture_that_is_too_large_for_the_mission_is_lost_and_nothing_is_sent():
    sent = list[msg.Message]()
    data = bytes(msg.MAX_PICTURE_BYTES + 1)
    with pytest.raises(ImageError, match="a picture has at most"):
        await Host(sent.append).judge(PosedPicture(1, 2.0, POSE, None, True, "huge", data))
    assert sent == []


def test_messages_that_change_have_another_version():
    """Processes of two versions of uavmap would misread each other."""
    fields = [("vehicle", int), ("mode", str)]
    changed = [*fields, ("volts", float)], [("vehicle", int), ("mode", bytes)], fields[:1]
    versions = {
        msg.version_of([dataclasses.make_dataclass("Report", each)]) for each in (fields, *changed)
    }
    assert len(versions) == 4
    assert msg.VERSION not in versions
