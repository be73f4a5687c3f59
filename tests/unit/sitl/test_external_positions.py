from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mav

from tests.unit.sitl.piloted import (
    ABSOLUTE,
    ACCEPTED,
    AUTOPILOTS,
    DENIED,
    NAN,
    REJECTED,
    RELATIVE,
    UNSUPPORTED,
    in_the_air,
    piloted,
)

FAILED = mav.MAV_RESULT_FAILED
COMPANION = 6.0  # EK3_SRCn_POSXY
VISION = {"VISO_TYPE": 1.0, "EK3_SRC1_POSXY": COMPANION}
ONLY_VISION = {"EKF2_EV_CTRL": 1.0, "EKF2_GPS_CTRL": 0.0}


def send_position(vehicle, at, *, delay_s=0.0, sigma_m=0.5, frame=0):
    return send_lat_lon(vehicle, *vehicle.place(*at), delay_s, sigma_m, frame)


def send_lat_lon(vehicle, lat_e7, lon_e7, delay_s=0.0, sigma_m=0.5, frame=0):
    vehicle.receive()
    command = mav.MAV_CMD_EXTERNAL_POSITION_ESTIMATE
    vehicle.send(
        mav.MAVLink_command_int_message(
            1, 1, frame, command, 0, 0, 0.0, delay_s, sigma_m, 0.0, lat_e7, lon_e7, NAN
        )
    )
    return vehicle.expect("COMMAND_ACK", timeout_s=0.0, command=command).result


def send_sighting(vehicle, error=(0.0, 0.0), sigma_m=0.1, resets=0):
    east, north = vehicle.where
    vehicle.send(
        mav.MAVLink_vision_position_estimate_message(
            0, north + error[1], east + error[0], -10.0, 0.0, 0.0, 0.0, spread(sigma_m), resets
        )
    )


def odometry(vehicle, frame, quality=0):
    """Send ODOMETRY that errs by 3 m east and 1 m north."""
    east, north = vehicle.where
    vehicle.send(
        mav.MAVLink_odometry_message(
            0, frame, mav.MAV_FRAME_BODY_FRD, north + 1.0, east + 3.0, -10.0,
            (1.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, spread(0.1), [NAN] * 21,
            0, mav.MAV_ESTIMATOR_TYPE_VISION, quality,
        )
    )  # fmt: skip


def spread(sigma_m):
    covariance = [0.0] * 21
    covariance[0] = covariance[6] = sigma_m * sigma_m
    return covariance


def receive(vehicle, error=(0.0, 0.0), fix_type=3, accuracy_m=0.5):
    east, north = vehicle.where
    lat, lon = vehicle.place(east + error[0], north + error[1])
    vehicle.send(
        mav.MAVLink_gps_input_message(
            0, 1, 0, 0, 0, fix_type, lat, lon, 498.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.3, accuracy_m,
            1.0, 12,
        )
    )  # fmt: skip


def repeat(vehicle, send, seconds, hz=10.0):
    """Repeat a message while time passes; return the largest leap of the error, m."""
    leap_m, before = 0.0, vehicle.truth.estimate_error_m
    for _ in range(round(seconds * hz)):
        send()
        for _ in range(round(20.0 / hz)):
            vehicle.run(0.05)
            now = vehicle.truth.estimate_error_m
            leap_m, before = max(leap_m, math.dist(before, now)), now
    return leap_m


# --- EXTERNAL_POSITION_ESTIMATE ----------------------------------------------------------------


def test_an_ardupilot_takes_a_position_while_it_reckons_by_flow():
    vehicle = in_the_air("ardupilot", odometry_drift=0.05)
    assert send_position(vehicle, vehicle.where) == FAILED  # it has satellites
    vehicle.fail.gps()
    vehicle.run(0.9)
    assert send_position(vehicle, vehicle.where) == FAILED  # less than a second ago
    vehicle.fly_to(0.0, 60.0)
    vehicle.run(20.0)
    assert vehicle.off_m > 0.5
    east, north = vehicle.where
    assert send_position(vehicle, (east + 0.2, north), sigma_m=5.0) == ACCEPTED
    assert vehicle.truth.estimate_error_m == pytest.approx((0.2, 0.0), abs=0.05)
    assert send_position(vehicle, (east, north)) == ACCEPTED  # any number of times
    assert vehicle.off_m < 0.05
    assert not vehicle.flags & ABSOLUTE  # its place on earth stays unknown
    assert vehicle.flags & RELATIVE


def test_a_position_that_is_old_is_moved_on():
    vehicle = in_the_air("ardupilot")
    vehicle.fail.gps()
    vehicle.fly_to(200.0, 200.0)
    vehicle.run(6.0)
    v_east, v_north, _ = vehicle.truth.velocity_m_s
    assert min(v_east, v_north) > 3.0
    east, north = vehicle.where
    then = (east - 2.0 * v_east, north - 2.0 * v_north)
    assert send_position(vehicle, then, delay_s=2.0) == ACCEPTED
    assert vehicle.truth.estimate_error_m == pytest.approx((0.0, 0.0), abs=0.5)
    assert send_position(vehicle, (east, north), delay_s=NAN, sigma_m=NAN) == ACCEPTED
    assert vehicle.off_m < 0.1


def test_an_ardupilot_without_any_help_takes_one_until_it_gives_its_position_up():
    vehicle = in_the_air("ardupilot", optical_flow=False)
    vehicle.fail.gps()
    vehicle.run(5.0)
    assert send_position(vehicle, vehicle.where) == ACCEPTED
    assert vehicle.off_m < 0.05
    vehicle.run(11.0)
    assert send_position(vehicle, vehicle.where) == FAILED


def test_a_px4_takes_one_while_nothing_helps():
    helped = in_the_air("px4")
    assert send_position(helped, helped.where) == REJECTED
    helped.fail.gps()
    helped.run(10.0)
    assert send_position(helped, helped.where) == REJECTED  # by optical flow
    vehicle = in_the_air("px4", optical_flow=False)
    vehicle.fail.gps()
    vehicle.run(0.9)
    assert send_position(vehicle, vehicle.where) == REJECTED
    vehicle.run(2.0)
    wrong = tuple(a + 5.0 for a in vehicle.where)
    assert send_position(vehicle, wrong, delay_s=NAN) == REJECTED
    assert send_position(vehicle, wrong, sigma_m=0.5) == ACCEPTED  # a good one is taken as it is
    assert vehicle.off_m == pytest.approx(math.sqrt(50.0), abs=0.05)
    assert send_position(vehicle, vehicle.where, sigma_m=5.0) == ACCEPTED  # this one is weighed
    vehicle.run(1.5)
    assert 3.0 < vehicle.off_m < 9.0


def test_a_px4_on_the_ground_takes_one_without_satellites():
    vehicle = piloted(autopilot="px4")[0]
    vehicle.run(6.0)
    assert send_position(vehicle, (3.0, 4.0)) == REJECTED
    vehicle.fail.gps()
    vehicle.run(8.0)
    assert send_position(vehicle, (3.0, 4.0)) == ACCEPTED
    assert vehicle.off_m == pytest.approx(5.0, abs=0.05)


@pytest.mark.parametrize(
    ("autopilot", "nowhere"), [("ardupilot", DENIED), ("px4", FAILED)], ids=AUTOPILOTS
)
def test_position_that_is_no_place_changes_nothing(autopilot, nowhere):
    vehicle = in_the_air(autopilot, optical_flow=autopilot == "ardupilot")
    vehicle.fail.gps()
    vehicle.run(2.0)
    before = vehicle.truth.estimate_error_m
    assert send_lat_lon(vehicle, 910_000_000, 0) == nowhere
    assert send_lat_lon(vehicle, 0, 0) == nowhere  # thousands of kilometres away
    if autopilot == "ardupilot":
        assert send_position(vehicle, vehicle.where, frame=3) == UNSUPPORTED
    assert vehicle.truth.estimate_error_m == before


def test_position_may_come_as_a_command_long():
    vehicle = in_the_air("ardupilot")
    vehicle.fail.gps()
    vehicle.run(2.0)
    lat, lon = vehicle.place(*vehicle.where)
    command = mav.MAV_CMD_EXTERNAL_POSITION_ESTIMATE
    assert vehicle.command(command, 0, 0, 0.5, 0, lat / 1e7, lon / 1e7, NAN) == ACCEPTED
    assert vehicle.command(command, 0, 0, 0.5, 0, NAN, NAN, NAN) == DENIED


# --- GPS_INPUT ---------------------------------------------------------------------------------


@pytest.mark.parametrize("flow", [True, False])
def test_a_second_receiver_of_an_ardupilot_stands_in(flow):
    vehicle = in_the_air("ardupilot", optical_flow=flow)
    vehicle.put(GPS2_TYPE=14.0)
    repeat(vehicle, lambda: receive(vehicle, (3.0, 0.0)), 3.0, hz=5.0)
    assert vehicle.off_m < 0.05  # the first has a fix
    vehicle.fail.gps()
    leap_m = repeat(vehicle, lambda: receive(vehicle, (3.0, 0.0)), 4.0, hz=5.0)
    assert vehicle.truth.estimate_error_m == pytest.approx((3.0, 0.0), abs=0.2)
    assert leap_m < 0.5
    repeat(vehicle, lambda: receive(vehicle, (3.0, 0.0)), 12.0, hz=5.0)
    assert vehicle.flags & ABSOLUTE
    assert vehicle.truth.mode.name == "GUIDED"


@pytest.mark.parametrize(
    ("autopilot", "setting", "fix_type"),
    [
        ("ardupilot", {"GPS2_TYPE": 14.0}, 2),
        ("ardupilot", {"GPS2_TYPE": 1.0}, 3),
        ("ardupilot", {"GPS2_TYPE": 14.0, "GPS_AUTO_SWITCH": 0.0}, 3),
        ("px4", {}, 3),
    ],
)
def test_a_second_receiver_needs_a_fix_a_type_and_a_switch(autopilot, setting, fix_type):
    vehicle = in_the_air(autopilot, optical_flow=False)
    vehicle.put(**setting)
    vehicle.fail.gps()
    repeat(vehicle, lambda: receive(vehicle, fix_type=fix_type), 14.0, hz=5.0)
    assert vehicle.truth.mode.name == "LAND"


def test_second_receiver_that_falls_silent_no_longer_stands_in():
    vehicle = in_the_air("ardupilot", optical_flow=False)
    vehicle.put(GPS2_TYPE=14.0, GPS_AUTO_SWITCH=4.0)
    vehicle.fail.gps()
    repeat(vehicle, lambda: receive(vehicle), 14.0, hz=5.0)
    assert vehicle.truth.mode.name == "GUIDED"
    vehicle.run(4.0 + 7.8)
    assert vehicle.truth.mode.name == "GUIDED"
    vehicle.run(0.6)
    assert vehicle.truth.mode.name == "LAND"


# --- VISION_POSITION_ESTIMATE, ODOMETRY --------------------------------------------------------


def choose(vehicle, number):
    return vehicle.command(mav.MAV_CMD_SET_EKF_SOURCE_SET, number)


def test_an_ardupilot_follows_a_companion_by_its_set_of_sources():
    vehicle = in_the_air("ardupilot", parameters={"VISO_TYPE": 1, "EK3_SRC2_POSXY": COMPANION})
    repeat(vehicle, lambda: send_sighting(vehicle, (2.0, 0.0)), 2.0)
    assert vehicle.off_m < 0.05  # satellites are the source
    assert choose(vehicle, 0) == choose(vehicle, 4) == choose(vehicle, NAN) == DENIED
    assert choose(vehicle, 2) == ACCEPTED
    repeat(vehicle, lambda: send_sighting(vehicle, (2.0, 0.0)), 0.2)
    assert vehicle.truth.estimate_error_m == pytest.approx((2.0, 0.0), abs=0.05)  # a reset
    leap_m = repeat(vehicle, lambda: send_sighting(vehicle, (0.0, 0.0)), 1.0)
    assert vehicle.off_m < 0.4  # within about a second
    assert leap_m < 0.5
    send_sighting(vehicle, (5.0, 5.0), resets=1)  # the message announces its leap
    assert vehicle.truth.estimate_error_m == pytest.approx((5.0, 5.0), abs=0.05)
    vehicle.fail.gps()
    repeat(vehicle, lambda: send_sighting(vehicle, resets=1), 12.0, hz=4.0)
    assert vehicle.flags & ABSOLUTE
    assert vehicle.off_m < 0.1
    vehicle.fail.clear()
    assert choose(vehicle, 1) == ACCEPTED
    vehicle.run(1.5)
    assert vehicle.off_m < 0.05


def test_satellites_that_lie_do_not_count_where_the_companion_is_the_source():
    vehicle = in_the_air("ardupilot", parameters={"VISO_TYPE": 1, "EK3_SRC2_POSXY": COMPANION})
    choose(vehicle, 2)
    vehicle.fail.gps_drift(1.0)
    repeat(vehicle, lambda: send_sighting(vehicle), 10.0)
    assert vehicle.off_m < 0.1
    choose(vehicle, 1)
    vehicle.run(0.2)
    assert vehicle.truth.estimate_error_m[0] == pytest.approx(10.0, abs=0.5)


@pytest.mark.parametrize("flow", [True, False])
def test_a_companion_of_an_ardupilot_that_falls_silent(flow):
    vehicle = in_the_air(
        "ardupilot", optical_flow=flow, parameters={"VISO_TYPE": 1, "EK3_SRC2_POSXY": COMPANION}
    )
    choose(vehicle, 2)
    repeat(vehicle, lambda: send_sighting(vehicle), 2.0)
    vehicle.run(9.0)
    assert vehicle.truth.mode.name == ("GUIDED" if flow else "LAND")
    vehicle.run(2.0)
    assert not vehicle.flags & ABSOLUTE


@pytest.mark.parametrize(
    ("autopilot", "setting", "frame", "received"),
    [
        ("ardupilot", VISION, mav.MAV_FRAME_LOCAL_FRD, True),
        ("ardupilot", VISION, mav.MAV_FRAME_LOCAL_NED, False),
        ("ardupilot", {"EK3_SRC1_POSXY": COMPANION}, mav.MAV_FRAME_LOCAL_FRD, False),
        ("px4", ONLY_VISION, mav.MAV_FRAME_LOCAL_FRD, True),
        ("px4", ONLY_VISION, mav.MAV_FRAME_LOCAL_NED, True),
        ("px4", ONLY_VISION, mav.MAV_FRAME_BODY_FRD, False),
    ],
)
def test_odometry_is_used_by_frame_quality_and_settings(autopilot, setting, frame, received):
    vehicle = in_the_air(autopilot)
    vehicle.put(**setting)
    vehicle.run(0.2)
    odometry(vehicle, frame, quality=-1)
    assert vehicle.off_m < 0.2
    odometry(vehicle, frame)
    assert (vehicle.off_m > 3.0) == received


def test_a_px4_knows_a_companion_by_its_changes_while_it_has_satellites():
    vehicle = in_the_air("px4", optical_flow=False)
    vehicle.put(EKF2_EV_CTRL=1.0)
    repeat(vehicle, lambda: send_sighting(vehicle, (4.0, 0.0)), 3.0)
    assert vehicle.off_m < 0.1
    vehicle.fail.gps()
    repeat(vehicle, lambda: send_sighting(vehicle, (4.0, 0.0)), 10.0)
    assert vehicle.off_m < 0.3  # its offset is kept
    assert vehicle.truth.mode.name == "HOLD"
    assert vehicle.flags & ABSOLUTE
    repeat(vehicle, lambda: send_sighting(vehicle, (5.0, 0.0)), 2.0)
    assert vehicle.truth.estimate_error_m[0] == pytest.approx(1.0, abs=0.2)
    vehicle.run(1.0)  # it falls silent and begins anew: now its positions count
    repeat(vehicle, lambda: send_sighting(vehicle, (5.0, 0.0)), 1.0)
    assert vehicle.truth.estimate_error_m[0] == pytest.approx(5.0, abs=0.1)
    vehicle.run(7.0)
    assert vehicle.truth.mode.name == "LAND"


def test_px4_can_be_set_to_leave_satellites_alone():
    vehicle = in_the_air("px4")
    vehicle.put(EKF2_GPS_CTRL=0.0)
    vehicle.fail.gps_glitch(30.0)
    vehicle.run(3.0)
    assert vehicle.off_m < 0.5
    assert not vehicle.flags & ABSOLUTE
    vehicle.put(EKF2_EV_CTRL=1.0)
    repeat(vehicle, lambda: send_sighting(vehicle), 2.0)
    assert vehicle.off_m < 0.1
    assert vehicle.flags & ABSOLUTE
    vehicle.put(EKF2_GPS_CTRL=7.0)
    vehicle.run(0.3)
    assert vehicle.off_m == pytest.approx(30.0, abs=0.5)


def test_a_poorer_position_is_followed_more_slowly():
    ways = []
    for sigma_m in (0.1, 3.0):
        vehicle = in_the_air("ardupilot", parameters=VISION, seed=2)
        repeat(vehicle, lambda v=vehicle, s=sigma_m: send_sighting(v, sigma_m=s), 3.0)
        repeat(vehicle, lambda v=vehicle, s=sigma_m: send_sighting(v, (2.0, 0.0), sigma_m=s), 0.8)
        ways.append(vehicle.truth.estimate_error_m[0])
    assert ways[0] > 1.5 > 2.0 * ways[1]


@settings(max_examples=10, deadline=None)
@given(
    numbers=st.lists(st.floats(width=32), min_size=4, max_size=4),
    lat=st.integers(-(2**31), 2**31 - 1),
    lon=st.integers(-(2**31), 2**31 - 1),
    autopilot=st.sampled_from(AUTOPILOTS),
)
def test_estimate_stays_a_number_with_any_positions(numbers, lat, lon, autopilot):
    parameters = {"EKF2_EV_CTRL": 1}
    if autopilot == "ardupilot":
        parameters = {**VISION, "GPS2_TYPE": 14}
    vehicle = piloted(autopilot=autopilot, optical_flow=True, parameters=parameters)[0]
    vehicle.run(6.0)
    vehicle.fail.gps()
    vehicle.run(8.0)
    a, b, c, d = numbers
    vehicle.send(
        mav.MAVLink_vision_position_estimate_message(0, a, b, c, d, a, b, [c, *[d] * 20], 7)
    )
    vehicle.send(
        mav.MAVLink_gps_input_message(
            0, 1, 0, 0, 0, 3, lat, lon, a, b, c, d, a, b, c, d, a, 12
        )
    )  # fmt: skip
    send_lat_lon(vehicle, lat, lon, a, b)
    vehicle.run(1.0)
    assert all(map(math.isfinite, vehicle.truth.estimate_error_m))
    assert math.isfinite(vehicle._vehicle._error.accuracy_m)
