from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.body.estimator import DeadReckoning, Estimator, PositionError
from tests.unit.sitl.copter.test_route import UP, WP, Planner, row
from tests.unit.sitl.piloted import (
    ABSOLUTE,
    AUTOPILOTS,
    CONSTANT,
    RELATIVE,
    VELOCITY,
    fleet_in_the_air,
    in_the_air,
    piloted,
)


def straight(seed, drift, legs, dt_s=0.05, speed_m_s=5.0):
    """Return the error after legs (bearing, metres) flown by optical flow alone."""
    error = Estimator(np.random.default_rng(1), 0.0, 60.0, seed=[seed], flow=True, drift=drift)
    error.disturb(lost=True, glitch_m=(0.0, 0.0), drift_m_s=(0.0, 0.0))
    for bearing, metres in legs:
        v_east, v_north = speed_m_s * math.sin(bearing), speed_m_s * math.cos(bearing)
        for _ in range(round(metres / (speed_m_s * dt_s))):
            error.move(dt_s, v_east, v_north)
    return error


# --- the model ---------------------------------------------------------------------------------


def test_a_straight_leg_errs_by_the_stated_share():
    lengths = [math.hypot(e.east, e.north) for e in (straight(s, 0.02, [(0.5, 200.0)])
               for s in range(60))]  # fmt: skip
    assert math.sqrt(np.mean(np.square(lengths))) == pytest.approx(0.02 * 200.0, rel=0.2)
    assert max(lengths) < 4.0 * 0.02 * 200.0


def test_error_of_a_flight_out_and_back_cancels_out_but_for_a_little():
    back = [straight(s, 0.02, [(0.0, 100.0), (math.pi, 100.0)]) for s in range(20)]
    assert np.mean([math.hypot(e.east, e.north) for e in back]) < 0.3 * 0.02 * 200.0


def test_each_outage_has_a_scale_and_a_rotation_of_its_own():
    flow = DeadReckoning([3], drift=0.02)
    seen = set()
    for _ in range(5):
        flow.begin()
        seen.add(round(flow.error_m_s(100.0, 0.0, 0.05)[0], 1))
    assert len(seen) > 2


@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 1000),
    drift=st.floats(0.0, 0.5),
    legs=st.lists(st.tuples(st.floats(0.0, 6.0), st.floats(0.0, 30.0)), max_size=4),
    received=st.lists(
        st.tuples(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0), st.floats(0.0, 1e9)), max_size=3
    ),
)
def test_the_error_is_finite_and_within_the_stated_share(seed, drift, legs, received):
    error = straight(seed, drift, legs, dt_s=0.05)
    flown_m = sum(metres for _, metres in legs)
    bound_m = DeadReckoning.MOST * drift * flown_m + 0.1 * (flown_m / 5.0) + 0.01
    assert math.hypot(error.east, error.north) <= bound_m
    assert math.isfinite(error.accuracy_m)
    for east, north, sigma in received:
        error.fuse(east, north, sigma)
        error.move(0.05, 1.0, 0.0)
        bound_m = max(bound_m, math.hypot(east, north)) + 1.0
        assert math.hypot(error.east, error.north) <= bound_m


def test_estimate_with_satellites_is_the_same_number_for_number():
    plain = PositionError(np.random.default_rng(4), 0.5, 30.0)
    flow = Estimator(np.random.default_rng(4), 0.5, 30.0, flow=True)
    for _ in range(200):
        plain.step(0.05)
        flow.move(0.05, 3.0, 1.0)
        assert (plain.east, plain.north, plain.up) == (flow.east, flow.north, flow.up)


# --- flown -------------------------------------------------------------------------------------


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_vehicle_without_satellites_flies_on_and_drifts_as_stated(autopilot):
    fleet = fleet_in_the_air(autopilot, vehicles=4, seed=3)
    for vehicle in fleet:
        vehicle.fail.gps()
    fleet.run(0.2)
    for vehicle in fleet:
        vehicle.fly_to(*(a + b for a, b in zip(vehicle.where, (0.0, 60.0), strict=True)))
    fleet.run(22.0)
    for vehicle in fleet:
        assert vehicle.truth.mode.name in ("GUIDED", "HOLD")
        assert not vehicle.truth.failsafe
        apart = math.dist(vehicle.reported, vehicle.where)
        assert apart == pytest.approx(vehicle.off_m, abs=0.02)
        assert 0.1 < apart < 0.02 * 60.0 * DeadReckoning.MOST


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_telemetry_shows_an_outage_and_its_end(autopilot):
    vehicle = in_the_air(autopilot)
    assert vehicle.flags & (ABSOLUTE | RELATIVE) == ABSOLUTE | RELATIVE
    fix = vehicle.ask("GPS_RAW_INT")
    assert (fix.fix_type, fix.satellites_visible) == (3, 10)
    vehicle.fail.gps(for_s=15.0)
    vehicle.run(0.2)
    fix = vehicle.ask("GPS_RAW_INT")
    assert (fix.fix_type, fix.satellites_visible) == (1, 0)
    vehicle.fly_to(0.0, 40.0)
    vehicle.run(14.0)  # ArduPilot calls its position absolute for ten seconds, a PX4 for seven
    assert vehicle.flags & (ABSOLUTE | RELATIVE | VELOCITY | CONSTANT) == RELATIVE | VELOCITY
    before_m = vehicle.off_m
    assert before_m > 0.1
    vehicle.run(2.5)
    assert vehicle.off_m < 0.05  # a reset
    vehicle.run(0.2)
    assert vehicle.flags & (ABSOLUTE | CONSTANT) == ABSOLUTE
    assert vehicle.ask("GPS_RAW_INT").fix_type == 3
    assert vehicle.truth.mode.name in ("GUIDED", "HOLD")


def test_outage_sends_its_texts():
    for autopilot, wanted in (
        ("ardupilot", ["GPS Glitch or Compass error", "Glitch cleared"]),
        ("px4", ["GNSS data fusion stopped", "GNSS data fusion started"]),
    ):
        vehicle = in_the_air(autopilot)
        vehicle.texts()
        vehicle.fail.gps(for_s=9.0)
        lines = []
        for _ in range(12):
            vehicle.ground_station()
            vehicle.run(1.0)
            lines += vehicle.texts()
        assert [text for text in lines if "G" in text] == wanted


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_vehicle_without_satellites_returns_and_lands(autopilot):
    vehicle = in_the_air(autopilot, odometry_drift=0.01)
    vehicle.fly_to(0.0, 30.0)
    vehicle.run(15.0)
    vehicle.fail.gps()
    vehicle.run(12.0)
    mode = (1, 6) if autopilot == "ardupilot" else (1, 4, 5)
    assert vehicle.command(mav.MAV_CMD_DO_SET_MODE, *mode) == mav.MAV_RESULT_ACCEPTED
    vehicle.until(lambda: vehicle.truth.landed, timeout_s=150.0)
    assert not vehicle.truth.crashed
    assert math.hypot(*vehicle.where) < 1.5


def test_a_px4_lands_once_its_own_accuracy_is_gone():
    vehicle = in_the_air("px4", odometry_drift=0.04)
    vehicle.put(COM_POS_FS_EPH=2.0)
    vehicle.fail.gps()
    vehicle.fly_to(0.0, 100.0)
    vehicle.run(8.5)
    assert vehicle.truth.mode.name == "HOLD"
    vehicle.until(lambda: vehicle.truth.mode.name == "LAND", timeout_s=30.0)
    assert vehicle.where[1] == pytest.approx(2.0 / 0.04, abs=6.0)  # by its own estimate
    assert not vehicle.flags & (ABSOLUTE | RELATIVE)
    assert vehicle.ask("ESTIMATOR_STATUS").pos_horiz_accuracy == pytest.approx(2.0, abs=0.1)
    patient = in_the_air("px4", odometry_drift=0.04)
    patient.put(COM_POS_FS_EPH=-1.0)
    patient.fail.gps()
    patient.fly_to(0.0, 100.0)
    patient.run(30.0)
    assert patient.truth.mode.name == "HOLD"


def test_estimate_at_rest_wanders_by_some_centimetres_a_second():
    vehicle = in_the_air("ardupilot")
    vehicle.fail.gps()
    vehicle.run(60.0)
    assert 0.02 < vehicle.off_m < 2.0


def test_vehicle_without_satellites_does_not_arm():
    vehicle = piloted(optical_flow=True)[0]
    vehicle.fail.gps()
    vehicle.run(7.0)
    assert vehicle.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1) == mav.MAV_RESULT_FAILED
    assert "GPS 1: Bad fix" in vehicle.expect("STATUSTEXT").text


def test_an_ardupilot_in_auto_and_in_loiter_goes_on(make_client):
    client = make_client(optical_flow=True)
    client.run(6.0)
    planner = Planner(client)
    planner.upload(UP, row(WP, at=(0.0, 60.0, 10.0)), row(WP, at=(0.0, 0.0, 10.0)))
    planner.begin()
    client.run(10.0)
    client.vehicle.fail.gps()
    client.run(35.0)
    assert planner.reached[-2:] == [2, 3]
    assert not client.vehicle.truth.failsafe
    assert client.result(mav.MAV_CMD_DO_SET_MODE, 1, 5) == mav.MAV_RESULT_ACCEPTED
    client.run(3.0)
    assert client.vehicle.truth.mode.name == "LOITER"


def test_a_px4_in_offboard_and_in_a_mission_goes_on():
    vehicle = in_the_air("px4")
    points = [(WP, *vehicle.place(0.0, north_m), 10.0) for north_m in (30.0, 0.0)]
    assert vehicle.upload(points) == mav.MAV_MISSION_ACCEPTED
    vehicle.fail.gps()
    assert vehicle.command(mav.MAV_CMD_DO_SET_MODE, 1, 4, 4) == mav.MAV_RESULT_ACCEPTED
    vehicle.until(lambda: vehicle.where[1] > 29.0, timeout_s=30.0)
    setpoint = mav.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, mav.MAV_FRAME_LOCAL_NED, 0xDF8, 5.0, 15.0, -10.0, *[0.0] * 8
    )
    for tick in range(120):
        vehicle.send(setpoint)
        vehicle.run(0.1)
        if tick == 5:
            vehicle.command(mav.MAV_CMD_DO_SET_MODE, 1, 6)
    assert vehicle.truth.mode.name == "OFFBOARD"
    assert vehicle.reported == pytest.approx((15.0, 5.0), abs=0.3)
