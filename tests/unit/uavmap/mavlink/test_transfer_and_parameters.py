"""Parameters, fences and rally points over the wire, for both autopilots."""

import asyncio
import random
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import CommandRefusedError
from missions.units import LatLon
from tests.support.field import BOTH, mission_of, on_field
from tests.support.mavlink_peer import Peer, heartbeat
from tests.support.running import by, on_virtual_time
from uavmap.mavlink.mission_transfer import Item, Kind, MissionTransfer, same_items
from uavmap.mavlink.parameters import Parameter, Parameters

INCLUSION = mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION


def ring(count):
    return tuple(
        Item(INCLUSION, LatLon(48.0 + 0.0001 * (i % 2), 11.0 + 0.0001 * i), float(count))
        for i in range(count)
    )


@pytest.mark.parametrize("autopilot", BOTH)
@by(on_field, mission_of)
async def test_fence_is_read_back_as_it_was_sent(field, /, autopilot):
    transfer = MissionTransfer(field.links[0].session)
    assert await transfer.download(Kind.FENCE) == ()
    await transfer.upload(Kind.FENCE, ring(7))
    assert same_items(ring(7), await transfer.download(Kind.FENCE))
    assert field.count(0, mav.MAV_MISSION_TYPE_FENCE) == 7
    await transfer.upload(Kind.FENCE, ())
    assert field.count(0, mav.MAV_MISSION_TYPE_FENCE) == 0


@pytest.mark.parametrize("autopilot", BOTH)
@by(on_field, mission_of)
async def test_transfer_link_loses_a_fifth_succeeds(field, /, autopilot):
    chance = random.Random(1)
    field.lose = lambda: chance.random() < 0.2
    transfer = MissionTransfer(field.links[0].session)
    await transfer.upload(Kind.FENCE, ring(12))
    assert same_items(ring(12), await transfer.download(Kind.FENCE))


@by(on_field, lambda: mission_of("ardupilot"))
async def test_fence_that_the_vehicle_refuses_is_an_error_with_its_reason(field, /):
    transfer = MissionTransfer(field.links[0].session)
    (first, *rest) = ring(4)
    nowhere = Item(INCLUSION, LatLon(95.0, 11.0), 4.0)
    with pytest.raises(CommandRefusedError, match="upload of the fence refused: invalid param5"):
        await transfer.upload(Kind.FENCE, (first, nowhere, *rest[1:]))


class FarArduPilot:
    """An ArduPilot's mission protocol behind a slow link, as in `MissionItemProtocol.cpp`."""

    def __init__(self, there_s):
        self.peer = Peer()
        self.peer.answer = self.receive
        self.items = []
        self.refused = 0
        self._there_s = there_s
        self._count = None
        self._asking = None

    def receive(self, message):
        """Send a frame of the client towards it."""
        asyncio.get_running_loop().call_later(self._there_s, self._handle, message)

    def _reply(self, *messages):
        self.peer.send(*messages, after_s=self._there_s)

    def _handle(self, message):
        kind = message.get_type()
        if kind == "MISSION_COUNT":
            self.items, self._count = [], message.count
            self._ask()
        elif kind == "MISSION_REQUEST_LIST":
            self._reply(mav.MAVLink_mission_count_message(245, 191, len(self.items), 1))
        elif kind == "MISSION_REQUEST_INT":
            self._reply(self.items[message.seq])
        elif kind == "MISSION_ITEM_INT" and self._count is None:
            self._result(mav.MAV_MISSION_ERROR)
        elif kind == "MISSION_ITEM_INT" and message.seq != len(self.items):
            self.refused += 1
            self._result(mav.MAV_MISSION_INVALID_SEQUENCE)
        elif kind == "MISSION_ITEM_INT":
            message.target_system, message.target_component = 245, 191
            self.items.append(message)
            if len(self.items) < (self._count or 0):
                self._ask()
            else:
                self._count = None
                self._stop()
                self._result(mav.MAV_MISSION_ACCEPTED)

    def _result(self, result):
        self._reply(mav.MAVLink_mission_ack_message(245, 191, result, 1))

    def _stop(self):
        if self._asking is not None:
            self._asking.cancel()

    def _ask(self):
        """Request the next item now, and again after a second."""
        self._stop()
        self._reply(mav.MAVLink_mission_request_message(245, 191, len(self.items), 1))
        self._asking = asyncio.get_running_loop().call_later(1.0, self._ask)


@pytest.mark.parametrize("there_s", [0.02, 0.6, 1.5])
@by(on_virtual_time)
async def test_upload_over_slow_link_succeeds_without_doubled_items(there_s):
    """A real ArduCopter 4.6.2 was 0.6 s away in each direction.

    It refused the second copy of each item with INVALID_SEQUENCE and continued; an earlier version
    gave the upload up: "not flown".
    """
    far = FarArduPilot(there_s)
    far.peer.session.feed(far.peer.frame(heartbeat()))
    transfer = MissionTransfer(far.peer.session)
    await transfer.upload(Kind.FENCE, ring(5))
    assert far.refused == 0
    assert same_items(ring(5), await transfer.download(Kind.FENCE))


@by(on_virtual_time)
async def test_upload_refused_sequence_while_vehicle_asks_continues():
    """Another client, or an echo, doubles an item: the vehicle refuses the copy, and continues."""
    far = FarArduPilot(0.02)
    far.peer.session.feed(far.peer.frame(heartbeat()))

    def doubled(message):
        far.receive(message)
        if message.get_type() == "MISSION_ITEM_INT":
            far.receive(message)

    far.peer.answer = doubled
    await MissionTransfer(far.peer.session).upload(Kind.FENCE, ring(5))
    assert far.refused >= 4
    counts = [m for _, m in far.peer.received if m.get_type() == "MISSION_COUNT"]
    assert len(counts) == 1


@pytest.mark.parametrize(("sent_frame", "kept_frame"), [(5, 0), (6, 3), (0, 0), (3, 3)])
@by(on_virtual_time)
async def test_rally_point_of_integer_frame_gets_known_frame(sent_frame, kept_frame):
    """A real PX4 sends the frames 5 and 6.

    Restored unchanged, they stopped its return in the air: "RTL: unsupported MAV_FRAME".
    """
    peer = Peer()
    peer.session.feed(peer.frame(heartbeat(4 << 16 | 3 << 24, autopilot=mav.MAV_AUTOPILOT_PX4)))
    point = (245, 191, 0, sent_frame, mav.MAV_CMD_NAV_RALLY_POINT, 0, 1, 0, 0, 0, 0)
    place = (480000000, 110000000, 30.0, mav.MAV_MISSION_TYPE_RALLY)

    def answer(message):
        match message.get_type():
            case "MISSION_REQUEST_LIST":
                peer.send(mav.MAVLink_mission_count_message(245, 191, 1, 2))
            case "MISSION_REQUEST_INT":
                peer.send(mav.MAVLink_mission_item_int_message(*point, *place))
            case "MISSION_COUNT":
                peer.send(mav.MAVLink_mission_request_int_message(245, 191, 0, 2))
            case "MISSION_ITEM_INT":
                peer.send(mav.MAVLink_mission_ack_message(245, 191, mav.MAV_MISSION_ACCEPTED, 2))

    peer.answer = answer
    transfer = MissionTransfer(peer.session)
    owners = await transfer.download(Kind.RALLY)
    await transfer.upload(Kind.RALLY, owners)
    (sent,) = [m for _, m in peer.received if m.get_type() == "MISSION_ITEM_INT"]
    assert (sent.frame, sent.z) == (kept_frame, 30.0)
    (item,) = owners
    assert not same_items(owners, [replace(item, height_m=20.0)])
    assert not same_items(owners, [replace(item, frame=3 - kept_frame)])


@pytest.mark.parametrize(
    ("autopilot", "whole", "real"),
    [("ardupilot", "FENCE_ACTION", "FENCE_ALT_MAX"), ("px4", "GF_ACTION", "GF_MAX_VER_DIST")],
)
@by(on_field, mission_of)
async def test_parameters_are_read_and_written(field, /, autopilot, whole, real):
    parameters = Parameters(field.links[0].session)
    names = [whole, real, "NO_SUCH_NAME"]
    found = await parameters.read_many(names)
    assert set(found) == {whole, real}
    assert found[whole].value == field.parameter(0, whole)
    for value in (4.0, 0.0):
        assert await parameters.write(whole, Parameter(value, found[whole].type))
        assert field.parameter(0, whole) == value
    assert await parameters.write(real, Parameter(31.5, found[real].type))
    assert field.parameter(0, real) == 31.5
    assert not await parameters.write("NO_SUCH_NAME", Parameter(1.0, 9))


@by(on_virtual_time)
async def test_parameter_reported_twice_old_copy_is_no_answer():
    """A real PX4 sent GF_ACTION 3 once more after the service had reset it to 1.

    An earlier version took it for the answer and left the mission's fence (2 of 6 dry runs).
    """
    peer, there_s, again_s = Peer(), 0.02, 0.03
    peer.session.feed(peer.frame(heartbeat(4 << 16 | 3 << 24, autopilot=mav.MAV_AUTOPILOT_PX4)))
    value = mav.MAVLink_param_value_message(b"GF_MAX_VER_DIST", 10.0, 9, 1, 0)

    def answer(message):
        if message.get_type() == "PARAM_SET":
            told = mav.MAVLink_param_value_message(b"GF_MAX_VER_DIST", message.param_value, 9, 1, 0)
            value.param_value = message.param_value
            peer.send(told, after_s=2.0 * there_s)
            for copy in (1, 2, 3):
                peer.send(told, after_s=2.0 * there_s + copy * again_s)
        elif message.get_type() == "PARAM_REQUEST_READ":
            peer.send(value, after_s=2.0 * there_s)

    peer.answer = answer
    parameters = Parameters(peer.session)
    for wanted in (25.0, 10.0, 0.0, 31.5):
        assert await parameters.write("GF_MAX_VER_DIST", Parameter(wanted, 9))
        assert value.param_value == wanted
    assert await parameters.read("GF_MAX_VER_DIST") == Parameter(31.5, 9)


@by(on_virtual_time)
async def test_parameter_that_vehicle_does_not_keep_is_not_written():
    """Set, acknowledged and lost again: the value read back decides."""
    peer = Peer()
    peer.session.feed(peer.frame(heartbeat()))

    def answer(message):
        kept = message.param_value if message.get_type() == "PARAM_SET" else 3.0
        peer.send(mav.MAVLink_param_value_message(b"GUID_TIMEOUT", kept, 9, 1, 0))

    peer.answer = answer
    assert not await Parameters(peer.session).write("GUID_TIMEOUT", Parameter(1.0, 9))


@by(on_field, lambda: mission_of("px4"))
async def test_negative_integer_of_px4_is_read(field, /):
    parameters = Parameters(field.links[0].session)
    assert await parameters.write("COM_TAKEOFF_ACT", Parameter(-1.0, 6))
    found = await parameters.read("COM_TAKEOFF_ACT")
    assert found == Parameter(-1.0, 6)


@by(on_field, lambda: mission_of("ardupilot"))
async def test_ground_station_reading_fence_does_not_disturb(field, /, tmp_path):
    session = field.links[0].session
    transfer = MissionTransfer(session)
    await transfer.upload(Kind.FENCE, ring(5))
    stranger = mav.MAVLink(None, srcSystem=1, srcComponent=1)
    count = mav.MAVLink_mission_count_message(255, 190, 99, mav.MAV_MISSION_TYPE_FENCE)
    frame = count.pack(stranger)
    session.listen(lambda m: m.get_type() == "MISSION_COUNT" and session.feed(b""))
    session.feed(frame)
    assert same_items(ring(5), await transfer.download(Kind.FENCE))
