"""Faults of flights with real autopilots, repeated with the simulated ones, flight by flight.

The table in docs/reference/real-findings.md has the outcome of each, then and now, and names these
tests. It also names the tests of other files.
"""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.mission.checks import parse_mission
from sitl.px4.modes import Px4Mode
from sitl.vehicle import SimVehicle
from tests.benchmarks.watched import mission_text
from tests.support.scenarios import BOTH, after, command, flying, into, once, scenario

LAND = {"ardupilot": 9, "px4": int(Px4Mode.LAND)}
RTL = {"ardupilot": 6, "px4": int(Px4Mode.RTL)}
FOLLOWS = {"ardupilot": 4, "px4": int(Px4Mode.HOLD)}
BY_FAILSAFE = {"ardupilot": "RTL", "px4": "HOLD by a failsafe"}
"""A PX4 waits in Hold before its failsafe acts."""
both = pytest.mark.parametrize("autopilot", BOTH)


def names_resume(said):
    """Return whether the ending names the command that resumes the flight."""
    return "to continue: uavmap resume" in said


# --- the link ------------------------------------------------------------------------------------
@both
def test_answers_that_come_late_fail_no_order(autopilot):
    late = {"kind": "link", "at_s": 0.0, "delay_s": 1.2}
    flight = scenario(autopilot, faults=[late])
    assert (flight.code, flight.kinds["order_failed"]) == (0, 0)


@both
def test_link_gone_for_40_seconds_on_a_lane_is_reconnected(autopilot):
    gone = once(flying, lambda v: v.fail.link(silent=True, after_s=3.0, for_s=40.0))
    flight = scenario(autopilot, gone)
    assert flight.code == 0
    assert (flight.kinds["link_lost"], flight.kinds["order_failed"]) == (1, 0)
    assert "answers, in the air and under our control" in flight.stderr


@both
def test_vehicle_without_our_frames_for_30_seconds_returns(autopilot):
    own = {
        "ardupilot": {"FS_GCS_ENABLE": 1, "SYSID_MYGCS": 245},
        "px4": {"NAV_DLL_ACT": 2},
    }[autopilot]
    deaf = once(flying, lambda v: v.fail.link(silent=True, way="up", after_s=3.0, for_s=30.0))
    flight = scenario(autopilot, deaf, parameters=own)
    assert flight.code == 3
    assert f"is in {BY_FAILSAFE[autopilot]}, not under our control (" in flight.stderr
    assert "): hands off until" in flight.stderr
    assert flight.columns >= {"home"}
    assert names_resume(flight.stderr)


def test_ardupilot_does_not_count_the_service_as_its_ground_station():
    deaf = once(flying, lambda v: v.fail.link(silent=True, way="up", after_s=1.0, for_s=8.0))
    flight = scenario("ardupilot", deaf, parameters={"FS_GCS_ENABLE": 1})
    assert (flight.code, flight.kinds["overridden"]) == (0, 0)


def test_px4_that_needs_a_ground_station_accepts_the_service():
    assert scenario("px4", parameters={"NAV_DLL_ACT": 2}).code == 0


# --- the pilot -----------------------------------------------------------------------------------
@both
def test_pilot_landing_gets_a_line_on_how_to_resume(autopilot):
    lands = once(after(3.0), lambda v: into(v, LAND[autopilot]))
    flight = scenario(autopilot, once(flying, lambda v: None), lands)
    assert flight.code in (3, 4)  # 4: it landed away from its pad, and a line reports it
    assert "is in LAND, not under our control: hands off" in flight.stderr
    assert "has landed, not under our control" in flight.stderr
    assert names_resume(flight.stderr)


@both
def test_pilot_commands_a_return_and_gives_it_back_completes(autopilot):
    takes = once(after(3.0), lambda v: into(v, RTL[autopilot]))
    gives = once(after(5.0), lambda v: into(v, FOLLOWS[autopilot]))
    flight = scenario(autopilot, once(flying, lambda v: None), takes, gives)
    assert flight.code == 0
    assert (flight.kinds["overridden"], flight.kinds["released"]) == (1, 1)


# --- failsafes -----------------------------------------------------------------------------------
@both
def test_battery_failsafe_keeps_the_vehicle(autopilot):
    own = {
        "ardupilot": {"BATT_FS_LOW_ACT": 2, "BATT_LOW_VOLT": 18.0},
        "px4": {"COM_LOW_BAT_ACT": 3},
    }[autopilot]
    flight = scenario(
        autopilot, once(flying, lambda v: v.fail.battery_sag(9.0, after_s=3.0)), parameters=own
    )
    assert flight.code in (3, 4)
    assert f"is in {BY_FAILSAFE[autopilot]}, not under our control" in flight.stderr
    assert "landed without an order" not in flight.stderr
    assert names_resume(flight.stderr)


def test_landing_interrupted_by_a_failsafe_over_the_pad_is_no_failure():
    """A PX4 whose battery gets critical two metres above its pad holds first, and then lands."""
    own = {"COM_LOW_BAT_ACT": 3}
    sags = once(
        lambda v: v.truth.mode == Px4Mode.LAND and v.truth.height_m < 3.0,
        lambda v: v.fail.battery_sag(9.0),
    )
    flight = scenario("px4", sags, parameters=own)
    assert flight.code == 0
    assert [note.split("overridden: ")[-1].strip() for note in flight.notes] == [
        "HOLD by a failsafe", "LAND by a failsafe",
    ]  # fmt: skip


@both
def test_satellites_gone_in_the_air_land_the_vehicle(autopilot):
    flight = scenario(autopilot, once(flying, lambda v: v.fail.gps(after_s=3.0)))
    assert flight.code == 4  # it landed where it was, and a line reports it
    assert "is in LAND" in flight.stderr
    assert "from its pad" in flight.stderr
    assert names_resume(flight.stderr)


@both
def test_position_that_leaps_by_55_m_is_noticed(autopilot):
    leaps = {"kind": "gps_glitch", "at_s": 25.0, "metres": 55.0, "for_s": 10.0}
    flight = scenario(autopilot, faults=[leaps])
    assert flight.code in (3, 4)  # 4: it landed at once, and a line reports it
    assert "satellite navigation cannot be trusted" in flight.stderr
    assert names_resume(flight.stderr)


@both
def test_altitude_fence_below_the_layer_is_a_failsafe(autopilot):
    own = {
        "ardupilot": {
            "FENCE_ENABLE": 1, "FENCE_TYPE": 1, "FENCE_ALT_MAX": 10, "FENCE_ACTION": 1,
        },
        "px4": {"GF_MAX_VER_DIST": 10, "GF_ACTION": 3},
    }[autopilot]  # fmt: skip
    flight = scenario(autopilot, parameters=own)
    assert flight.code == 3
    assert f"is in {BY_FAILSAFE[autopilot]}, not under our control" in flight.stderr
    assert flight.columns >= {"home"}
    assert names_resume(flight.stderr)


def test_circular_fence_smaller_than_the_box_fails_the_order():
    own = {"FENCE_ENABLE": 1, "FENCE_TYPE": 2, "FENCE_RADIUS": 12, "FENCE_ACTION": 1}
    flight = scenario("ardupilot", parameters=own)
    assert flight.code == 3
    (note,) = [note for note in flight.notes if "order_failed" in note][:1]
    assert "MAV_CMD_DO_REPOSITION was refused: failed" in note
    assert "vehicle:" not in note
    assert flight.columns >= {"home"}


@both
def test_radio_control_lost_is_a_failsafe(autopilot):
    flight = scenario(
        autopilot, once(flying, lambda v: v.fail.rc(after_s=3.0)), parameters=FS_RADIO[autopilot]
    )
    assert flight.code == 3
    assert f"is in {BY_FAILSAFE[autopilot]}, not under our control" in flight.stderr


FS_RADIO = {"ardupilot": {"FS_THR_ENABLE": 1}, "px4": {"NAV_RCL_ACT": 2}}


@both
def test_motor_that_fails_is_a_crash_and_the_flight_ends(autopilot):
    flight = scenario(autopilot, once(flying, lambda v: v.fail.motor(after_s=3.0)))
    assert flight.code == 4
    assert flight.columns >= {"crash", "down"}
    assert "vehicle 1 is down" in flight.stderr
    assert flight.truth.t_s < 60.0


@both
def test_outage_of_satellites_is_survived_by_optical_flow(autopilot):
    flow = "[sim]\noptical_flow = true\nodometry_drift = 0.01\n"
    goes_on = '\n[navigation]\ngnss_loss = "map"\nwatch = false\n'
    flight = scenario(
        autopilot,
        once(flying, lambda v: v.fail.gps(after_s=2.0, for_s=20.0)),
        change=lambda text: text.replace("[sim]\n", flow) + goes_on,
    )
    assert (flight.code, flight.summary["completed"]) == (0, True)
    assert flight.columns >= {"home"}


# --- cameras -------------------------------------------------------------------------------------
NOTHING_JUDGED = "no region found in 0 judged frames"


@both
def test_vehicle_without_a_camera_searches_nothing(autopilot):
    flight = scenario(autopilot, quirks={"camera": "none"})
    assert (flight.code, flight.summary["completed"]) == (3, False)
    assert NOTHING_JUDGED in flight.summary["finding"]
    assert "camera is silent" in flight.summary["notes"]["1"]


def test_camera_of_the_autopilot_without_pictures_searches_nothing():
    """It accepts every command, from another component than the one addressed; CAM1_TYPE 1."""
    flight = scenario("ardupilot", quirks={"camera": "autopilot"})
    assert (flight.code, flight.summary["completed"]) == (3, False)
    assert NOTHING_JUDGED in flight.summary["finding"]


@both
def test_camera_with_corrupt_pictures_only_ends_incomplete(autopilot):
    flight = scenario(autopilot, faults=[{"kind": "camera_corrupt", "at_s": 0.0}])
    assert (flight.code, flight.summary["completed"]) == (3, False)
    assert "not a readable picture" in flight.stderr
    assert flight.kinds["frame_lost"] <= 12


@both
def test_camera_without_poses_completes(autopilot):
    flight = scenario(autopilot, quirks={"camera_tells_pose": False})
    assert flight.code == 0
    assert flight.kinds["frame_lost"] == 0
    assert flight.columns >= {"home"}


@pytest.mark.parametrize(("autopilot", "ahead_s"), [("ardupilot", -1.7), ("px4", 1000.0)])
def test_camera_with_its_own_clock_completes(autopilot, ahead_s):
    flight = scenario(autopilot, quirks={"camera_clock_s": ahead_s})
    assert flight.code == 0
    assert flight.kinds["frame_lost"] == 0


@pytest.mark.parametrize(("autopilot", "ppm"), [("ardupilot", 2000.0), ("px4", -2000.0)])
def test_drifting_clock_of_a_vehicle_completes(autopilot, ppm):
    """2 s in a thousand: a boot time that is read once is wrong by 0.2 s after this flight."""
    flight = scenario(autopilot, quirks={"clock_ppm": ppm})
    assert flight.code == 0


@both
def test_camera_left_capturing_by_another_process_completes(autopilot):
    flight = scenario(
        autopilot,
        once(flying, lambda v: camera(v, mav.MAV_CMD_IMAGE_START_CAPTURE, 0, 0.5, 0)),
    )
    assert (flight.code, flight.kinds["order_failed"]) == (0, 0)


def camera(vehicle, number, *p):
    filled = (*p, *([0.0] * (7 - len(p))))
    message = mav.MAVLink_command_long_message(1, 100, number, 0, *filled)
    vehicle.receive(message.pack(mav.MAVLink(None, srcSystem=250, srcComponent=190)))


# --- before the flight ---------------------------------------------------------------------------
def test_arming_that_is_refused_is_explained_by_the_vehicle():
    flight = scenario("ardupilot", parameters={"BATT_ARM_VOLT": 30.0})
    assert flight.code == 3
    assert "Battery 1 below minimum arming voltage" in flight.stderr
    assert flight.kinds["lifted_off"] == 0


def test_vehicle_without_satellites_at_the_start_reports_the_reason():
    flight = scenario("ardupilot", faults=[{"kind": "gps", "at_s": 0.0}])
    assert flight.code == 3
    assert "PreArm: GPS 1: Bad fix" in flight.stderr
    assert flight.kinds["lifted_off"] == 0


def test_vehicle_far_from_the_mission_does_not_take_off():
    moved = mission_text("speck").replace("[[vehicles]]", "[[vehicles]]\nhome = [47.303, 8.5]")
    with pytest.raises(Exception, match="fence"):
        parse_mission(moved, "moved")


def test_forced_stop_of_the_motors_is_no_landing():
    flight = scenario(
        "px4", once(flying, lambda v: None),
        once(after(3.0), lambda v: command(v, mav.MAV_CMD_COMPONENT_ARM_DISARM, 0, 21196)),
    )  # fmt: skip
    assert flight.code == 4
    assert flight.columns >= {"crash", "down"}


def cut_at_take_off(vehicle: SimVehicle) -> bool:
    """Silence the link for ever between NAV_TAKEOFF and the report of lift-off."""
    if vehicle._ap.phase.name == "LANDED":
        return False
    vehicle.fail.link(silent=True)
    return True


@pytest.mark.parametrize("autopilot", BOTH)
def test_link_lost_at_take_off_ends_the_flight_when_the_battery_must_be_empty(autopilot):
    """An earlier version gave it up after 120 s, "on the ground", while it hovered."""
    flight = scenario(autopilot, cut_at_take_off)
    assert flight.code == 4, flight.line()
    assert "longer than its battery can have lasted" in flight.stderr
