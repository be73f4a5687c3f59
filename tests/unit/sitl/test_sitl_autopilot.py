from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.codec import Framer
from sitl.copter.modes import Mode
from sitl.quirks import Quirks
from tests.unit.sitl.conftest import plain_vehicle

ACCEPTED, DENIED = mav.MAV_RESULT_ACCEPTED, mav.MAV_RESULT_DENIED
UNSUPPORTED, FAILED = mav.MAV_RESULT_UNSUPPORTED, mav.MAV_RESULT_FAILED
ARM, MODE, TAKEOFF = (
    mav.MAV_CMD_COMPONENT_ARM_DISARM, mav.MAV_CMD_DO_SET_MODE, mav.MAV_CMD_NAV_TAKEOFF,
)  # fmt: skip


def types(messages):
    return {m.get_type() for m in messages}


def test_vehicle_is_silent_but_for_heartbeats_until_asked(make_client):
    client = make_client()
    messages = client.run(30.0)
    assert types(messages) == {"HEARTBEAT", "TIMESYNC", "GPS_GLOBAL_ORIGIN", "HOME_POSITION"}
    # one in the first step, then one every full second
    assert len(client.seen("HEARTBEAT", 1)) == 31
    assert len(client.seen("HEARTBEAT", 100)) == 31
    assert len(client.seen("HOME_POSITION")) == 1
    first = client.seen("HEARTBEAT", 1)[0]
    assert (first.autopilot, first.type) == (mav.MAV_AUTOPILOT_ARDUPILOTMEGA, 2)
    assert first.system_status == mav.MAV_STATE_ACTIVE
    assert client.seen("HEARTBEAT", 1)[-1].system_status == mav.MAV_STATE_STANDBY


def test_vehicle_becomes_ready_in_order(make_client):
    client = make_client(ready_after_s=5.0)
    for message_id in (mav.MAVLINK_MSG_ID_SYS_STATUS, mav.MAVLINK_MSG_ID_EKF_STATUS_REPORT):
        assert client.every(message_id, 0.1) == ACCEPTED
    assert client.result(ARM, 1) == FAILED
    client.run(8.0)
    prearm = next(
        t for t, m in client.log
        if m.get_type() == "SYS_STATUS"
        and m.onboard_control_sensors_health & mav.MAV_SYS_STATUS_PREARM_CHECK
    )  # fmt: skip
    usable = next(
        t for t, m in client.log
        if m.get_type() == "EKF_STATUS_REPORT" and m.flags & 0x10 and not m.flags & 0x80
    )  # fmt: skip
    assert prearm < usable == pytest.approx(5.0, abs=0.15)
    assert client.result(ARM, 1) == ACCEPTED


def test_whole_flight_arms_flies_and_lands(ready):
    ready.every(mav.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, 0.2)
    ready.every(mav.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT, 0.5)
    changed = ready.command(MODE, 1, 4)
    assert [m.get_type() for m in changed] == ["COMMAND_ACK", "HEARTBEAT"]  # at once
    assert (changed[1].base_mode, changed[1].custom_mode) == (89, 4)
    assert ready.result(ARM, 1) == ACCEPTED
    assert ready.seen("HEARTBEAT", 1)[-1].base_mode == 89  # the armed bit comes with the next
    assert ready.result(TAKEOFF, 0, 0, 0, 0, 0, 0, 12) == ACCEPTED
    assert ready.result(TAKEOFF, 0, 0, 0, 0, 0, 0, 12) == ACCEPTED  # again until airborne
    ready.run(4.0)
    assert ready.seen("HEARTBEAT", 1)[-1].base_mode == 217
    assert ready.result(TAKEOFF, 0, 0, 0, 0, 0, 0, 12) == FAILED
    ready.run(9.0)
    assert ready.reposition(30.0, 0.0, 612.0, frame=0) == ACCEPTED  # AMSL
    ready.run(12.0)
    assert ready.where == pytest.approx((30.0, 0.0, 12.0), abs=0.2)
    targets = ready.seen("POSITION_TARGET_GLOBAL_INT")
    assert targets[-1].alt == pytest.approx(612.0, abs=0.01)
    assert ready.result(mav.MAV_CMD_NAV_RETURN_TO_LAUNCH) == ACCEPTED
    assert ready.seen("HEARTBEAT", 1)[-1].custom_mode == 6
    highest = max(where[2] for where, _ in ready.watch(60.0))
    truth = ready.vehicle.truth
    assert highest == pytest.approx(15.0, abs=0.2)  # RTL_ALT
    assert truth.landed
    assert not truth.armed
    assert math.hypot(*ready.where[:2]) < 0.5
    states = [m.landed_state for m in ready.seen("EXTENDED_SYS_STATE")]
    assert [a for a, b in pairwise([0, *states, 0]) if a != b][1:] == [1, 3, 2, 4, 1]
    assert ready.seen("HEARTBEAT", 1)[-1].custom_mode == 6  # it stays in RTL
    assert ready.result(ARM, 1) == FAILED
    assert ready.result(MODE, 1, 4) == ACCEPTED
    assert ready.result(ARM, 1) == ACCEPTED


def test_targets_are_dropped_outside_guided_flight(ready):
    assert ready.target(10.0, 0.0, 12.0) == []
    assert ready.reposition(10.0, 0.0, 12.0) == DENIED  # STABILIZE
    ready.take_off()
    ready.command(MODE, 1, mav.COPTER_MODE_BRAKE)
    assert ready.target(10.0, 0.0, 12.0) == []
    ready.run(5.0)
    assert abs(ready.where[0]) < 0.1
    assert ready.reposition(10.0, 0.0, 12.0) == DENIED
    flag = mav.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
    assert ready.reposition(10.0, 0.0, 12.0, flags=flag) == ACCEPTED
    ready.run(8.0)
    assert ready.where[0] == pytest.approx(10.0, abs=0.2)


def test_a_target_during_take_off_takes_over(ready):
    ready.command(MODE, 1, 4)
    ready.command(ARM, 1)
    ready.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 30)
    ready.run(6.0)
    ready.target(5.0, 0.0, 8.0)
    ready.run(10.0)
    assert ready.where == pytest.approx((5.0, 0.0, 8.0), abs=0.3)


def test_reposition_needs_a_command_int(flying):
    result = flying.result(mav.MAV_CMD_DO_REPOSITION, -1, 0, 0, math.nan, 37.2, -80.4, 612)
    assert result == mav.MAV_RESULT_COMMAND_INT_ONLY


@pytest.mark.parametrize("mode", ["LOITER", "POSHOLD", "ALT_HOLD", "STABILIZE"])
def test_modes_by_hand_with_centred_sticks_keep_the_height(make_client, mode):
    """LOITER, BRAKE, POSHOLD, STABILIZE were set on a path at 6 m/s; all were accepted."""
    client = make_client(world={"wind_speed_m_s": 3.0, "wind_from_deg": 270.0})
    client.take_off()
    assert client.result(MODE, 1, Mode[mode]) == ACCEPTED
    before = client.where
    client.run(10.0)
    assert client.vehicle.truth.mode == Mode[mode]
    assert client.where[2] == pytest.approx(before[2], abs=0.5)
    assert (client.where[0] - before[0] > 5.0) == (mode in ("ALT_HOLD", "STABILIZE"))


@pytest.mark.parametrize("mode", ["LOITER", "POSHOLD"])
def test_throttle_without_radio_control_reads_zero(make_client, mode):
    client = make_client(quirks=Quirks(stick=False))
    client.take_off()
    assert client.result(MODE, 1, Mode.STABILIZE) == FAILED
    assert client.result(MODE, 1, Mode[mode]) == ACCEPTED
    client.run(20.0)
    assert client.vehicle.truth.landed


NAN = math.nan
YAW, START, PAUSE, FENCE, RATE, SHOOT = 115, 300, 193, 207, 511, 203
SPEED, ITEM, HOME, ASK_RATE, ASK = 178, 224, 179, 510, 512


@pytest.mark.parametrize(
    ("command", "p", "result"),
    [
        (ARM, (0.5,), UNSUPPORTED), (ARM, (0.0,), ACCEPTED), (MODE, (0, 4), DENIED),
        (MODE, (1, 99), FAILED), (TAKEOFF, (0, 0, 0, 0, 0, 0, NAN), FAILED),
        (YAW, (90, 0, 1, 0), FAILED), (YAW, (NAN,), DENIED), (START, (1,), DENIED),
        (PAUSE, (2,), DENIED), (FENCE, (2,), FAILED), (RATE, (30, NAN), DENIED),
        (ASK_RATE, (99999,), DENIED), (ASK_RATE, (30,), ACCEPTED), (ASK, (99999,), FAILED),
        (ASK, (NAN,), DENIED), (SHOOT, (0, 0, 0, 0, 0), ACCEPTED),
        (SHOOT, (0, 0, 0, 0, 1), ACCEPTED),
        (SPEED, (7, 1.0), DENIED), (SPEED, (1, NAN), DENIED), (ITEM, (NAN,), DENIED),
        (HOME, (1,), ACCEPTED), (HOME, (0, 0, 0, 0, 91, 0, 0), FAILED),
        (HOME, (0, 0, 0, 0, 0, 0, 0), FAILED), (HOME, (0, 0, 0, 0, 37.2, -80.4, 650), ACCEPTED),
    ],
)  # fmt: skip
def test_a_command_on_the_ground_has_its_answer(ready, command, p, result):
    assert ready.result(command, *p) == result


def test_the_nose_is_turned_in_flight_and_a_stream_only_followed_where_it_may(flying):
    assert flying.result(ARM, 1) == ACCEPTED  # it is
    assert flying.result(YAW, 90, 0, 1, 0) == ACCEPTED
    flying.run(4.0)
    assert flying.result(YAW, 30, 0, -1, 1) == ACCEPTED
    flying.run(4.0)
    assert math.degrees(flying.vehicle.truth.yaw_rad) == pytest.approx(60.0, abs=2.0)
    flying.put(FENCE_ENABLE=1.0)
    for _ in range(10):
        flying.along((500.0, 0.0), (3.0, 0.0))  # outside the fence
        flying.run(0.1)
    assert flying.result(MODE, 1, Mode.BRAKE) == ACCEPTED
    for _ in range(10):
        flying.along((5.0, 0.0), (3.0, 0.0))
        flying.run(0.1)
    assert abs(flying.where[0]) < 0.1


def test_vehicle_answers_messages_to_its_own_numbers_alone(make_client):
    client = make_client()
    assert client.command(ARM, 1, system=2) == []
    assert client.command(ARM, 1, component=154) == []
    assert client.result(511, 30, 1e6, system=0, component=0) == ACCEPTED
    assert client.result(511, 30, 1e6, component=100) == UNSUPPORTED  # the camera has no such
    assert client.result(31000) == UNSUPPORTED


def test_requested_rates_are_exact(ready):
    assert ready.every(mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, 0.1) == ACCEPTED
    assert ready.every(mav.MAVLINK_MSG_ID_ATTITUDE, 1.0) == ACCEPTED
    assert ready.every(77777, 1.0) == DENIED
    messages = ready.run(10.0)
    kinds = [m.get_type() for m in messages]
    assert kinds.count("GLOBAL_POSITION_INT") == 100
    assert kinds.count("ATTITUDE") == 10
    assert ready.result(511, mav.MAVLINK_MSG_ID_ATTITUDE, -1) == ACCEPTED
    assert "ATTITUDE" not in types(ready.run(3.0))


def test_data_streams_need_no_ack(ready):
    assert ready.send(mav.MAVLink_request_data_stream_message(1, 1, 0, 4, 1)) == []
    kinds = [m.get_type() for m in ready.run(5.0)]
    assert kinds.count("GLOBAL_POSITION_INT") == 20
    assert "EXTENDED_SYS_STATE" not in kinds  # in no stream


def test_requested_message_is_sent_once(make_client):
    client = make_client()
    assert client.result(mav.MAV_CMD_REQUEST_MESSAGE, 242) == FAILED  # home not known yet
    client.run(6.0)
    for command, p, kind in (
        (mav.MAV_CMD_REQUEST_MESSAGE, 148, "AUTOPILOT_VERSION"),
        (mav.MAV_CMD_REQUEST_MESSAGE, 242, "HOME_POSITION"),
        (mav.MAV_CMD_REQUEST_MESSAGE, 245, "EXTENDED_SYS_STATE"),
        (mav.MAV_CMD_REQUEST_MESSAGE, 259, "CAMERA_INFORMATION"),
        (mav.MAV_CMD_GET_HOME_POSITION, 0, "HOME_POSITION"),
    ):
        answer = client.command(command, p)
        assert [m.get_type() for m in answer] == ["COMMAND_ACK", kind]
    home = client.seen("HOME_POSITION")[-1]
    assert (home.latitude, home.longitude, home.altitude) == (372000000, -804000000, 600000)
    assert client.seen("CAMERA_INFORMATION")[0].get_srcComponent() == 100
    version = client.seen("AUTOPILOT_VERSION")[0]
    assert version.capabilities & mav.MAV_PROTOCOL_CAPABILITY_MISSION_INT


def test_ping_timesync_and_file_transfer_are_answered(make_client):
    client = make_client()
    client.run(2.0)
    (pong,) = client.send(mav.MAVLink_ping_message(123, 5, 0, 0))
    assert (pong.time_usec, pong.seq, pong.target_system) == (123, 5, 255)
    (sync,) = client.send(mav.MAVLink_timesync_message(0, 42))
    assert (sync.ts1, sync.tc1) == (42, 2_000_000_000)
    request = [7, 0, 0, 3, *([0] * 247)]
    (nak,) = client.send(mav.MAVLink_file_transfer_protocol_message(0, 1, 1, request))
    assert nak.payload[3] == 129
    assert nak.payload[0] == 8


def test_battery_messages_agree(make_client):
    client = make_client(battery_wh=10.0, hover_power_w=300.0)
    client.take_off(5.0)
    client.every(mav.MAVLINK_MSG_ID_BATTERY_STATUS, 1.0)
    client.every(mav.MAVLINK_MSG_ID_SYS_STATUS, 1.0)
    client.run(40.0)
    battery, status = client.seen("BATTERY_STATUS")[-1], client.seen("SYS_STATUS")[-1]
    used_wh = 10.0 - client.vehicle.truth.energy_wh
    assert battery.energy_consumed * 100 / 3600 == pytest.approx(used_wh, rel=0.02)
    assert battery.battery_remaining == status.battery_remaining == int(10 * (10.0 - used_wh))
    assert battery.current_consumed / 1000 * status.voltage_battery / 1000 == pytest.approx(
        used_wh, rel=0.1
    )


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_same_seed_and_bytes_give_the_same_bytes(make_client, autopilot):
    """The bytes also agree through a bad link and without satellites."""

    def flight(seed):
        client = make_client(
            world={"seed": seed, "gust_m_s": 1.0}, gps_sigma_m=0.4, autopilot=autopilot,
            optical_flow=True,
        )  # fmt: skip
        client.every(mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, 0.1)
        client.run(6.0)
        client.command(MODE, 1, 4)
        client.command(ARM, 1)
        client.command(TAKEOFF, 0, 0, 0, NAN, NAN, NAN, 12.0)
        client.run(8.0)
        client.reposition(7.0, 3.0, 612.0, frame=0)
        client.command(mav.MAV_CMD_IMAGE_START_CAPTURE, 0, 1, 3, 0)
        client.vehicle.fail.gps(after_s=2.0)
        client.vehicle.fail.link(0.2, 0.1, 0.1, 0.05, 0.1, 0.05, after_s=1.0)
        garbled = b"".join(client.vehicle.step(0.05) for _ in range(200))
        assert len(garbled) > 3000
        return [bytes(m.get_msgbuf()) for _, m in client.log], garbled, client.vehicle.truth

    assert flight(1) == flight(1) != flight(2)


@given(noise=st.binary(max_size=300), cut=st.integers(0, 40))
def test_frames_are_found_in_any_pieces(noise, cut):
    link = mav.MAVLink(None, 255, 1)
    good = mav.MAVLink_ping_message(1, 2, 0, 0).pack(link)
    framer = Framer()
    messages = framer.feed(noise.replace(b"\xfd", b"").replace(b"\xfe", b""))
    cut = min(cut, len(good))
    messages += framer.feed(good[:cut])
    messages += framer.feed(good[cut:] + good)
    assert [m.get_type() for m in messages] == ["PING", "PING"]


def test_a_corrupt_frame_does_not_hide_the_next():
    link = mav.MAVLink(None, 255, 1)
    good = mav.MAVLink_ping_message(1, 2, 0, 0).pack(link)
    bad = bytearray(good)
    bad[1] = 40  # its length covers the good frame behind it
    assert len(Framer().feed(bytes(bad) + good + bytes(64))) == 1


_NUMBERS = st.one_of(
    st.floats(width=32),
    st.sampled_from([math.nan, math.inf, -math.inf, 0.0, -1.0, 1.0, 65535.0, 3.4e38, 21196.0]),
)
_HANDLED = [16, 20, 21, 22, 112, 115, 176, 178, 192, 400, 410, 510, 511, 512, 520, 521, 2000, 2001]


@settings(max_examples=40)
@given(data=st.data())
def test_hostile_values_do_no_harm(data):
    """Any numbers in any handled message give an answer or silence, and a sane state."""
    vehicle = plain_vehicle()
    vehicle.step(6.0)
    link = mav.MAVLink(None, 255, 1)
    draw = data.draw
    for _ in range(draw(st.integers(1, 8))):
        number = draw(st.sampled_from(_HANDLED))
        p = draw(st.tuples(*[_NUMBERS] * 7))
        kind = draw(st.integers(0, 4))
        if kind == 0:
            message = mav.MAVLink_command_long_message(0, 0, number, 0, *p)
        elif kind == 1:
            x, y = draw(st.tuples(*[st.integers(-(2**31), 2**31 - 1)] * 2))
            frame = draw(st.sampled_from([0, 3, 5, 6, 10, 11, 77]))
            message = mav.MAVLink_command_int_message(1, 1, frame, number, 0, 0, *p[:4], x, y, p[6])
        elif kind == 2:
            x, y = draw(st.tuples(*[st.integers(-(2**31), 2**31 - 1)] * 2))
            mask = draw(st.integers(0, 0xFFFF))
            message = mav.MAVLink_set_position_target_global_int_message(
                0, 1, 1, 6, mask, x, y, *p, 0.0, 0.0
            )
        elif kind == 3:
            name = draw(st.sampled_from([b"RTL_ALT", b"WPNAV_SPEED", b"RTL_CONE_SLOPE", b"\xff"]))
            message = mav.MAVLink_param_set_message(1, 1, name, p[0], 9)
        else:
            message = mav.MAVLink_request_data_stream_message(
                1, 1, draw(st.integers(0, 255)), draw(st.integers(0, 65535)), 1
            )
        vehicle.receive(message.pack(link))
        vehicle.step(0.5)
    vehicle.receive(mav.MAVLink_command_long_message(1, 1, 176, 0, 1, 4, 0, 0, 0, 0, 0).pack(link))
    vehicle.receive(mav.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0).pack(link))
    vehicle.receive(mav.MAVLink_command_long_message(1, 1, 22, 0, 0, 0, 0, 0, 0, 0, 5).pack(link))
    vehicle.step(5.0)
    truth = vehicle.truth
    assert all(map(math.isfinite, (*truth.velocity_m_s, truth.height_m, truth.yaw_rad)))
    assert math.hypot(*truth.velocity_m_s) < 60.0
