from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.body.physics import Body, Command
from sitl.copter.control import sqrt_controller
from tests.unit.sitl.conftest import speed_m_s


@pytest.fixture
def windy(make_client):
    client = make_client(world={"wind_speed_m_s": 3.0, "wind_from_deg": 45.0})
    client.take_off()
    return client


@pytest.mark.parametrize(("jerk", "passes_m"), [(0.0, 0.5), (5.0, 1.0)])
@pytest.mark.parametrize("distance_m", [0.5, 20.0, 120.0])
def test_vehicle_reaches_a_target_and_stays(windy, jerk, passes_m, distance_m):
    """Shaped with a limited jerk (PSC_JERK_XY) a real one passes its target by as much."""
    windy.put(PSC_JERK_XY=jerk)
    assert windy.reposition(0.0, distance_m, 12.0) == 0
    seen = windy.watch(10.0 + distance_m / 4.0)
    assert windy.where == pytest.approx((0.0, distance_m, 12.0), abs=0.2)
    assert max(where[1] for where, _ in seen) - distance_m < passes_m
    assert max(speed_m_s(truth) for _, truth in seen) <= 10.6


def test_acceleration_and_climb_stay_within_limits(make_client):
    client = make_client()
    client.take_off(30.0)
    client.reposition(60.0, 0.0, 30.0)
    seen = client.watch(15.0)
    client.command(mav.MAV_CMD_NAV_LAND)
    velocities = [truth.velocity_m_s for _, truth in (*seen, *client.watch(45.0))]
    worst = max(math.dist(a[:2], b[:2]) for a, b in pairwise(velocities)) / 0.05
    assert worst < 6.0  # 30 degrees of tilt
    assert min(up for *_, up in velocities) > -1.5 * 1.1
    assert client.vehicle.truth.landed


def test_a_change_of_speed_is_kept_until_the_mode_or_the_kind_of_target_changes(flying):

    def fastest(seconds):
        return max(speed_m_s(truth) for _, truth in flying.watch(seconds))

    flying.target(0.0, 0.0, 12.0)  # the first target after a take-off changes it
    assert flying.result(mav.MAV_CMD_DO_CHANGE_SPEED, 1, 1.0, -1) == 0
    flying.target(0.0, 10.0, 12.0)
    assert 0.9 < fastest(8.0) < 1.15
    flying.velocity(0.0, 0.0)
    flying.target(0.0, 30.0, 12.0)
    assert fastest(6.0) > 3.0
    assert flying.result(mav.MAV_CMD_DO_CHANGE_SPEED, 1, 1.0, -1) == 0
    flying.run(20.0)
    flying.command(mav.MAV_CMD_DO_SET_MODE, 1, mav.COPTER_MODE_BRAKE)
    flying.command(mav.MAV_CMD_DO_SET_MODE, 1, mav.COPTER_MODE_GUIDED)
    flying.target(0.0, 40.0, 12.0)
    assert fastest(6.0) > 3.0


@pytest.mark.parametrize(
    ("wind_from_deg", "roll_sign", "pitch_sign"),
    [(0.0, 0, -1), (90.0, 1, 0), (180.0, 0, 1), (270.0, -1, 0)],
)
def test_vehicle_leans_into_the_wind_and_holds(make_client, wind_from_deg, roll_sign, pitch_sign):
    client = make_client(world={"wind_speed_m_s": 3.6, "wind_from_deg": wind_from_deg})
    client.take_off()
    client.run(5.0)
    truth = client.vehicle.truth  # the nose points north
    for angle, sign in ((truth.roll_rad, roll_sign), (truth.pitch_rad, pitch_sign)):
        if sign == 0:
            assert abs(math.degrees(angle)) < 0.3
        else:
            assert 2.0 < sign * math.degrees(angle) < 8.0
    assert math.hypot(*client.where[:2]) < 0.1


def test_vehicle_turns_its_nose_towards_far_targets_only(flying):
    flying.target(1.0, 0.0, 12.0)
    flying.run(4.0)
    assert abs(math.remainder(flying.vehicle.truth.yaw_rad, math.tau)) < 0.01
    flying.target(20.0, 0.0, 12.0)
    yaws = [truth.yaw_rad for _, truth in flying.watch(6.0)]
    assert math.degrees(yaws[-1]) == pytest.approx(90.0, abs=3.0)
    fastest = max(abs(math.remainder(b - a, math.tau)) for a, b in pairwise(yaws)) / 0.05
    assert math.degrees(fastest) <= 90.0


def test_hovering_lasts_as_long_as_the_energy(make_client):
    client = make_client(battery_wh=5.0, hover_power_w=300.0)
    client.take_off(5.0)
    begin_s, energy_wh = client.vehicle.t_s, client.vehicle.truth.energy_wh
    while client.vehicle.truth.energy_wh > 0.0:
        client.run(1.0)
    lasted_s = client.vehicle.t_s - begin_s
    assert lasted_s == pytest.approx(energy_wh / 300.0 * 3600.0, rel=0.03)
    client.run(5.0)
    truth = client.vehicle.truth
    assert truth.crashed
    assert not truth.armed
    assert client.result(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1) == mav.MAV_RESULT_FAILED


def test_the_crew_swaps_the_battery_of_a_resting_vehicle(make_client):
    client = make_client(swap_after_s=30.0)
    client.take_off(3.0)
    client.command(mav.MAV_CMD_NAV_LAND)
    while client.vehicle.truth.armed:
        client.run(1.0)
    used = client.vehicle.truth.energy_wh
    assert used < 60.0
    client.run(28.0)
    assert client.vehicle.truth.energy_wh == used  # nothing is drawn on the ground, disarmed
    client.run(4.0)
    assert client.vehicle.truth.energy_wh == 60.0
    assert client.vehicle.truth.swaps == 1
    client.run(60.0)
    assert client.vehicle.truth.swaps == 1


def test_a_forced_disarm_in_flight_is_the_end(flying):
    assert flying.result(mav.MAV_CMD_COMPONENT_ARM_DISARM, 0) == mav.MAV_RESULT_FAILED
    assert not flying.vehicle.truth.crashed
    assert flying.result(mav.MAV_CMD_COMPONENT_ARM_DISARM, 0, 21196) == 0
    flying.run(5.0)
    assert flying.vehicle.truth.crashed
    assert flying.vehicle.truth.height_m == 0.0


def test_the_estimate_wanders_as_specified(make_client):
    client = make_client(gps_sigma_m=0.5, gps_tau_s=10.0)
    assert client.every(mav.MAVLINK_MSG_ID_LOCAL_POSITION_NED, 0.5) == 0
    messages = client.run(600.0)
    norths = [m.x for m in messages if m.get_type() == "LOCAL_POSITION_NED"]
    spread = math.sqrt(sum(x * x for x in norths) / len(norths))
    assert 0.3 < spread < 0.75
    jumps = [abs(b - a) for a, b in pairwise(norths)]
    assert max(jumps) < 0.3


@given(
    error=st.floats(0.0, 1e4), p=st.floats(0.5, 2.0), accel=st.floats(0.5, 5.0),
)  # fmt: skip
def test_the_approach_speed_allows_to_stop(error, p, accel):
    speed = sqrt_controller(error, p, accel)
    assert 0.0 <= speed <= p * error + 1e-9
    assert speed * speed / (2.0 * accel) <= error + 1e-9


@settings(max_examples=50)
@given(
    commands=st.lists(
        st.builds(
            Command,
            st.floats(-50, 50), st.floats(-50, 50), st.floats(-20, 20), st.floats(-5, 5),
        ),
        min_size=1, max_size=30,
    ),
    wind=st.tuples(st.floats(-30, 30), st.floats(-30, 30)),
)  # fmt: skip
def test_the_body_stays_finite_under_any_command(commands, wind):
    body = Body(0.0, 0.0, 0.0, math.radians(30.0))
    body.motors_on = True
    for command in commands:
        for _ in range(20):
            body.step(command, wind, 0.05)
        state = (body.east, body.north, body.up, body.v_east, body.v_north, body.v_up, body.yaw)
        assert all(map(math.isfinite, state))
        assert body.up >= 0.0
        assert math.hypot(*body.roll_pitch) <= math.radians(45.0)


def test_vehicle_with_limited_jerk_starts_more_gently(windy, make_client):
    direct = make_client()
    direct.put(PSC_JERK_XY=0.0)
    direct.take_off()
    after = []
    for one in (windy, direct):
        begin = one.where[0]
        one.target(30.0, 0.0, 12.0)
        one.run(1.0)
        after.append(one.where[0] - begin)
    assert 0.2 < after[0] < 0.8 * after[1]


@pytest.mark.parametrize("cruise_m_s", [2.0, 8.0])
def test_vehicle_with_limited_jerk_stops_without_coming_back(windy, cruise_m_s):
    windy.put(WPNAV_SPEED=100.0 * cruise_m_s)
    windy.target(200.0, 0.0, 12.0)
    windy.run(12.0)
    begin = windy.where[0]
    windy.command(mav.MAV_CMD_DO_SET_MODE, 1, mav.COPTER_MODE_BRAKE)
    along = [where[0] - begin for where, _ in windy.watch(15.0)]
    assert along[-1] < 2.0 * cruise_m_s + cruise_m_s**2 / 4.0
    assert max(along) - along[-1] < 1.0


def test_vehicle_on_its_way_obeys_a_new_target_and_another_mode(windy):
    windy.target(60.0, 0.0, 12.0)
    windy.run(5.0)
    windy.target(10.0, 30.0, 12.0)
    windy.run(20.0)
    assert windy.where == pytest.approx((10.0, 30.0, 12.0), abs=0.3)
    windy.target(60.0, 0.0, 12.0)
    windy.run(4.0)
    windy.command(mav.MAV_CMD_DO_SET_MODE, 1, mav.COPTER_MODE_BRAKE)
    windy.run(10.0)
    assert math.hypot(*windy.vehicle.truth.velocity_m_s) < 0.1
    windy.command(mav.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    windy.run(60.0)
    assert windy.vehicle.truth.landed
    assert math.hypot(*windy.where[:2]) < 0.5


def test_velocity_targets_time_out(flying):
    flying.velocity(2.0, 0.0)
    flying.run(2.5)
    assert flying.vehicle.truth.velocity_m_s[0] == pytest.approx(2.0, abs=0.1)
    flying.run(4.0)
    assert math.hypot(*flying.vehicle.truth.velocity_m_s) < 0.1
