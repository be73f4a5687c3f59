"""A session against a peer that follows a script, on virtual time."""

import asyncio

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import CommandRefusedError, LinkError
from missions.units import LatLon
from tests.support.mavlink_peer import Peer, ack, heartbeat, text
from tests.support.running import by, on_virtual_time
from uavmap.base.clock import VirtualClock, run
from uavmap.mavlink.session import ACK_TRIES, ACK_WAIT_S, GROUND_SYSTEM_ID

ARM = mav.MAV_CMD_COMPONENT_ARM_DISARM
LAND = mav.MAV_CMD_NAV_LAND
OK, BUSY = mav.MAV_RESULT_ACCEPTED, mav.MAV_RESULT_TEMPORARILY_REJECTED
DENIED, UNDER_WAY = mav.MAV_RESULT_DENIED, mav.MAV_RESULT_IN_PROGRESS
CAPTURE = mav.MAV_CMD_IMAGE_START_CAPTURE


def conversation(body, **how):
    async def main():
        peer = Peer(**how)
        peer.session.feed(peer.frame(heartbeat()))
        await body(peer)
        assert len(asyncio.all_tasks()) == 1
        return peer

    return run(main(), VirtualClock())


def script(peer, *replies):
    """Answer the n-th command with the n-th reply, later ones with silence.

    The component that was asked answers.
    """
    rest = list(replies)

    def answer(message):
        if message.get_type().startswith("COMMAND_") and rest and (reply := rest.pop(0)):
            peer.send(*reply, component=message.target_component)

    peer.answer = answer


@by(conversation)
async def test_accepted_command_is_sent_once(peer, /):
    script(peer, [ack(ARM, OK)])
    await peer.session.command(ARM, 1)
    ((_, message),) = peer.received
    assert (message.target_system, message.target_component) == (1, 1)
    assert (message.param1, message.param2, message.confirmation) == (1.0, 0.0, 0)
    assert (message.get_srcSystem(), message.get_srcComponent()) == (GROUND_SYSTEM_ID, 191)


@by(conversation)
async def test_command_without_an_answer_is_repeated_with_rising_confirmation(peer, /):
    script(peer, None, None, [ack(ARM, OK)])
    await peer.session.command(ARM, 1)
    assert [c for _, _, c in peer.commands()] == [0, 1, 2]
    times_s = [t_s for t_s, _, _ in peer.commands()]
    assert times_s == pytest.approx([0.0, ACK_WAIT_S, 2 * ACK_WAIT_S], abs=0.01)


@by(conversation)
async def test_command_without_any_answer_is_a_link_error(peer, /):
    with pytest.raises(LinkError, match="MAV_CMD_COMPONENT_ARM_DISARM was not acknowledged"):
        await peer.session.command(ARM, 1)
    assert asyncio.get_running_loop().time() == pytest.approx(ACK_TRIES * ACK_WAIT_S)
    assert [c for _, _, c in peer.commands()] == list(range(ACK_TRIES))


@by(conversation)
async def test_command_in_progress_extends_the_wait(peer, /):
    def answer(message):
        for at_s in (0.1, 0.9, 1.7, 2.5):
            peer.send(ack(ARM, UNDER_WAY), after_s=at_s)
        peer.send(ack(ARM, OK), after_s=3.3)

    peer.answer = answer
    await peer.session.command(ARM, 1)
    assert asyncio.get_running_loop().time() == pytest.approx(3.3)
    assert len(peer.commands()) == 1


@by(conversation)
async def test_command_temporarily_rejected_is_tried_again(peer, /):
    script(peer, [ack(CAPTURE, BUSY)], [ack(CAPTURE, BUSY)], [ack(CAPTURE, OK)])
    await peer.session.command(CAPTURE, 0, 1.0, 5, component=100)
    assert asyncio.get_running_loop().time() > 2 * ACK_WAIT_S
    assert len(peer.commands()) == 3


@by(conversation)
async def test_command_rejected_for_ever_is_an_error(peer, /):
    script(peer, *([[ack(CAPTURE, BUSY)]] * 50))
    with pytest.raises(LinkError):
        await peer.session.command(CAPTURE, 0)
    assert len(peer.commands()) == ACK_TRIES


@pytest.mark.parametrize(
    ("result", "name"),
    [
        (DENIED, "denied"),
        (mav.MAV_RESULT_FAILED, "failed"),
        (mav.MAV_RESULT_UNSUPPORTED, "unsupported"),
        (200, "200"),
    ],
)
@by(conversation)
async def test_refusal_carries_the_text_that_follows(peer, /, result, name):
    def answer(message):
        peer.send(ack(ARM, result), after_s=0.001)
        peer.send(text("PreArm: GPS 1: Bad fix"), after_s=0.2)

    peer.answer = answer
    with pytest.raises(CommandRefusedError) as caught:
        await peer.session.command(ARM, 1)
    assert f"refused: {name}" in str(caught.value)
    assert "PreArm: GPS 1: Bad fix" in str(caught.value)
    assert len(peer.commands()) == 1


@by(conversation)
async def test_refusal_carries_text_of_same_datagram_and_no_old_one(peer, /):
    peer.session.feed(peer.frame(text("Calibrating barometer")))
    await asyncio.sleep(60.0)
    script(peer, [ack(ARM, DENIED), text("Arm: Mode not armable")])
    with pytest.raises(CommandRefusedError) as caught:
        await peer.session.command(ARM, 1)
    assert "Arm: Mode not armable" in str(caught.value)
    assert "Calibrating" not in str(caught.value)


@by(conversation)
async def test_acks_for_others_and_of_other_commands_are_ignored(peer, /):
    script(
        peer,
        [ack(ARM, DENIED, target=255), ack(LAND, OK), ack(LAND, DENIED)],
        [ack(ARM, OK, target=0)],
    )
    await peer.session.command(ARM, 1)
    assert [c for _, _, c in peer.commands()] == [0, 1]


@by(conversation)
async def test_component_that_was_asked_acknowledges_alone(peer, /):
    """An ArduPilot with a camera of its own accepts a command that went to another camera."""

    def answer(message):
        peer.send(ack(message.command, OK), after_s=0.1, component=1)
        peer.send(ack(message.command, DENIED), after_s=0.2, component=180)

    peer.answer = answer
    await peer.session.command(ARM, 1)
    with pytest.raises(LinkError, match="IMAGE_START_CAPTURE was not acknowledged"):
        await peer.session.command(CAPTURE, 0, component=100)


def test_autopilot_that_is_not_component_1_is_asked_at_its_own():
    async def body(peer):
        script(peer, [ack(ARM, OK)], [ack(LAND, OK)])
        await peer.session.command(ARM, 1)
        await peer.session.command_at(LAND, 3, (0, 0, 0, 0), LatLon(47.0, 8.0), 0.0)
        peer.session.request(mav.MAVLINK_MSG_ID_HOME_POSITION)

    peer = conversation(body, component=42)
    assert {message.target_component for _, message in peer.received} == {42}


@by(conversation)
async def test_number_that_does_not_fit_is_a_link_error(peer, /):
    script(peer, [ack(ARM, OK)])
    for lat in (float("nan"), float("inf"), 1e300, 300.0):
        with pytest.raises(LinkError):
            await peer.session.command_at(LAND, 3, (0, 0, 0, 0), LatLon(lat, 8.0), 0.0)
    with pytest.raises(LinkError, match="COMMAND_LONG cannot be sent"):
        peer.session.request(2**300)
    await peer.session.command(ARM, 1)
    assert len(peer.commands()) == 1


@by(on_virtual_time)
async def test_feed_returns_whether_the_vehicle_sent_a_frame():
    peer, other = Peer(), Peer(system=7)
    camera = heartbeat(autopilot=mav.MAV_AUTOPILOT_INVALID)
    assert not peer.session.feed(b"?" * 50)
    assert not peer.session.feed(peer.frame(text("before the first heartbeat")))
    assert not peer.session.feed(peer.frame(camera, 100))
    assert peer.session.feed(peer.frame(heartbeat()))
    assert peer.session.feed(peer.frame(camera, 100))
    assert not peer.session.feed(other.frame(heartbeat()))
    assert not peer.session.feed(peer.frame(heartbeat(99_999)))


@by(conversation)
async def test_commands_at_the_same_time_get_their_own_acks(peer, /):
    def answer(message):
        result = OK if message.command == ARM else DENIED
        peer.send(ack(message.command, result), after_s=0.3)

    peer.answer = answer
    results = await asyncio.gather(
        peer.session.command(ARM, 1),
        peer.session.command(LAND),
        peer.session.command(ARM, 0),
        return_exceptions=True,
    )
    assert results[0] is None
    assert isinstance(results[1], CommandRefusedError)
    assert results[2] is None
    assert [c for _, c, _ in peer.commands()] == [ARM, LAND, ARM]


@by(conversation)
async def test_landing_does_not_wait_for_a_camera_that_does_not_answer(peer, /):
    """Each command of the camera delayed the autopilot's commands by 5 s."""
    peer.answer = lambda message: peer.send(ack(LAND, OK)) if message.command == LAND else None
    camera = asyncio.create_task(peer.session.command(CAPTURE, component=100))
    await asyncio.sleep(0.5)
    await peer.session.command(LAND)
    assert asyncio.get_running_loop().time() < 0.6
    camera.cancel()
    await asyncio.gather(camera, return_exceptions=True)


@by(conversation)
async def test_command_called_off_is_not_repeated_and_blocks_none(peer, /):
    first = asyncio.create_task(peer.session.command(LAND))
    await asyncio.sleep(0.5)
    first.cancel()
    await asyncio.sleep(0)
    script(peer, [ack(ARM, OK)])
    await peer.session.command(ARM, 1)
    await asyncio.sleep(10.0)
    assert [c for _, c, _ in peer.commands()] == [LAND, ARM]


@by(conversation)
async def test_place_is_sent_as_command_int(peer, /):
    script(peer, [ack(mav.MAV_CMD_DO_REPOSITION, OK)])
    nan = float("nan")
    place = LatLon(-33.8567844, 151.2152967)
    await peer.session.command_at(mav.MAV_CMD_DO_REPOSITION, 3, (-1.0, 0.0, 0.0, nan), place, 12.5)
    ((_, message),) = peer.received
    assert message.get_type() == "COMMAND_INT"
    assert (message.x, message.y, message.z) == (-338567844, 1512152967, 12.5)
    assert np.isnan(message.param4)
    assert message.frame == 3


@by(conversation)
async def test_until_waits_for_a_condition_or_the_timeout(peer, /):
    session, loop = peer.session, asyncio.get_running_loop()
    assert await session.until(lambda: True)
    assert not await session.until(lambda: session.view.armed, timeout_s=2.0)
    assert loop.time() == pytest.approx(2.0)
    peer.send(heartbeat(armed=True), after_s=1.0)
    assert await session.until(lambda: session.view.armed, timeout_s=2.0)
    assert loop.time() == pytest.approx(3.0)
    waiting = asyncio.create_task(session.until(lambda: False))
    await asyncio.sleep(1.0)
    waiting.cancel()
    await asyncio.wait([waiting])
    assert session._waiters == []


@by(conversation)
async def test_frames_of_others_are_recorded_but_not_believed(peer, /):
    session, heard = peer.session, []
    session.listen(heard.append)
    other = Peer(system=7)
    recorded = len(peer.frames)
    session.feed(other.frame(heartbeat(mode=6, armed=True)) + other.frame(text("Mayday")))
    assert (session.view.system_id, session.view.mode, session.view.armed) == (1, 4, False)
    assert not session.view.texts
    assert heard == []
    assert len(peer.frames) == recorded + 2


@by(conversation)
async def test_second_component_as_autopilot_changes_nothing(peer, /):
    """Some gimbals and companions send heartbeats with MAV_AUTOPILOT_GENERIC and mode 0."""
    gimbal = Peer(system=1, component=mav.MAV_COMP_ID_GIMBAL)
    peer.session.feed(peer.frame(heartbeat(4, armed=True)))
    peer.session.feed(gimbal.frame(heartbeat(0, autopilot=mav.MAV_AUTOPILOT_GENERIC)))
    view = peer.session.view
    assert (view.mode, view.armed) == (4, True)
    assert view.autopilot == mav.MAV_AUTOPILOT_ARDUPILOTMEGA


@by(conversation)
async def test_garbage_between_frames_loses_no_frame(peer, /):
    rng = np.random.default_rng(5)
    heard = []
    peer.session.listen(heard.append)
    for number in range(200):
        # no start byte in the garbage: it may validly swallow the frame behind it
        noise = rng.integers(0, 0xFD, int(rng.integers(1, 60)), dtype=np.uint8).tobytes()
        frame = peer.frame(text(f"number {number}"))
        cut = int(rng.integers(0, len(frame)))
        peer.session.feed(noise + frame[:cut])
        peer.session.feed(frame[cut:])
    assert [m.text for m in heard] == [f"number {n}" for n in range(200)]


@by(conversation)
async def test_heartbeat_overtaken_on_its_way_changes_nothing(peer, /):
    """Over a link that reorders frames the earlier mode would look like a pilot's."""
    before, after = peer.frame(heartbeat(4)), peer.frame(heartbeat(9))
    peer.session.feed(after)
    peer.session.feed(before)
    assert peer.session.view.mode == 9
    peer.session.feed(peer.frame(heartbeat(6)))
    assert peer.session.view.mode == 6


@by(conversation)
async def test_frames_of_both_directions_are_recorded_whole(peer, /):
    script(peer, [ack(ARM, OK)])
    await peer.session.command(ARM, 1)
    peer.session.heartbeat()
    kinds = []
    for frame in peer.frames:
        (message,) = mav.MAVLink(None).parse_buffer(frame)
        kinds.append((message.get_srcSystem(), message.get_type()))
    assert kinds == [
        (1, "HEARTBEAT"),
        (GROUND_SYSTEM_ID, "COMMAND_LONG"),
        (1, "COMMAND_ACK"),
        (GROUND_SYSTEM_ID, "HEARTBEAT"),
    ]
    numbers = [frame[4] for frame in peer.frames if frame[5] == GROUND_SYSTEM_ID]
    assert numbers == [0, 1]
