from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.copter.params import INT8, INT16, INT32, REAL32, TABLE, Parameters

BY_NAME = Parameters().by_name


def read(client, name):
    return client.send(mav.MAVLink_param_request_read_message(1, 1, name, -1))


def put(client, name, value):
    return client.send(mav.MAVLink_param_set_message(1, 1, name, value, 9))


def test_whole_list_comes_in_order(make_client):
    client = make_client()
    listed = client.send(mav.MAVLink_param_request_list_message(1, 1))
    assert [m.param_index for m in listed] == list(range(len(TABLE)))
    assert {m.param_count for m in listed} == {len(TABLE)}
    for m in listed:
        assert len(m.param_id) <= 16
        assert m.param_type == BY_NAME[m.param_id].type
    assert len(TABLE) >= 55


def test_a_new_value_is_the_answer(make_client):
    client = make_client()
    (answer,) = put(client, b"WPNAV_SPEED", 512.5)
    assert (answer.param_id, answer.param_value) == ("WPNAV_SPEED", 512.5)
    assert put(client, b"RTL_ALT", -1500.9)[0].param_value == -1500.0
    assert put(client, b"FENCE_ACTION", 300.0)[0].param_value == 127.0
    assert put(client, b"WPNAV_SPEED", 1e30)[0].param_value == pytest.approx(1e30)  # no range


def test_impossible_values_and_unknown_names_have_no_answer(make_client):
    client = make_client()
    for value in (math.nan, math.inf, -math.inf):
        assert put(client, b"WPNAV_SPEED", value) == []
    assert put(client, b"NO_SUCH", 1.0) == []
    assert read(client, b"NO_SUCH") == []
    assert client.send(mav.MAVLink_param_request_read_message(1, 1, b"", len(TABLE))) == []


def test_parameters_that_the_autopilot_owns_stay(make_client):
    client = make_client()
    assert put(client, b"MIS_TOTAL", 5.0)[0].param_value == 0.0
    assert put(client, b"SYSID_THISMAV", 9.0)[0].param_value == 1.0


def test_a_burst_of_reads_is_too_much(make_client):
    client = make_client()
    answered = sum(len(read(client, b"RTL_ALT")) for _ in range(40))
    assert answered == 24
    client.run(0.05)
    assert len(read(client, b"RTL_ALT")) == 1


def test_the_capacity_is_the_packs(make_client):
    client = make_client(battery_wh=100.0)
    capacity_mah = read(client, b"BATT_CAPACITY")[0].param_value
    assert capacity_mah == pytest.approx(100.0 / 22.8 * 1000.0, abs=1.0)


@given(name=st.sampled_from([p.name for p in TABLE]), value=st.floats())
def test_values_stay_within_their_type(name, value):
    parameters = Parameters()
    before = parameters[name]
    accepted = parameters.set(name, value)
    assert accepted == math.isfinite(value)
    now = parameters[name]
    if not accepted or BY_NAME[name].fixed:
        assert now == before
        return
    bits = {INT8: 7, INT16: 15, INT32: 31}
    if BY_NAME[name].type == REAL32:
        assert math.isfinite(now)
        assert abs(now) <= 3.4028235e38
    else:
        assert now == int(now)
        assert -(2 ** bits[BY_NAME[name].type]) <= now < 2 ** bits[BY_NAME[name].type]


def test_changes_by_the_autopilot_are_reported_once():
    parameters = Parameters()
    parameters.change("MIS_TOTAL", 4)
    parameters.change("MIS_TOTAL", 5)
    parameters.change("RALLY_TOTAL", 0)
    assert parameters.unsent == ["MIS_TOTAL"]
