from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.copter.mission_items import FENCE, MISSION, RALLY, Item
from sitl.copter.transfer import Transfer

ACCEPTED, CANCELLED = mav.MAV_MISSION_ACCEPTED, mav.MAV_MISSION_OPERATION_CANCELLED
WP, TAKEOFF, RTL = mav.MAV_CMD_NAV_WAYPOINT, mav.MAV_CMD_NAV_TAKEOFF, 20


def item(seq, command=WP, *, kind=0, p=(0, 0, 0, 0), x=372000000, y=-804000000, z=12.0, frame=6):
    return mav.MAVLink_mission_item_int_message(
        1, 1, seq, frame, command, 0, 1, *map(float, p), x, y, z, kind
    )


def count(n, kind=0):
    return mav.MAVLink_mission_count_message(1, 1, n, kind)


@pytest.fixture
def client(ready):
    return ready


def test_a_mission_goes_up_and_comes_down(client):
    items = [item(i, x=372000000 + i, z=10.0 + i, p=(i, 0, 0, math.nan)) for i in range(60)]
    assert client.transfer(items) == ACCEPTED
    assert client.seen("STATUSTEXT")[-1].text == "Flight plan received"
    assert {m.get_type() for m in client.seen("MISSION_REQUEST")} == {"MISSION_REQUEST"}
    reported = [m for m in client.run(0.1) if m.get_type() == "PARAM_VALUE"]
    assert [(m.param_id, m.param_value, m.param_index) for m in reported] == [
        ("MIS_TOTAL", 60, 65535)
    ]
    back = client.fetch()
    assert len(back) == 60
    # item 0 is always home
    assert (back[0].command, back[0].frame, back[0].z) == (WP, 0, 600.0)
    for sent, got in zip(items[1:], back[1:], strict=True):
        assert (got.seq, got.x, got.y, got.z) == (sent.seq, sent.x, sent.y, sent.z)
        assert (got.param1, got.frame, got.command) == (sent.param1, 6, WP)
    floats = client.fetch(exact=False)
    assert floats[5].get_type() == "MISSION_ITEM"
    assert floats[5].x == pytest.approx(37.2000005, abs=1e-5)


def test_old_clients_send_floats(client):
    old = [
        mav.MAVLink_mission_item_message(1, 1, i, 3, WP, 0, 1, 0, 0, 0, 0, 37.25, -80.4, 12.0)
        for i in range(2)
    ]
    assert client.transfer(old) == ACCEPTED
    assert client.fetch()[1].x == pytest.approx(372500000, abs=20)


def test_missing_items_are_asked_for_again_every_second(client):
    client.send(count(3))
    client.send(item(0))
    asked = [m.seq for m in client.run(3.0) if m.get_type() == "MISSION_REQUEST"]
    assert asked == [1, 1, 1]


def test_a_stalled_upload_leaves_a_truncated_mission(client):
    assert client.transfer([item(i) for i in range(5)]) == ACCEPTED
    client.send(count(10))
    client.send(item(0))
    client.send(item(1))
    begin_s = client.vehicle.t_s
    client.run(9.0)
    (ack,) = [(t, m) for t, m in client.log if m.get_type() == "MISSION_ACK" and t > begin_s]
    assert ack[1].type == CANCELLED
    assert ack[0] - begin_s == pytest.approx(8.0, abs=0.06)
    assert client.seen("STATUSTEXT")[-1].text == "Mission upload timeout"
    assert len(client.fetch()) == 2


def test_a_duplicate_last_item_is_acknowledged_again(client):
    assert client.transfer([item(0), item(1)]) == ACCEPTED
    (ack,) = client.send(item(1))
    assert (ack.get_type(), ack.type) == ("MISSION_ACK", ACCEPTED)
    (ack,) = client.send(item(0))
    assert ack.type == mav.MAV_MISSION_ERROR


def test_second_copies_are_refused_and_the_upload_goes_on(client):
    """`MissionItemProtocol.cpp`: INVALID_SEQUENCE, and it still waits for the requested item."""
    client.send(count(3))
    client.send(item(0))
    (ack,) = client.send(item(0))
    assert ack.type == mav.MAV_MISSION_INVALID_SEQUENCE
    (ack,) = client.send(item(2))
    assert ack.type == mav.MAV_MISSION_INVALID_SEQUENCE
    client.send(item(1))
    assert client.send(item(2))[0].type == ACCEPTED


def test_a_second_copy_of_the_count_does_not_begin_again(client):
    client.send(count(3))
    client.send(item(0))
    client.run(0.9)
    (request,) = client.send(count(3))
    assert (request.get_type(), request.seq) == ("MISSION_REQUEST", 1)
    client.send(item(1, x=371000000))
    assert client.send(item(2))[0].type == ACCEPTED
    assert [m.x for m in client.fetch()[1:]] == [371000000, 372000000]


@pytest.mark.parametrize(
    ("pause_s", "begin"), [(0.0, count(4)), (0.0, count(3, RALLY)), (1.1, count(3))]
)
def test_another_count_begins_again_and_after_a_silence_the_same(client, pause_s, begin):
    client.send(count(3))
    client.send(item(0))
    client.run(pause_s)
    (request,) = client.send(begin)
    assert (request.seq, request.mission_type) == (0, begin.mission_type)


@pytest.mark.parametrize(
    ("bad", "result"),
    [
        (item(1, mav.MAV_CMD_NAV_VTOL_LAND), mav.MAV_MISSION_UNSUPPORTED),
        (item(1, frame=1), mav.MAV_MISSION_UNSUPPORTED_FRAME),
        (item(1, p=(math.nan, 0, 0, 0)), mav.MAV_MISSION_INVALID_PARAM1),
        (item(1, p=(0, 0, math.inf, 0)), mav.MAV_MISSION_INVALID_PARAM3),
        (item(1, p=(0, 0, 0, math.inf)), mav.MAV_MISSION_INVALID_PARAM4),
        (item(1, x=900000001), mav.MAV_MISSION_INVALID_PARAM5_X),
        (item(1, y=-1800000001), mav.MAV_MISSION_INVALID_PARAM6_Y),
        (item(1, z=math.nan), mav.MAV_MISSION_INVALID_PARAM7),
        (item(1, z=3e38), mav.MAV_MISSION_INVALID_PARAM7),
    ],
)
def test_invalid_items_are_refused_with_a_reason(client, bad, result):
    assert client.transfer([item(0), bad, item(2)]) == result
    assert len(client.fetch()) == 1


def test_invalid_requests_are_refused_with_a_reason(client):
    assert client.send(count(65535))[0].type == mav.MAV_MISSION_NO_SPACE
    assert client.send(count(1, 7))[0].type == mav.MAV_MISSION_UNSUPPORTED
    partial = mav.MAVLink_mission_write_partial_list_message(1, 1, 0, 1)
    assert client.send(partial)[0].type == mav.MAV_MISSION_UNSUPPORTED
    request = mav.MAVLink_mission_request_int_message(1, 1, 3)
    assert client.send(request)[0].type == mav.MAV_MISSION_INVALID_SEQUENCE
    assert client.send(mav.MAVLink_mission_request_list_message(2, 1)) == []
    client.send(count(2))
    listing = mav.MAVLink_mission_request_list_message(1, 1)
    assert client.send(listing)[0].type == mav.MAV_MISSION_DENIED


def test_clearing_removes_missions_and_rally_points(client):
    client.run(0.1)
    assert client.transfer([item(i) for i in range(3)]) == ACCEPTED
    assert client.transfer([item(0, 5100, kind=RALLY)], RALLY) == ACCEPTED
    (ack,) = client.send(mav.MAVLink_mission_clear_all_message(1, 1, 255))
    assert (ack.type, ack.mission_type) == (ACCEPTED, 255)
    assert client.fetch() == client.fetch(RALLY) == []
    assert client.send(count(0))[0].type == ACCEPTED


def square(kind=mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, n=4):
    corners = [(0, 0), (0, 9000), (9000, 9000), (9000, 0)]
    return [
        item(i, kind, kind=FENCE, p=(n, 0, 0, 0), x=372000000 + a, y=-804000000 + b, z=0.0)
        for i, (a, b) in enumerate(corners)
    ]


def test_a_fence_takes_effect_only_when_complete(client):
    assert client.transfer(square(), FENCE) == ACCEPTED
    back = client.fetch(FENCE)
    assert [m.param1 for m in back] == [4.0] * 4
    # a polygon that is not finished is refused as a whole, and the old fence stays
    assert client.transfer(square(n=5), FENCE) == mav.MAV_MISSION_INVALID
    client.send(count(4, FENCE))
    client.send(square()[0])
    client.run(9.0)
    assert len(client.fetch(FENCE)) == 4
    circle = item(0, mav.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION, kind=FENCE, p=(-1, 0, 0, 0))
    assert client.transfer([circle], FENCE) == mav.MAV_MISSION_INVALID_PARAM1


def test_another_client_cannot_break_into_an_upload(client):
    client.send(count(3))
    other = mav.MAVLink(None, 77, 190)
    mine = mav.MAVLink(None)
    answers = mine.parse_buffer(client.vehicle.receive(count(2).pack(other)))
    assert answers[0].type == mav.MAV_MISSION_DENIED
    assert client.send(item(0))[0].seq == 1


_VALUE = st.one_of(st.floats(width=32), st.sampled_from([math.nan, math.inf, 3.4e38, 0.0, 65535.0]))
_WIDE = st.integers(-(2**31), 2**31 - 1)
_KIND = st.sampled_from([0, 0, 0, 1, 2, 7, 255])
_COMMAND = st.one_of(
    st.integers(0, 65535),
    st.sampled_from([16, 17, 19, 20, 21, 22, 82, 93, 112, 114, 115, 177, 178, 203, 206, 207, 2000,
                     5000, 5001, 5002, 5003, 5004, 5100]),
)  # fmt: skip


@st.composite
def _message(draw):
    kind, seq = draw(_KIND), draw(st.integers(0, 6))
    choice = draw(st.integers(0, 6))
    if choice == 0:
        return count(draw(st.sampled_from([0, 1, 2, 5, 65535])), kind)
    if choice == 1:
        return mav.MAVLink_mission_clear_all_message(1, 1, kind)
    if choice == 2:
        return mav.MAVLink_mission_request_int_message(1, 1, draw(st.integers(0, 65535)), kind)
    if choice == 3:
        return mav.MAVLink_mission_set_current_message(1, 1, draw(st.integers(0, 65535)))
    p = draw(st.tuples(*[_VALUE] * 4))
    command, frame = draw(_COMMAND), draw(st.sampled_from([0, 2, 3, 5, 6, 10, 11, 99]))
    if choice == 4:
        x, y = draw(st.tuples(_VALUE, _VALUE))
        return mav.MAVLink_mission_item_message(
            1, 1, seq, frame, command, 0, 1, *p, x, y, draw(_VALUE), kind
        )
    return mav.MAVLink_mission_item_int_message(
        1, 1, seq, frame, command, 0, 1, *p, draw(_WIDE), draw(_WIDE), draw(_VALUE), kind
    )


@settings(max_examples=150, deadline=None)
@given(messages=st.lists(_message(), max_size=25), pauses=st.lists(st.floats(0, 9), max_size=25))
def test_any_messages_leave_a_sane_state(messages, pauses):
    plans, changes = {MISSION: [], FENCE: [], RALLY: []}, []
    transfer = Transfer(
        plans=plans, home=lambda: Item(WP), running=lambda: False, changed=changes.append,
        send_text=lambda *_: None,
    )  # fmt: skip
    link, now_s = mav.MAVLink(None, 255, 190), 0.0
    for i, message in enumerate(messages):
        parsed = mav.MAVLink(None).parse_buffer(message.pack(link))[0]
        if parsed.get_type() in transfer.handled:
            for answer in transfer.receive(parsed, now_s):
                answer.pack(mav.MAVLink(None, 1, 1))
        if i < len(pauses):
            now_s += pauses[i]
            for answer in transfer.step(now_s):
                answer.pack(mav.MAVLink(None, 1, 1))
    for kept in (i for items in plans.values() for i in items):
        assert all(math.isfinite(v) for v in (*kept.p[:3], kept.z))
    assert len(plans[MISSION]) <= 65535
    assert set(changes) <= {MISSION, FENCE, RALLY}
