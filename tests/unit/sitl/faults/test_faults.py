from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.mission.schema import parse_fields
from missions.units import LatLon
from sitl.body.battery import Battery
from sitl.body.estimator import PositionError
from sitl.body.physics import Body
from sitl.faults.faults import Faults
from sitl.faults.injection import CAMERA_UNIT
from tests.support.small_missions import FAULTS
from tests.unit.sitl.conftest import decoded
from uavmap.runner.simulation import make_vehicles

INJECT = mav.MAV_CMD_INJECT_FAILURE
GPS, BATTERY, MOTOR, COMPASS = (
    mav.FAILURE_UNIT_SENSOR_GPS, mav.FAILURE_UNIT_SYSTEM_BATTERY, mav.FAILURE_UNIT_SYSTEM_MOTOR,
    mav.FAILURE_UNIT_SENSOR_MAG,
)  # fmt: skip
OK, OFF, WRONG = mav.FAILURE_TYPE_OK, mav.FAILURE_TYPE_OFF, mav.FAILURE_TYPE_WRONG


def believed(client):
    client.command(mav.MAV_CMD_REQUEST_MESSAGE, mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT)
    m = client.seen("GLOBAL_POSITION_INT")[-1]
    return client.vehicle.world.plane.to_plane(LatLon(m.lat / 1e7, m.lon / 1e7))


def voltage(client):
    client.command(mav.MAV_CMD_REQUEST_MESSAGE, mav.MAVLINK_MSG_ID_BATTERY_STATUS)
    return client.seen("BATTERY_STATUS")[-1].voltages[0] / 1000.0


def test_faults_begin_and_end_on_vehicle_time():
    faults, error = Faults(), PositionError(np.random.default_rng(1), 0.3, 60.0)
    device = error, Battery(60.0), Body(0.0, 0.0, 0.0, 0.5)
    faults.gps(after_s=1.0, for_s=2.0)
    faults.camera_stall(after_s=2.0)
    seen = []
    for tick in range(1, 81):
        faults.step(tick * 0.05, *device)
        seen.append((error.lost, faults.camera_stalled))
    lost = [n for n, (gps, _) in enumerate(seen, 1) if gps]
    assert (lost[0], lost[-1], len(lost)) == (20, 59, 40)
    assert [n for n, (_, camera) in enumerate(seen, 1) if camera] == list(range(40, 81))
    faults.clear("camera_stall")
    assert not faults.camera_stalled


def test_faults_of_a_kind_add_up_or_the_worst_counts():
    faults = Faults()
    faults.wind_gust(3.0, from_deg=180.0)
    faults.wind_gust(4.0, from_deg=270.0)
    assert faults.gust_m_s == (pytest.approx(4.0), pytest.approx(3.0))
    faults.link(loss=0.1, delay_s=1.0)
    faults.link(loss=0.3, way="up")
    assert (faults.up.loss, faults.down.loss, faults.up.delay_s) == (0.3, 0.1, 1.0)
    faults.clear("link")
    assert faults.up == faults.down == type(faults.up)()
    assert faults.gust_m_s != (0.0, 0.0)
    faults.clear()
    assert faults.gust_m_s == (0.0, 0.0)


@pytest.mark.parametrize(
    ("call", "expected"),
    [
        (lambda f: f.gps(after_s=-1.0), "after_s"),
        (lambda f: f.gps(for_s=float("nan")), "for_s"),
        (lambda f: f.gps_glitch(float("inf")), "not a number"),
        (lambda f: f.motor(2.0), "share"),
        (lambda f: f.link(loss=2.0), "0 to 1"),
        (lambda f: f.link(way="sideways"), "way"),
        (lambda f: f.clear("engine"), "no such kind"),
    ],
)
def test_impossible_faults_are_refused(call, expected):
    with pytest.raises(ValueError, match=expected):
        call(Faults())


def test_estimate_without_satellites_wanders_off_and_comes_back(ready):
    ready.vehicle.fail.gps(for_s=30.0)
    ready.run(29.0)
    assert 5.0 < math.hypot(*believed(ready)) < 40.0
    ready.run(15.0)
    assert math.hypot(*believed(ready)) < 0.6


def test_a_glitch_leads_the_vehicle_astray(flying):
    flying.vehicle.fail.gps_glitch(20.0, toward_deg=90.0)
    flying.run(30.0)
    # by its estimate it holds its place, and is 20 m west of it
    assert believed(flying) == (pytest.approx(0.0, abs=0.5), pytest.approx(0.0, abs=0.5))
    assert flying.where[:2] == (pytest.approx(-20.0, abs=0.5), pytest.approx(0.0, abs=0.5))
    flying.vehicle.fail.clear("gps_glitch")
    flying.run(30.0)
    assert math.hypot(*flying.where[:2]) < 0.5


def test_drift_carries_the_vehicle_away(flying):
    flying.vehicle.fail.gps_drift(1.0, toward_deg=0.0, for_s=20.0)
    flying.run(20.0)
    assert flying.where[1] == pytest.approx(-17.0, abs=3.0)


def test_a_gust_pushes_and_goes(flying):
    flying.vehicle.fail.wind_gust(8.0, for_s=4.0, from_deg=0.0)
    pushed = []
    flying.run(4.0, lambda: pushed.append(flying.where[1]))
    assert min(pushed) < -0.3
    flying.run(15.0)
    assert abs(flying.where[1]) < 0.3


def test_wrong_compass_is_reported_and_flown_by(flying):
    flying.vehicle.fail.compass(40.0)
    flying.run(0.5)
    flying.command(mav.MAV_CMD_REQUEST_MESSAGE, mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT)
    reported = flying.seen("GLOBAL_POSITION_INT")[-1].hdg / 100.0
    yaw = math.degrees(flying.vehicle.truth.yaw_rad)
    assert (reported - yaw) % 360.0 == pytest.approx(40.0, abs=0.1)
    flying.target(60.0, 0.0, 12.0)
    aside = []
    flying.run(15.0, lambda: aside.append(flying.where[1]))
    assert max(map(abs, aside)) > 1.0  # a curve instead of a line


def test_battery_sag_and_dead_cell_lower_the_voltage(ready):
    full = voltage(ready)
    ready.vehicle.fail.battery_sag(3.0, for_s=5.0)
    ready.run(1.0)
    assert voltage(ready) == pytest.approx(full - 3.0, abs=0.01)
    ready.run(5.0)
    assert voltage(ready) == pytest.approx(full, abs=0.01)
    ready.vehicle.fail.battery_cell()
    ready.run(1.0)
    assert voltage(ready) == pytest.approx(full * 5 / 6, abs=0.01)
    assert ready.vehicle.truth.energy_wh == pytest.approx(50.0, abs=0.1)
    # the autopilot counts the charge that flows, and does not know
    assert ready.seen("BATTERY_STATUS")[-1].battery_remaining == 100


def test_vehicle_without_a_motor_is_lost_and_its_motors_turn_on(flying):
    """SIM_ENGINE_FAIL at 12 m: it stays armed, in LAND, and bounces at 2 to 3 m/s for 138 s."""
    flying.vehicle.fail.motor(after_s=2.0)
    flying.run(1.9)
    assert flying.where[2] == pytest.approx(12.0, abs=0.5)
    flying.run(6.0)
    truth = flying.vehicle.truth
    assert (truth.crashed, truth.armed, truth.landed) == (True, True, True)
    assert flying.every(30, 0.1) == flying.every(33, 0.1) == flying.every(245, 0.5) == 0
    assert flying.result(mav.MAV_CMD_NAV_LAND) == 0
    flying.run(138.0)
    assert flying.vehicle.truth.armed
    assert flying.seen("EXTENDED_SYS_STATE")[-1].landed_state == mav.MAV_LANDED_STATE_LANDING
    assert max(abs(m.vz) for m in flying.seen("GLOBAL_POSITION_INT")[-20:]) > 200
    assert flying.result(mav.MAV_CMD_COMPONENT_ARM_DISARM, 0) == mav.MAV_RESULT_FAILED
    assert flying.result(mav.MAV_CMD_COMPONENT_ARM_DISARM, 0, 21196) == 0
    assert not flying.vehicle.truth.armed


def test_a_sag_is_the_packs_and_ends_with_a_swap(make_client):
    client = make_client(swap_after_s=5.0)
    client.take_off()
    client.vehicle.fail.battery_sag(3.0)
    client.vehicle.fail.battery_sag(1.0, after_s=500.0)
    client.run(1.0)
    before_v = voltage(client)
    assert client.result(mav.MAV_CMD_NAV_LAND) == 0
    client.run(40.0)
    assert client.vehicle.truth.swaps == 1
    assert voltage(client) > before_v + 2.9
    assert [f.numbers for f in client.vehicle.fail.scheduled] == [(1.0,)]


def test_vehicle_with_a_weak_motor_still_flies(flying):
    flying.vehicle.fail.motor(share=0.6)
    flying.run(10.0)
    assert flying.where[2] == pytest.approx(12.0, abs=0.5)


def capture(client):
    client.command(mav.MAV_CMD_IMAGE_START_CAPTURE, 0, 0, 1)
    client.run(1.0)
    return client.seen("CAMERA_IMAGE_CAPTURED")


def test_a_stalled_camera_accepts_and_takes_none(flying):
    flying.vehicle.fail.camera_stall(for_s=5.0)
    assert flying.result(mav.MAV_CMD_IMAGE_START_CAPTURE, 0, 1.0, 0) == mav.MAV_RESULT_ACCEPTED
    flying.run(4.8)
    assert flying.seen("CAMERA_IMAGE_CAPTURED") == []
    flying.run(3.0)
    assert 2 <= len(flying.seen("CAMERA_IMAGE_CAPTURED")) <= 4


def test_camera_faults_make_black_and_broken_pictures(flying):
    flying.vehicle.fail.camera_black(for_s=0.9)
    capture(flying)
    flying.vehicle.fail.camera_corrupt(for_s=0.9)
    capture(flying)
    urls = [m.file_url for m in capture(flying)]
    night, broken, good = (flying.vehicle.image(url) for url in urls)
    assert good[:2] == night[:2] == b"\xff\xd8"
    assert decoded(good).mean() > 50.0
    dark = decoded(night, cv2.IMREAD_COLOR)
    assert (dark.shape, dark.max()) == ((480, 640, 3), 0)
    assert not broken.endswith(b"\xff\xd9")
    assert 0 < len(broken) < len(good)


def test_a_command_is_rejected_for_a_while(ready):
    ready.vehicle.fail.reject(mav.MAV_CMD_DO_SET_MODE, mav.MAV_RESULT_TEMPORARILY_REJECTED, 0, 2.0)
    assert ready.result(mav.MAV_CMD_DO_SET_MODE, 1, 4) == mav.MAV_RESULT_TEMPORARILY_REJECTED
    ready.run(2.1)
    assert ready.result(mav.MAV_CMD_DO_SET_MODE, 1, 4) == mav.MAV_RESULT_ACCEPTED


def test_silent_link_sends_and_receives_nothing(ready):
    ready.vehicle.fail.link(silent=True, for_s=5.0)
    assert ready.run(4.9) == []
    assert ready.command(mav.MAV_CMD_DO_SET_MODE, 1, 4) == []
    assert ready.vehicle.truth.mode == 0
    assert ready.run(3.0) != []


def test_companion_comes_back_to_its_setup(ready):
    ready.every(mav.MAVLINK_MSG_ID_ATTITUDE, 0.1)
    ready.vehicle.fail.companion_reboot(after_s=1.0, for_s=10.0)
    ready.run(1.2)
    assert ready.vehicle.fail.reboots == 1
    assert ready.run(9.5) == []
    ready.run(2.0)
    assert len(ready.seen("ATTITUDE")) == pytest.approx(10 + 17, abs=1)


# --- over the wire -----------------------------------------------------------------------------


def test_injection_needs_the_parameter(make_client):
    client = make_client()
    client.run(1.0)
    assert client.result(INJECT, GPS, OFF) == mav.MAV_RESULT_DENIED
    client.put(SYS_FAILURE_EN=1.0)
    assert client.result(INJECT, GPS, OFF) == mav.MAV_RESULT_ACCEPTED
    client.run(0.1)
    assert client.vehicle._error.lost
    assert client.result(INJECT, GPS, OK) == mav.MAV_RESULT_ACCEPTED
    client.run(0.1)
    assert not client.vehicle._error.lost
    for unit, failure in ((GPS, 77), (99, OFF), (math.nan, OFF), (GPS, math.inf)):
        assert client.result(INJECT, unit, failure) == mav.MAV_RESULT_UNSUPPORTED


@pytest.mark.parametrize(
    ("unit", "failure", "kind"),
    [
        (BATTERY, OFF, "battery_sag"),
        (MOTOR, OFF, "motor"),
        (COMPASS, WRONG, "compass"),
        (CAMERA_UNIT, OFF, "camera_stall"),
        (CAMERA_UNIT, WRONG, "camera_black"),
        (CAMERA_UNIT, mav.FAILURE_TYPE_GARBAGE, "camera_corrupt"),
    ],
)
def test_injected_failure_has_its_kind(make_client, unit, failure, kind):
    client = make_client()
    client.put(SYS_FAILURE_EN=1.0)
    assert client.result(INJECT, unit, failure) == mav.MAV_RESULT_ACCEPTED
    assert [f.kind for f in client.vehicle.fail.active(kind)] == [kind]


def test_simulator_parameters_cause_faults(ready):
    vehicle = ready.vehicle
    ready.put(SIM_GPS_DISABLE=1.0)
    ready.run(0.1)
    assert vehicle._error.lost
    ready.put(SIM_GPS_DISABLE=0.0)
    ready.put(SIM_GPS1_ENABLE=0.0)
    ready.run(0.1)
    assert vehicle._error.lost
    ready.put(SIM_GPS1_ENABLE=1.0)
    ready.run(0.1)
    assert not vehicle._error.lost
    ready.put(SIM_BATT_VOLTAGE=20.0)
    ready.run(0.1)
    assert voltage(ready) == pytest.approx(20.0)
    ready.put(SIM_WIND_SPD=5.0)
    ready.put(SIM_WIND_DIR=270.0)
    assert vehicle.fail.gust_m_s == (pytest.approx(5.0), pytest.approx(0.0, abs=1e-9))
    ready.put(SIM_GPS_GLITCH_Y=0.0001)
    ready.run(30.0)
    assert believed(ready)[0] == pytest.approx(11.1, abs=0.3)
    ready.put(SIM_RC_FAIL=1.0)
    assert vehicle.fail.rc_lost
    before = ready.seen("PARAM_VALUE")
    ready.put(SIM_SPEEDUP=5.0)
    answer = ready.seen("PARAM_VALUE")[len(before)]
    assert (answer.param_id, answer.param_value) == ("SIM_SPEEDUP", 1.0)


def test_simulator_parameters_stop_a_motor(flying):
    flying.put(SIM_ENGINE_MUL=0.0)
    flying.run(3.0)
    assert flying.where[2] == pytest.approx(12.0, abs=0.5)
    flying.put(SIM_ENGINE_FAIL=1.0)
    flying.run(6.0)
    assert flying.vehicle.truth.crashed


# --- a scenario in a mission file ---------------------------------------------------------------

MISSION = """
[start]
position = [48.0, 11.0]
[search]
box = [[48.0, 11.0], [48.001, 11.0], [48.001, 11.001], [48.0, 11.001]]
[fence]
polygon = [[47.999, 10.999], [48.002, 10.999], [48.002, 11.002], [47.999, 11.002]]
"""


def scenario(*faults):
    return MISSION + "".join(f"[[sim.faults]]\n{fault}\n" for fault in faults)


def kinds(vehicle):
    return [(f.kind, f.begin_s, f.end_s) for f in vehicle.fail.scheduled]


def test_a_scenario_reaches_its_vehicle():
    mission = parse_fields(
        scenario(
            'at_s = 60\nfor_s = 20\nkind = "gps"',
            'at_s = 10\nkind = "battery_sag"\nvolts = 2',
            'at_s = 5\nkind = "gps"\nvehicle = 2',
        ),
        "x.toml",
    )
    (vehicle,) = make_vehicles(mission, seed=1)
    assert kinds(vehicle) == [("gps", 60.0, 80.0), ("battery_sag", 10.0, math.inf)]
    (later,) = make_vehicles(mission, seed=1, start_s=65.0)
    assert kinds(later) == [("gps", 0.0, 15.0), ("battery_sag", 0.0, math.inf)]
    (last,) = make_vehicles(mission, seed=1, start_s=100.0)
    assert kinds(last) == [("battery_sag", 0.0, math.inf)]


@pytest.mark.parametrize(
    ("kind", "values"),
    [*FAULTS.items(), ("motor", ""), ("wind_gust", "m_s = 5\nfrom_deg = 90"),
     ("reject", "command = 22\nresult = 2"), ("link", "loss = 0.2\njitter_s = 0.1"),
     ("link", "silent = true")],
)  # fmt: skip
def test_every_kind_can_be_written(kind, values):
    mission = parse_fields(scenario(f'at_s = 3\nkind = "{kind}"\n{values}'), "x.toml")
    (vehicle,) = make_vehicles(mission, seed=1)
    assert vehicle.fail.scheduled
    assert all(f.begin_s == 3.0 for f in vehicle.fail.scheduled)
    vehicle.step(4.0)
