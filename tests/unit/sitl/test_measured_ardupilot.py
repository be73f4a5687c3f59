"""Measured behaviour of a real ArduCopter 4.6, which the simulated one shows: a fact each.

`test_sitl_flight` has the speed that a change of the guided submode loses. `test_sitl_camera` has
the camera that still captures.
"""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import UavmapError
from sitl.copter.modes import Mode
from sitl.quirks import Quirks
from tests.unit.sitl.piloted import ACCEPTED, AUTOPILOTS, DENIED, UNSUPPORTED, piloted

FAILED = mav.MAV_RESULT_FAILED
START, STOP = mav.MAV_CMD_IMAGE_START_CAPTURE, mav.MAV_CMD_IMAGE_STOP_CAPTURE


def copter(autopilot="ardupilot", ready_after_s=5.0, **quirks):
    quirks = Quirks(**quirks)
    return piloted(autopilot=autopilot, ready_after_s=ready_after_s, quirks=quirks)[0]


def ask_camera(vehicle, command, *p):
    """Return the answers to a command to component 100, and their senders."""
    vehicle.receive()
    vehicle.send_command(command, *p, component=mav.MAV_COMP_ID_CAMERA)
    return [(m.get_srcComponent(), m.result) for m in vehicle.received("COMMAND_ACK")]


# --- arming --------------------------------------------------------------------------------------
def test_vehicle_that_would_not_arm_reports_the_reason_every_30_seconds():
    vehicle = copter(ready_after_s=95.0)
    vehicle.send(mav.MAVLink_heartbeat_message(mav.MAV_TYPE_GCS, 8, 0, 0, 4, 3))
    sent_s = []
    for _ in range(140):
        sent_s += [
            vehicle.t_s for m in vehicle.during(1.0, "STATUSTEXT") if m.text.startswith("PreArm")
        ]
    assert sent_s == pytest.approx([30.0, 60.0, 90.0], abs=1.1)


# --- cameras -------------------------------------------------------------------------------------
def test_an_autopilots_own_camera_answers_as_the_autopilot_and_shows_no_picture():
    vehicle = copter(camera="autopilot")
    vehicle.run(6.0)
    assert ask_camera(vehicle, START, 0, 1.0, 0, 0) == [(1, ACCEPTED)]
    arrived = vehicle.during(5.0)
    kinds = [m.get_type() for m in arrived]
    assert kinds.count("CAMERA_FEEDBACK") >= 4
    assert "CAMERA_IMAGE_CAPTURED" not in kinds
    assert {m.get_srcComponent() for m in arrived} == {1}
    assert ask_camera(vehicle, STOP) == [(1, ACCEPTED)]
    assert not vehicle.during(5.0, "CAMERA_FEEDBACK")
    vehicle.send(mav.MAVLink_param_request_read_message(1, 1, b"CAM1_TYPE", -1))
    assert vehicle.expect("PARAM_VALUE").param_value == 1.0


def test_only_an_ardupilot_has_a_camera_of_its_own():
    with pytest.raises(UavmapError, match="CAM1_TYPE"):
        copter("px4", camera="autopilot")


def test_request_to_a_missing_camera_is_refused_by_ardupilot_and_unanswered_by_px4():
    vehicle, px4 = copter(camera="none"), copter("px4", camera="none")
    for one in (vehicle, px4):
        one.run(6.0)
    assert ask_camera(vehicle, START, 0, 1.0, 0, 0) == [(1, FAILED)]
    assert {m.get_srcComponent() for m in vehicle.during(3.0)} == {1}
    assert ask_camera(px4, START, 0, 1.0, 0, 0) == []
    assert px4.command(START, 0, 1.0, 0, 0) == UNSUPPORTED


def test_camera_with_a_clock_of_its_own_reports_no_pose():
    vehicle = copter(camera_clock_s=-3.5, camera_tells_pose=False)
    vehicle.run(6.0)
    ask_camera(vehicle, START, 0, 1.0, 1, 1)
    picture = vehicle.expect("CAMERA_IMAGE_CAPTURED")
    assert picture.time_boot_ms / 1000.0 == pytest.approx(vehicle.t_s - 3.5, abs=0.1)
    assert (picture.lat, picture.lon, picture.alt, picture.relative_alt) == (0, 0, 0, 0)
    assert list(picture.q) == [0.0] * 4
    assert vehicle.image(picture.file_url)


# --- heartbeats and what is not sent --------------------------------------------------------------
def test_heartbeats_come_at_a_requested_interval_and_at_once_with_a_mode():
    vehicle = copter()
    vehicle.run(6.0)
    assert vehicle.command(511, 0, 200_000) == ACCEPTED
    beats = [m for m in vehicle.during(4.0, "HEARTBEAT") if m.get_srcComponent() == 1]
    assert len(beats) == 20
    vehicle.send_command(176, 1, Mode.GUIDED)
    (beat,) = vehicle.received("HEARTBEAT")
    assert beat.custom_mode == Mode.GUIDED


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_autopilot_without_a_landed_state_refuses_to_report_it(autopilot):
    """No stream of an ArduPilot has EXTENDED_SYS_STATE, and some links never carry it."""
    vehicle = copter(autopilot, landed_state=False)
    assert vehicle.command(511, 245, 200_000) == DENIED
    assert vehicle.during(5.0, "EXTENDED_SYS_STATE") == []


# --- clocks --------------------------------------------------------------------------------------
@pytest.mark.parametrize("autopilot", AUTOPILOTS)
@pytest.mark.parametrize("ppm", [0.0, 2000.0, -2000.0])
def test_clock_of_a_vehicle_drifts_as_configured(autopilot, ppm):
    vehicle = copter(autopilot, clock_ppm=ppm)
    vehicle.run(200.0)
    assert vehicle.command(511, 33, 100_000) == ACCEPTED
    boot_s = vehicle.expect("GLOBAL_POSITION_INT").time_boot_ms / 1000.0
    assert boot_s == pytest.approx(vehicle.t_s * (1.0 + ppm * 1e-6), abs=0.005)


def test_parameters_of_the_owner_hold_from_the_start():
    vehicle = piloted(parameters={"RTL_ALT": 2500, "SIM_RC_FAIL": 1})[0]
    vehicle.send(mav.MAVLink_param_request_read_message(1, 1, b"RTL_ALT", -1))
    assert vehicle.expect("PARAM_VALUE").param_value == 2500.0
    vehicle.run(1.0)
    assert vehicle.fail.rc_lost
    with pytest.raises(UavmapError, match="no 'RTL_ALTT' that can be set; near: RTL_ALT"):
        piloted(parameters={"RTL_ALTT": 1.0})


@pytest.mark.parametrize("wrong", [{"home_moves_m": -1.0}, {"clock_ppm": 1e7}])
def test_impossible_quirks_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Quirks(**wrong)
