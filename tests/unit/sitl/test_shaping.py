"""Guided flight with a limited jerk (PSC_JERK_XY), by real bytes."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav


@pytest.fixture
def client(make_client):
    client = make_client(world={"wind_speed_m_s": 3.0, "wind_from_deg": 45.0})
    client.take_off()
    return client


@pytest.mark.parametrize("distance_m", [0.5, 4.0, 20.0, 120.0])
def test_arrives_and_stays(client, distance_m):
    furthest, fastest = 0.0, 0.0

    def watch():
        nonlocal furthest, fastest
        furthest = max(furthest, client.where[0])
        fastest = max(fastest, math.hypot(*client.vehicle.truth.velocity_m_s[:2]))

    client.target(distance_m, 0.0, 12.0)
    client.run(10.0 + distance_m / 4.0, watch)
    east, north, _ = client.where
    assert (east, north) == pytest.approx((distance_m, 0.0), abs=0.15)
    assert furthest - distance_m < 1.0  # a real one passes its target by as much
    assert fastest < 10.6


def test_starts_more_gently(client, make_client):
    direct = make_client()
    direct.send(mav.MAVLink_param_set_message(1, 1, b"PSC_JERK_XY", 0.0, 9))
    direct.take_off()
    after = []
    for one in (client, direct):
        begin = one.where[0]
        one.target(30.0, 0.0, 12.0)
        one.run(1.0)
        after.append(one.where[0] - begin)
    assert 0.2 < after[0] < 0.8 * after[1]


@pytest.mark.parametrize("speed_m_s", [2.0, 8.0])
def test_stops_without_coming_back(client, speed_m_s):
    client.send(mav.MAVLink_param_set_message(1, 1, b"WPNAV_SPEED", 100.0 * speed_m_s, 9))
    client.target(200.0, 0.0, 12.0)
    client.run(12.0)
    begin = client.where[0]
    client.command(mav.MAV_CMD_DO_SET_MODE, 1, mav.COPTER_MODE_BRAKE)
    along = []
    client.run(15.0, lambda: along.append(client.where[0] - begin))
    assert along[-1] < 2.0 * speed_m_s + speed_m_s**2 / 4.0
    assert max(along) - along[-1] < 1.0


def test_a_new_target_on_the_way_and_another_mode(client):
    client.target(60.0, 0.0, 12.0)
    client.run(5.0)
    client.target(10.0, 30.0, 12.0)
    client.run(20.0)
    assert client.where == pytest.approx((10.0, 30.0, 12.0), abs=0.3)
    client.target(60.0, 0.0, 12.0)
    client.run(4.0)
    client.command(mav.MAV_CMD_DO_SET_MODE, 1, mav.COPTER_MODE_BRAKE)
    client.run(10.0)
    assert math.hypot(*client.vehicle.truth.velocity_m_s) < 0.1
    client.command(mav.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    client.run(60.0)
    assert client.vehicle.truth.landed
    assert math.hypot(*client.where[:2]) < 0.5
