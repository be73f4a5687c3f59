from __future__ import annotations

import socket
import threading

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.scenario import Setup
from sitl.testing import Fleet


@pytest.fixture
def threads():
    return threading.active_count()


@pytest.fixture
def make():
    fleets = []

    def fleet(**setup):
        fleets.append(Fleet(Setup(**{"gps_sigma_m": 0.0, **setup})))
        return fleets[-1]

    yield fleet
    for one in fleets:
        one.close()


def take_off(vehicle, height_m=8.0):
    vehicle.until(lambda: vehicle.command(mav.MAV_CMD_DO_SET_MODE, 1, 4) == 0)
    assert vehicle.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1) == 0
    assert vehicle.command(mav.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, height_m) == 0


def test_time_passes_only_when_it_is_advanced(threads, make):
    (vehicle,) = make()
    assert vehicle.t_s == 0.0
    vehicle.run(1.23)
    assert vehicle.t_s == pytest.approx(1.23)
    vehicle.run(0.0)
    assert vehicle.t_s == pytest.approx(1.23)
    with pytest.raises(ValueError, match="forward"):
        vehicle.run(-1.0)
    assert threading.active_count() == threads


def test_messages_are_handed_out_once_in_order(make):
    (vehicle,) = make()
    vehicle.run(2.5)
    beats = [m for m in vehicle.receive() if m.get_type() == "HEARTBEAT"]
    assert [m.get_srcComponent() for m in beats] == [1, 100] * 3
    assert vehicle.receive() == []
    ask = mav.MAVLink_param_request_read_message(1, 1, b"RTL_ALT", -1)
    vehicle.send(ask)
    assert vehicle.expect("PARAM_VALUE", param_id="RTL_ALT").param_value == 1500
    vehicle.send(ask.pack(mav.MAVLink(None, srcSystem=7)))  # bytes do as well
    assert vehicle.receive_bytes()[0] == 0xFD
    assert vehicle.receive_bytes() == b""


def test_expectation_that_fails_reports_the_reason(make):
    (vehicle,) = make()
    assert vehicle.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1) == mav.MAV_RESULT_FAILED
    with pytest.raises(
        TimeoutError, match=r"within 3 s .* STABILIZE, disarmed.* texts: .*settling"
    ):
        vehicle.until(lambda: vehicle.truth.armed, timeout_s=3.0)
    assert vehicle.t_s == pytest.approx(3.0)
    with pytest.raises(TimeoutError, match="MISSION_ACK"):
        vehicle.expect("MISSION_ACK", timeout_s=0.5)


def test_a_fleet_is_on_one_clock(make):
    fleet = make(vehicles=10)
    fleet[3].run(6.0)
    assert {v.t_s for v in fleet} == {fleet.t_s}
    assert len({v.truth.position for v in fleet}) == 10
    take_off(fleet[9], 5.0)
    fleet.until(lambda: fleet[9].truth.height_m > 4.0)
    assert all(v.truth.height_m < 0.1 for v in fleet[:9])
    assert {m.get_srcSystem() for m in fleet[4].receive()} == {5}


def test_a_real_client_on_a_real_socket(threads, make):
    (vehicle,) = make(speedup=20.0)
    vehicle.run(6.0)  # the wait for readiness costs no time
    assert vehicle.url.startswith("udpin://127.0.0.1:")
    assert vehicle.url == vehicle.url
    link = mavutil.mavlink_connection(vehicle.url.replace("://", ":"))
    try:
        assert link.wait_heartbeat(timeout=120).get_srcSystem() == 1
        link.set_mode("GUIDED")
        vehicle.until(lambda: vehicle.truth.mode == 4)
        link.arducopter_arm()
        vehicle.until(lambda: vehicle.truth.armed)
        link.mav.command_long_send(1, 1, mav.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 0, 6)
        vehicle.until(lambda: vehicle.truth.height_m > 5.0)
        link.mav.command_long_send(1, 100, mav.MAV_CMD_IMAGE_START_CAPTURE, 0, 0, 0, 1, 1, 0, 0, 0)
        shot = link.recv_match(type="CAMERA_IMAGE_CAPTURED", blocking=True, timeout=120)
        assert shot.file_url.startswith("http://127.0.0.1:")
        assert vehicle.image(shot.file_url)[:2] == b"\xff\xd8"
        before_s = vehicle.t_s
        vehicle.run(5.0)
        assert vehicle.t_s >= before_s + 5.0
        for forbidden in (lambda: vehicle.send(b""), vehicle.receive, vehicle.receive_bytes):
            with pytest.raises(RuntimeError, match="on a socket"):
                forbidden()
        with pytest.raises(TimeoutError, match="armed"):
            vehicle.until(lambda: False, timeout_s=2.0)
    finally:
        link.close()
    vehicle.fleet.close()
    assert threading.active_count() == threads
    with pytest.raises(RuntimeError, match="stopped"):
        vehicle.run(1.0)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as again:
        again.bind(("127.0.0.1", int(vehicle.url.rpartition(":")[2])))
