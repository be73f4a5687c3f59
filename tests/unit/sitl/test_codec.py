from __future__ import annotations

import random
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl import codec
from sitl.codec import Packer, int16, int32, layout, uint16

# each kind that is streamed, with the number of its fields that telemetry fills in
KINDS = {
    "heartbeat": 6, "sys_status": 13, "battery_status": 11, "system_time": 2, "gps_raw_int": 13,
    "attitude": 7, "local_position_ned": 7, "global_position_int": 9, "mission_current": 4,
    "fence_status": 4, "gps_global_origin": 3, "vfr_hud": 6, "position_target_global_int": 14,
    "autopilot_version": 11, "wind": 3, "ekf_status_report": 7, "home_position": 11,
    "extended_sys_state": 2,
}  # fmt: skip
BITS = {"int8_t": 8, "int16_t": 16, "int32_t": 32, "int64_t": 64}


def values_of(kind, at):
    """Draw a value of a field: any bits of its type, and often zeros."""
    name, length = kind.fieldtypes[at], kind.array_lengths[kind.orders[at]]
    if name == "float":
        one = st.one_of(st.just(0.0), st.just(-0.0), st.floats(width=32))
    else:
        bits = BITS[name.removeprefix("u")]
        low, high = (
            (0, 2**bits - 1) if name[0] == "u" else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
        )
        one = st.one_of(st.just(0), st.sampled_from([low, high]), st.integers(low, high))
    return st.lists(one, min_size=length, max_size=length) if length else one


@pytest.mark.parametrize("name", KINDS)
@settings(max_examples=25)
@given(data=st.data())
def test_a_frame_is_pymavlinks_frame(name, data):
    kind, count = getattr(mav, f"MAVLink_{name}_message"), KINDS[name]
    fields = [data.draw(values_of(kind, at)) for at in range(count)]
    system, component = data.draw(st.integers(1, 255)), data.draw(st.integers(1, 255))
    others, ours = mav.MAVLink(None, system, component), Packer(system, component)
    flat = [x for field in fields for x in (field if isinstance(field, list) else [field])]
    for sequence in range(2):
        others.seq = sequence
        assert ours.pack(getattr(codec, name)(*flat)) == kind(*fields).pack(others)


def test_every_frame_of_a_flight_is_pymavlinks_frame(make_client):
    client = make_client(world={"wind_speed_m_s": 3.0, "gust_m_s": 1.0})
    streamed = [getattr(mav, f"MAVLINK_MSG_ID_{name.upper()}") for name in KINDS]
    for number in streamed:
        client.every(number, 0.2)
    client.send(mav.MAVLink_param_request_list_message(1, 1))
    client.send(mav.MAVLink_param_set_message(1, 1, b"FENCE_ENABLE", 1.0, mav.MAV_PARAM_TYPE_INT8))
    client.take_off(10.0)
    client.target(5.0, 5.0, 12.0)
    client.command(mav.MAV_CMD_IMAGE_START_CAPTURE, 0, 1.0, 2)
    client.run(4.0)
    ids = set()
    for _, message in client.log:
        ids.add(message.get_msgId())
        frame = bytes(message.get_msgbuf())
        out = mav.MAVLink(None, message.get_srcSystem(), message.get_srcComponent())
        out.seq = message.get_seq()
        assert message.pack(out) == frame, message.get_type()
    assert ids >= {*streamed, mav.MAVLINK_MSG_ID_PARAM_VALUE}
    assert ids >= {mav.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED, mav.MAVLINK_MSG_ID_COMMAND_ACK}


def test_a_wrong_number_of_values_is_an_error():
    for pack in (codec.attitude, codec.vfr_hud):  # in order, and not
        for count in (0, 5, 8):
            with pytest.raises(struct.error):
                pack(*[0] * count)


def test_fields_left_out_have_to_be_the_last_of_the_payload():
    with pytest.raises(ValueError, match="VFR_HUD"):
        layout(mav.MAVLink_vfr_hud_message, 3)


def test_a_text_is_one_value():
    number, _, payload = layout(mav.MAVLink_statustext_message, 2)(6, b"hello")
    assert (number, payload) == (253, b"\x06hello" + b"\0" * 45)


def test_the_checksum_is_the_same_without_the_c_function():
    random_bytes = random.Random(1).randbytes
    for size in range(60):
        data = random_bytes(size)
        slow = mav._x25crc_slow(data).crc
        assert codec._checksum(data) == codec._x25(data) == slow


@given(st.floats(-1e12, 1e12))
def test_numbers_are_held_to_their_fields(value):
    for function, low, high in (
        (int16, -(2**15), 2**15 - 1),
        (uint16, 0, 2**16 - 1),
        (int32, -(2**31), 2**31 - 1),
    ):
        assert function(value) == max(low, min(high, round(value)))
