from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

MODE, ARM = 176, 400
GUIDED, RTL, LAND, BRAKE = 4, 6, 9, 17
CRITICAL = mav.MAV_STATE_CRITICAL


def when(client, mode):
    return next(
        t for t, m in client.log
        if m.get_type() == "HEARTBEAT" and m.type == 2 and m.custom_mode == mode
    )  # fmt: skip


def last_heartbeat(client):
    return client.seen("HEARTBEAT", 1)[-1]


def beat(client, seconds, kind=mav.MAV_TYPE_GCS):
    for _ in range(round(seconds)):
        client.send(mav.MAVLink_heartbeat_message(kind, 8, 0, 0, 4, 3))
        client.run(1.0)


def test_failsafe_that_is_disabled_on_a_real_autopilot_does_not_act(flying):
    beat(flying, 2)
    flying.run(20.0)
    assert last_heartbeat(flying).custom_mode == GUIDED
    assert last_heartbeat(flying).system_status == mav.MAV_STATE_ACTIVE


def test_low_battery_returns_after_ten_seconds_then_critical_lands(make_client):
    client = make_client()
    client.every(mav.MAVLINK_MSG_ID_BATTERY_STATUS, 0.5)
    client.put(BATT_FS_LOW_ACT=2, BATT_FS_CRT_ACT=1, BATT_LOW_VOLT=5.0)
    client.take_off()
    client.target(30.0, 0.0, 12.0)
    client.run(10.0)
    begin_s = client.vehicle.t_s
    client.put(BATT_LOW_VOLT=25.0)  # as good as a sag
    client.run(9.5)
    assert last_heartbeat(client).custom_mode == GUIDED
    client.run(1.0)
    assert when(client, RTL) - begin_s == pytest.approx(10.0, abs=0.2)
    assert last_heartbeat(client).system_status == CRITICAL
    assert client.seen("BATTERY_STATUS")[-1].charge_state == 2
    assert any(text.startswith("Battery 1 is low 2") for text in client.texts)
    # GUIDED is accepted in a failsafe, and it does not act twice
    assert client.result(MODE, 1, GUIDED) == 0
    client.run(15.0)
    assert last_heartbeat(client).custom_mode == GUIDED
    client.put(BATT_CRT_MAH=1e6)
    client.run(0.1)
    assert last_heartbeat(client).custom_mode == LAND
    client.run(1.0)
    assert client.seen("BATTERY_STATUS")[-1].charge_state == 3
    client.run(40.0)
    assert client.vehicle.truth.landed
    client.command(MODE, 1, GUIDED)
    refused = client.command(ARM, 1)
    assert refused[0].result == 4
    assert refused[1].text == "Arm: Battery 1 low voltage failsafe"


def test_a_fresh_battery_ends_the_failsafe(make_client):
    client = make_client(swap_after_s=20.0)
    client.put(BATT_FS_CRT_ACT=1)
    client.take_off()
    client.put(BATT_CRT_MAH=1e6)
    client.run(40.0)
    assert not client.vehicle.truth.armed
    assert last_heartbeat(client).system_status == CRITICAL
    client.put(BATT_CRT_MAH=0)
    client.run(22.0)
    assert client.vehicle.truth.swaps == 1
    assert last_heartbeat(client).system_status == mav.MAV_STATE_STANDBY
    client.command(MODE, 1, GUIDED)
    assert client.result(ARM, 1) == 0


def test_a_silent_ground_station_brings_it_home(make_client):
    client = make_client()
    client.put(FS_GCS_ENABLE=1)
    client.take_off()
    client.run(10.0)  # never received: no failsafe
    assert last_heartbeat(client).custom_mode == GUIDED
    beat(client, 3)
    begin_s = client.vehicle.t_s - 1.0
    client._out.srcSystem = 1  # a companion computer does not mask it
    beat(client, 8, mav.MAV_TYPE_ONBOARD_CONTROLLER)
    client._out.srcSystem = 255
    assert when(client, RTL) - begin_s == pytest.approx(5.0, abs=0.11)
    assert last_heartbeat(client).system_status == CRITICAL
    assert client.texts[-1] == "GCS Failsafe"
    beat(client, 2)
    assert last_heartbeat(client).system_status == mav.MAV_STATE_ACTIVE
    assert client.texts[-1] == "GCS Failsafe Cleared"
    assert last_heartbeat(client).custom_mode == RTL


@pytest.mark.parametrize(
    ("settings", "beats", "kind", "then"),
    [
        ({"FS_GCS_ENABLE": 5, "SYSID_MYGCS": 7}, 3, mav.MAV_TYPE_GCS, GUIDED),  # another's beats
        ({"FS_GCS_ENABLE": 5}, 1, mav.MAV_TYPE_GCS, LAND),
        # as measured: its station is known by its number and not by its type
        ({"FS_GCS_ENABLE": 1}, 8, mav.MAV_TYPE_ONBOARD_CONTROLLER, RTL),
    ],
)
def test_ground_station_is_known_by_its_number(make_client, settings, beats, kind, then):
    client = make_client()
    client.put(**settings)
    client.take_off()
    beat(client, beats, kind)
    client.run(6.0)
    assert last_heartbeat(client).custom_mode == then


def test_vehicle_without_satellites_lands_after_eight_seconds(make_client):
    client = make_client(world={"wind_speed_m_s": 3.0, "wind_from_deg": 270.0})
    client.every(mav.MAVLINK_MSG_ID_GPS_RAW_INT, 0.5)
    client.every(mav.MAVLINK_MSG_ID_EKF_STATUS_REPORT, 0.5)
    client.take_off(20.0)
    client.run(5.0)
    begin_s = client.vehicle.t_s
    client.vehicle.fail.gps()
    client.run(0.6)
    assert last_heartbeat(client).custom_mode == GUIDED
    client.run(9.0)
    assert when(client, LAND) - begin_s == pytest.approx(8.0, abs=0.2)
    assert client.seen("GPS_RAW_INT")[-1].fix_type < 3
    assert client.seen("EKF_STATUS_REPORT")[-1].flags & 0x80
    assert last_heartbeat(client).system_status == CRITICAL
    assert "EKF Failsafe: changed to LAND Mode" in client.texts
    assert client.result(MODE, 1, GUIDED) == 4  # requires position
    client.run(45.0)
    assert client.vehicle.truth.landed
    assert not client.vehicle.truth.crashed
    assert client.where[0] > 5.0  # nothing holds it against the wind
    assert client.result(ARM, 1) == 4


def test_loss_of_radio_control_returns(flying):
    flying.vehicle.fail.rc()
    flying.run(1.0)
    assert last_heartbeat(flying).custom_mode == RTL
    assert last_heartbeat(flying).system_status == CRITICAL
    assert flying.result(MODE, 1, GUIDED) == 0


# --- the fence --------------------------------------------------------------------------------


def fence(client, *zones):
    """Set zones: (command, first parameter, corners in metres)."""
    rows = [(command, 0, (p,), corner, 0) for command, p, corners in zones for corner in corners]
    client.upload(rows, kind=1)


INSIDE, OUTSIDE_OF, OUTSIDE_CIRCLE = 5001, 5002, 5004
SQUARE = ((-20.0, -20.0), (20.0, -20.0), (20.0, 20.0), (-20.0, 20.0))


def test_targets_outside_the_fence_are_dropped_silently(flying):
    hole = ((5.0, 5.0), (15.0, 5.0), (15.0, 15.0), (5.0, 15.0))
    fence(flying, (INSIDE, 4.0, SQUARE), (OUTSIDE_OF, 4.0, hole),
          (OUTSIDE_CIRCLE, 3.0, ((-10.0, 0.0),)))  # fmt: skip
    flying.put(FENCE_ENABLE=1)
    for east, north, height in (
        (25.0, 0.0, 12.0), (10.0, 10.0, 12.0), (-10.0, 1.0, 12.0), (0.0, 0.0, 120.0),
    ):  # fmt: skip
        assert flying.target(east, north, height) == []
        assert flying.reposition(east, north, height) == mav.MAV_RESULT_FAILED
    flying.run(4.0)
    assert math.hypot(*flying.where[:2]) < 0.2
    assert flying.reposition(0.0, 15.0, 12.0) == 0
    assert flying.result(207, 0) == 0
    assert flying.reposition(25.0, 0.0, 12.0) == 0


@pytest.mark.parametrize(("action", "mode"), [(0, GUIDED), (1, RTL), (2, LAND), (4, BRAKE)])
def test_a_breach_acts_once(make_client, action, mode):
    client = make_client()
    client.put(FENCE_ACTION=action)
    client.every(mav.MAVLINK_MSG_ID_FENCE_STATUS, 0.2)
    client.every(mav.MAVLINK_MSG_ID_SYS_STATUS, 0.2)
    client.take_off()
    client.run(1.0)
    assert client.seen("FENCE_STATUS") == []
    client.target(25.0, 0.0, 12.0)
    fence(client, (INSIDE, 4.0, SQUARE))
    assert client.result(207, 1) == 0
    reported = [m.param_id for m in client.run(0.1) if m.get_type() == "PARAM_VALUE"]
    assert "FENCE_ENABLE" in reported
    client.run(1.0)
    assert client.seen("FENCE_STATUS")[-1].breach_status == 0
    while client.where[0] < 20.0:
        client.run(0.05)
    client.run(0.3)
    status = client.seen("FENCE_STATUS")[-1]
    assert (status.breach_status, status.breach_count, status.breach_type) == (1, 1, 3)
    assert last_heartbeat(client).custom_mode == mode
    assert "Polygon fence breached" in client.texts
    health = client.seen("SYS_STATUS")[-1].onboard_control_sensors_health
    assert not health & mav.MAV_SYS_STATUS_GEOFENCE
    assert client.result(MODE, 1, GUIDED) == 0
    client.run(2.0)
    assert last_heartbeat(client).custom_mode == GUIDED


def test_fence_of_height_and_radius_refuses_targets_and_returns(make_client):
    client = make_client()
    client.put(FENCE_ENABLE=1, FENCE_RADIUS=30.0, FENCE_ALT_MAX=40.0)
    client.take_off()
    assert client.reposition(31.0, 0.0, 12.0) == mav.MAV_RESULT_FAILED
    assert client.reposition(0.0, 0.0, 41.0) == mav.MAV_RESULT_FAILED
    client.put(FENCE_ALT_MAX=8.0)
    client.run(0.1)
    assert last_heartbeat(client).custom_mode == RTL
    assert "Max Alt fence breached" in client.texts


def test_arming_outside_the_fence_is_refused(ready):
    fence(ready, (INSIDE, 4.0, tuple((e + 50.0, n) for e, n in SQUARE)))
    ready.put(FENCE_ENABLE=1)
    ready.command(MODE, 1, GUIDED)
    refused = ready.command(ARM, 1)
    assert refused[0].result == 4
    assert refused[1].text == "PreArm: vehicle outside Polygon fence"
    assert ready.command(401)[1].text == refused[1].text
