from __future__ import annotations

import math
import struct

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.codec import EVENT
from sitl.px4.interpreter import number_of
from sitl.px4.modes import Px4Mode
from tests.unit.sitl.piloted import ACCEPTED, ARM, MAIN, REJECTED, SET_MODE, frames_of, local, px4

NORTHWARD = local(0, 0, 0, 0xDC7, 1, (5.0, 0.0, 0.0))


def streaming(**quirks):
    vehicle = px4(**quirks, station=True)
    vehicle.take_off()
    vehicle.stream(NORTHWARD, 0.5)
    assert vehicle.set_mode("OFFBOARD") == ACCEPTED
    vehicle.stream(NORTHWARD, 4.0)
    vehicle.receive()
    return vehicle


@pytest.mark.parametrize("name", ["POSITION", "ALTITUDE", "MANUAL"])
def test_modes_by_hand_with_the_stick_centred_keep_the_height(name):
    """In the measurements POSITION and ALTITUDE in mid-path were kept 16 of 16 times."""
    sitl = px4(wind_m_s=3.0, station=True)
    sitl.take_off()
    assert sitl.set_mode(name) == ACCEPTED
    before = sitl.truth.position
    sitl.run(10.0)
    assert sitl.truth.mode.name == name
    assert sitl.truth.height_m == pytest.approx(10.0, abs=1.0)
    plane = sitl._vehicle.world.plane
    off_m = math.dist(plane.to_plane(before), plane.to_plane(sitl.truth.position))
    assert (off_m < 1.0) == (name == "POSITION")  # the others go with the wind


@pytest.mark.parametrize("name", ["HOLD", "RTL", "LAND"])
def test_the_pilots_automatic_modes_are_not_failsafes(name):
    sitl = px4(station=True)
    sitl.take_off()
    assert sitl.set_mode(name) == ACCEPTED
    sitl.receive()
    beat = sitl.expect("HEARTBEAT", autopilot=12)
    assert (beat.custom_mode, beat.system_status) == (Px4Mode[name], mav.MAV_STATE_ACTIVE)


@pytest.mark.parametrize(
    ("stick", "action", "then"),
    [
        (True, 0, "POSITION"), (True, 1, "ALTITUDE"), (True, 2, "STABILIZED"),
        (False, 0, "RTL"), (True, 3, "RTL"), (True, 4, "LAND"), (True, 5, "HOLD"),
    ],
)  # fmt: skip
def test_mode_after_a_lost_stream_depends_on_the_stick(stick, action, then):
    """kill -9 at 6.2 m/s in OFFBOARD, stick centred, COM_OBL_RC_ACT 0: POSITION 0.9 s later."""
    sitl = streaming(stick=stick)
    sitl.put(COM_OBL_RC_ACT=action)
    began_s = sitl.t_s
    sitl.until(lambda: sitl.truth.mode != Px4Mode.OFFBOARD, timeout_s=2.0)
    assert sitl.truth.mode.name == then
    assert 0.8 <= sitl.t_s - began_s <= 1.3
    sitl.expect_text("Failsafe activated")
    assert sitl.expect("HEARTBEAT", autopilot=12).system_status == mav.MAV_STATE_CRITICAL


@pytest.mark.parametrize("stick", [True, False])
def test_offboard_is_regained_unasked_when_the_stream_returns(stick):
    """`runway` had RTL, status 5, for 1.0 s, then OFFBOARD by itself."""
    sitl = streaming(stick=stick)
    sitl.run(2.0)
    assert sitl.truth.mode == (Px4Mode.POSITION if stick else Px4Mode.RTL)
    assert sitl.truth.failsafe
    assert sitl.texts() == ["Failsafe activated"]  # it names no cause
    sitl.stream(NORTHWARD, 0.3)
    assert sitl.truth.mode == Px4Mode.OFFBOARD
    assert not sitl.truth.failsafe
    sitl.run(2.0)
    # a mode that the pilot chooses meanwhile is kept; no mode by hand works without a stick
    assert sitl.set_mode("POSITION") == (ACCEPTED if stick else REJECTED)
    assert sitl.set_mode("HOLD") == ACCEPTED
    sitl.stream(NORTHWARD, 2.0)
    assert sitl.truth.mode == Px4Mode.HOLD


def test_vehicle_after_a_failsafe_landing_stands_in_offboard_and_cannot_arm():
    """ "Disarmed in OFFBOARD prearm bit 0, in Hold 1, twice each"."""
    sitl = streaming(stick=False)
    sitl.until(lambda: not sitl.truth.armed, timeout_s=120.0)
    assert sitl.truth.mode == Px4Mode.OFFBOARD

    def standing():
        received = {m.get_type(): m for m in sitl.during(1.1) if m.get_srcComponent() == 1}
        ready = received["SYS_STATUS"].onboard_control_sensors_health & 0x1000_0000
        return bool(ready), received["HEARTBEAT"].system_status

    assert standing() == (False, mav.MAV_STATE_UNINIT)
    assert sitl.command(ARM, 1) == REJECTED
    assert sitl.command(SET_MODE, 1, *MAIN["HOLD"]) == ACCEPTED
    assert standing() == (True, mav.MAV_STATE_STANDBY)
    assert sitl.command(ARM, 1) == ACCEPTED


def failsafes(data):
    """Return the end of the name and the arguments of each failsafe event."""
    names = {number_of(f"commander_failsafe_enter{end}") & 0xFFFFFF: end
             for end in ("", "_hold", "_generic", "_generic_hold")}  # fmt: skip
    found = []
    for frame in frames_of(data, EVENT):
        payload = frame[10 : 10 + frame[1]].ljust(25, b"\0")
        number = struct.unpack_from("<I", payload)[0] & 0xFFFFFF
        if number in names:
            found.append((names[number], payload[13:]))
    return found


HOLDS, RETURNS, LANDS = 5, 6, 7  # failsafe_action_t


@pytest.mark.parametrize(
    ("what", "text", "name", "arguments"),
    [
        ("radio", "Manual control lost", "_hold", ("<IBHB", Px4Mode.HOLD, RETURNS, 5, 1)),
        ("station", "ground station lost", "_hold", ("<IBHB", Px4Mode.HOLD, RETURNS, 5, 2)),
        ("battery", "Dangerous battery", "_hold", ("<IBHB", Px4Mode.HOLD, LANDS, 5, 5)),
        ("position", "", "_generic", ("<IB", Px4Mode.HOLD, LANDS)),
    ],
)
def test_cause_of_a_failsafe_is_in_the_arguments_of_its_event_alone(what, text, name, arguments):
    """`failsafe/framework.cpp`, `notifyUser`: the text is the same for all."""
    sitl = px4(station=True)
    sitl.put(COM_LOW_BAT_ACT=3)
    sitl.take_off()
    sitl.ground_station()
    sitl.put(NAV_DLL_ACT=2 if what == "station" else 0)
    sitl.receive()
    if what == "radio":
        sitl.fail.rc()
    elif what == "battery":
        sitl.fail.battery_sag(8.0)
    elif what == "position":
        sitl.fail.gps()
    data, modes = b"", []
    for _ in range(20):
        sitl.run(1.0)
        data += sitl.receive_bytes()
        modes.append(sitl.truth.mode)
    layout, *values = arguments
    assert failsafes(data)[0] == (name, struct.pack(layout, *values).ljust(12, b"\0"))
    assert text.encode() in data
    then = Px4Mode.RTL if values[1] == RETURNS else Px4Mode.LAND
    assert list(dict.fromkeys(modes))[:2] == [Px4Mode.HOLD, then]  # it waits in Hold, or holds out
    assert 4 <= modes.index(then) <= 17
    if what == "position":
        sitl.until(lambda: not sitl.truth.armed)
        assert sitl.command(ARM, 1) == REJECTED


def test_vehicle_that_descends_blind_out_of_offboard_reports_altitude():
    """DESCEND was reported as ALTITUDE, status 5, after a loss of satellites in OFFBOARD."""
    sitl = streaming()
    sitl.fail.gps()
    sitl.stream(NORTHWARD, 6.0)
    sitl.receive()
    beat = sitl.expect("HEARTBEAT", autopilot=12)
    assert (beat.custom_mode, beat.system_status) == (Px4Mode.ALTITUDE, mav.MAV_STATE_CRITICAL)
    assert sitl.truth.velocity_m_s[2] < -0.3
