"""Messages in MAVSDK's JSON, the pieces of the pipe, and frames that may leave the outbox."""

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mav

from uavmap.mavlink.mavsdk.driver_pipe import MAX_BYTES, Pieces, frames_piece, object_piece
from uavmap.mavlink.mavsdk.mavsdk_session import Outbox, fields_of, message_of

_BITS = {"int8_t": 8, "int16_t": 16, "int32_t": 32, "int64_t": 64}
_KINDS = sorted(mav.mavlink_map)


def _number(kind):
    if kind == "double":
        return st.floats(allow_infinity=False)
    if kind == "float":
        return st.floats(width=32, allow_infinity=False)
    if kind.startswith("u"):
        return st.integers(0, 2 ** _BITS[kind[1:].removesuffix("_mavlink_version")] - 1)
    return st.integers(-(2 ** (_BITS[kind] - 1)), 2 ** (_BITS[kind] - 1) - 1)


@st.composite
def messages(draw):
    made = mav.mavlink_map[draw(st.sampled_from(_KINDS))]
    lengths = dict(zip(made.ordered_fieldnames, made.array_lengths, strict=True))
    values = []
    for name, kind in zip(made.fieldnames, made.fieldtypes, strict=True):
        if kind == "char":
            text = draw(st.text("abcXYZ_09:/.", max_size=lengths[name] or 1))
            values.append(text.encode())
        elif lengths[name]:
            values.append([draw(_number(kind)) for _ in range(lengths[name])])
        else:
            values.append(draw(_number(kind)))
    codec = mav.MAVLink(None, srcSystem=3, srcComponent=7)
    (message,) = mav.MAVLink(None).parse_buffer(made(*values).pack(codec))
    return message


@given(messages())
def test_message_through_json_is_unchanged(message):
    told = json.loads(json.dumps(fields_of(message)))
    back = message_of(message.get_type(), 3, 7, told)
    assert str(back) == str(message)
    assert (back.get_srcSystem(), back.get_srcComponent()) == (3, 7)
    assert back.get_msgId() == message.get_msgId()


def test_number_that_is_nan_is_null_in_json():
    message = mav.MAVLink_command_long_message(1, 1, 22, 0, 0, 0, 0, *[math.nan] * 3, 12.0)
    told = fields_of(message)
    assert [told[f"param{i}"] for i in (1, 4, 7)] == [0, None, 12.0]
    back = message_of("COMMAND_LONG", 1, 1, told)
    assert math.isnan(back.param4)


@given(st.dictionaries(st.sampled_from(["type", "autopilot", "custom_mode"]), st.none()))
def test_whole_number_that_is_missing_makes_no_message(fields):
    assert (message_of("HEARTBEAT", 1, 1, fields) is None) == bool(fields)


@given(st.lists(st.binary(max_size=40)), st.integers(1, 7))
def test_pieces_of_a_stream_come_out_unchanged(parts, size):
    stream = b"".join(frames_piece(part) + object_piece({"n": len(part)}) for part in parts)
    pieces = Pieces()
    out = [
        piece
        for begin in range(0, len(stream), size)
        for piece in pieces.feed(stream[begin : begin + size])
    ]
    assert [content for letter, content in out if letter == b"F"] == parts
    assert [json.loads(c)["n"] for letter, c in out if letter == b"W"] == [*map(len, parts)]


@pytest.mark.parametrize("data", [b"x1234", b"F" + (MAX_BYTES + 1).to_bytes(4, "little")])
def test_invalid_piece_is_a_value_error(data):
    with pytest.raises(ValueError, match="no piece"):
        list(Pieces().feed(data))


class _Ends:
    def __init__(self):
        self.sent = []
        self.outbox = Outbox(self.sent.append)
        self._codec = mav.MAVLink(None, 245, 191)

    def wants(self, *messages):
        """Have MAVSDK offer frames; return how many passed."""
        before = len(self.sent)
        for message in messages:
            self.outbox.forward(message.pack(self._codec))
        return len(self.sent) - before


def _command(command):
    return mav.MAVLink_command_long_message(1, 1, command, 0, *[0.0] * 7)


def test_command_passes_while_it_is_asked_for_and_no_other():
    ends = _Ends()
    arm, mode = (_command(c) for c in (mav.MAV_CMD_COMPONENT_ARM_DISARM, mav.MAV_CMD_DO_SET_MODE))
    assert ends.wants(arm) == 0
    with ends.outbox.permitting(arm.command):
        assert ends.wants(arm, arm, mode) == 2
        with ends.outbox.permitting(arm.command):
            pass
        assert ends.wants(arm) == 1
    assert ends.wants(arm) == 0
    assert ends.outbox.held_back == {"COMMAND_LONG": 3}


class _Permit:
    left = 2

    async def wait_for_grant(self):
        raise AssertionError

    def grants(self):
        self.left -= 1
        return self.left >= 0


def test_each_copy_of_a_mode_that_mavsdk_repeats_takes_a_permit():
    ends, mode = _Ends(), _command(mav.MAV_CMD_DO_SET_MODE)
    with ends.outbox.permitting(mode.command, _Permit()):
        assert ends.wants(mode, mode, mode) == 2
    assert ends.wants(mode) == 0


def test_message_passes_as_often_as_it_was_handed_over():
    ends = _Ends()
    target = mav.MAVLink_set_position_target_global_int_message(0, 1, 1, 6, 0, *[0] * 11)
    ends.outbox.once(target)
    assert ends.wants(target, target) == 1
    ends.outbox.once(target)
    ends.outbox.not_sent(target)
    assert ends.wants(target) == 0
    ends.outbox.not_sent(target)  # it had left before MAVSDK died: the next one passes
    ends.outbox.once(target)
    assert ends.wants(target) == 1


def test_mavsdk_by_itself_may_only_request_messages():
    ends = _Ends()
    assert ends.wants(_command(mav.MAV_CMD_REQUEST_MESSAGE)) == 1
    assert (
        ends.wants(
            mav.MAVLink_heartbeat_message(0, 8, 0, 0, 0, 3),
            mav.MAVLink_ping_message(0, 0, 0, 0),
            mav.MAVLink_param_request_list_message(1, 1),
            _command(mav.MAV_CMD_SET_MESSAGE_INTERVAL),
        )
        == 0
    )
    ends.outbox.forward(b"\xfd\x09 no frame at all")
    assert len(ends.sent) == 1
