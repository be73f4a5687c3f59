from __future__ import annotations

import itertools
import math
import struct

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.codec import CURRENT_MODE, EVENT
from sitl.px4.modes import Px4Mode
from sitl.px4.params import bytewise
from tests.unit.sitl.piloted import ACCEPTED, ARM, MAIN, REJECTED, SET_MODE, frames_of, px4


@pytest.fixture
def sitl():
    return px4()


@pytest.mark.parametrize(("name", "commander"), [("OFFBOARD", REJECTED), ("LAND", ACCEPTED)])
def test_the_first_answer_to_a_mode_is_always_yes_and_the_commanders_follows(sitl, name, commander):
    sitl.take_off()
    sitl.receive()
    sitl.send_command(SET_MODE, 1, *MAIN[name])
    sitl.run(0.05)
    assert [m.result for m in sitl.received("COMMAND_ACK")] == [ACCEPTED, commander]
    assert (sitl.truth.mode.name == name) == (commander == ACCEPTED)


def test_texts_go_only_to_links_with_a_ground_station_and_events_to_all(sitl):
    quiet = sitl._vehicle.connect()
    assert sitl.set_mode("LAND") == ACCEPTED
    sitl.send(mav.MAVLink_heartbeat_message(mav.MAV_TYPE_ONBOARD_CONTROLLER, 8, 0, 0, 4, 3))
    sitl.receive()
    sitl.send_command(ARM, 1)
    data = sitl.receive_bytes()
    assert len(frames_of(data, EVENT)) == 1
    arrived = mav.MAVLink(None)
    arrived.robust_parsing = True
    answers = [
        m for m in arrived.parse_buffer(data) if m.get_type() in ("COMMAND_ACK", "STATUSTEXT")
    ]
    assert [m.result for m in answers] == [REJECTED]  # one answer, and no text
    sitl.ground_station()
    quiet.read()
    assert sitl.command(ARM, 1) == REJECTED
    assert "Arming denied" in sitl.expect("STATUSTEXT").text
    reported = quiet.read()  # the other link gets none of it
    assert reported
    assert not frames_of(reported, mav.MAVLINK_MSG_ID_STATUSTEXT)


def test_home_moves_for_two_minutes_after_take_off(sitl):
    sitl.take_off()
    reported = []
    for _ in range(75):
        m = sitl.during(2.0, "GLOBAL_POSITION_INT")[-1]
        reported.append((sitl.t_s, (m.alt - m.relative_alt) / 1000.0, sitl.truth.height_m))
    heights_m = [home_m for _, home_m, _ in reported]
    assert max(map(abs, (b - a for a, b in itertools.pairwise(heights_m)))) > 0.7
    assert all(abs(home_m - 488.0) <= 1.51 for home_m in heights_m)
    assert max(true_m for *_, true_m in reported) - min(true_m for *_, true_m in reported) < 0.3
    assert len({round(home_m, 3) for t_s, home_m, _ in reported if t_s > 140.0}) == 1


def test_home_that_moves_is_seeded_and_can_be_had_still():
    def homes(**quirks):
        vehicle = px4(**quirks)
        vehicle.take_off(4.0)
        return [m.altitude for m in vehicle.during(20.0, "HOME_POSITION")]

    assert homes() == homes()
    assert len(set(homes())) > 3
    assert len(set(homes(home_moves_m=0.0))) == 1


def test_home_that_is_set_in_flight_moves_no_more(sitl):
    sitl.take_off()
    sitl.run(5.0)
    assert sitl.command(mav.MAV_CMD_DO_SET_HOME, 1) == ACCEPTED
    reported = {m.altitude for m in sitl.during(20.0, "HOME_POSITION")}
    assert len(reported) == 1
    assert reported.pop() / 1000.0 == pytest.approx(498.0, abs=1.0)


def test_a_battery_failsafe_breaks_a_landing_off_holds_and_lands(sitl):
    sitl.put(COM_LOW_BAT_ACT=3)
    sitl.take_off()
    assert sitl.command(21) == ACCEPTED
    sitl.until(lambda: sitl.truth.height_m < 3.0)
    sitl.fail.battery_sag(8.0)
    sitl.until(lambda: sitl.truth.mode == Px4Mode.HOLD, timeout_s=1.0)
    held_s, height_m = sitl.t_s, sitl.truth.height_m
    sitl.run(3.5)
    assert sitl.truth.height_m == pytest.approx(height_m, abs=0.5)
    sitl.until(lambda: sitl.truth.mode == Px4Mode.LAND, timeout_s=3.0)
    assert 3.9 <= sitl.t_s - held_s <= 5.2  # COM_FAIL_ACT_T is 5 s
    sitl.until(lambda: not sitl.truth.armed)


def test_disarmed_vehicle_stands_by_only_where_it_could_arm(sitl):
    def status():
        sitl.receive()
        return sitl.expect("HEARTBEAT", autopilot=12).system_status

    assert status() == mav.MAV_STATE_STANDBY
    assert sitl.set_mode("RTL") == ACCEPTED
    assert status() == mav.MAV_STATE_UNINIT
    assert sitl.set_mode("HOLD") == ACCEPTED
    assert status() == mav.MAV_STATE_STANDBY
    sitl.put(NAV_DLL_ACT=2)
    assert sitl.command(ARM, 1) == REJECTED  # it needs a ground station
    sitl.ground_station()
    assert sitl.command(ARM, 1) == ACCEPTED
    assert sitl.command(ARM, 0) == ACCEPTED
    sitl.fail.gps()
    sitl.run(6.0)
    assert status() == mav.MAV_STATE_UNINIT


def test_battery_reports_no_current_no_energy_and_whole_percents(sitl):
    sitl.take_off()
    reported = sitl.during(5.0, "BATTERY_STATUS", "SYS_STATUS")
    batteries = [m for m in reported if m.get_type() == "BATTERY_STATUS"]
    assert 2 <= len(batteries) <= 3  # 0.5 Hz
    for m in reported:
        assert m.battery_remaining == int(m.battery_remaining) > 90
        if m.get_type() == "BATTERY_STATUS":
            assert (m.current_battery, m.current_consumed, m.energy_consumed) == (-1, -1, -1)
        else:
            assert m.current_battery == -1


def leg_s(sitl, north_m):
    """Return the seconds to within 0.7 m of a place ahead, slower than 1.5 m/s."""
    plane = sitl._vehicle.world.plane
    east, north = plane.to_plane(sitl.truth.position)
    goal = plane.to_wgs84(east, north + north_m)
    begin_s = sitl.t_s
    place = round(goal.lat_deg * 1e7), round(goal.lon_deg * 1e7)
    assert sitl.reposition(*place, 498.0, flags=0) == mav.MAV_RESULT_UNSUPPORTED

    def there():
        off = math.dist(plane.to_plane(sitl.truth.position), (east, north + north_m))
        return off < 0.7 and math.hypot(*sitl.truth.velocity_m_s[:2]) < 1.5

    sitl.until(there, timeout_s=30.0)
    return sitl.t_s - begin_s


def test_short_legs_take_long_by_its_jerk_limit(sitl):
    """A real one took 4.0 s for 4 m within a mission; 2.35 s are too few."""
    sitl.take_off()
    sitl.run(2.0)
    assert 2.9 <= leg_s(sitl, 4.0) <= 4.0
    sitl.run(5.0)
    begin_s = leg_s(sitl, 40.0)
    assert 9.5 <= begin_s <= 12.0  # MPC_XY_CRUISE is 5 m/s


# --- 1.17 of 2026-03, as `real-px4` flew it ------------------------------------------------------


def reported_modes(data):
    """Return (mode, intended mode) of each CURRENT_MODE."""
    payloads = [f[10 : 10 + f[1]].ljust(9, b"\0") for f in frames_of(data, CURRENT_MODE)]
    return [struct.unpack_from("<II", payload) for payload in payloads]


def test_heartbeats_keep_their_second_and_current_mode_takes_an_interval(sitl):
    """`set_message_interval` refuses HEARTBEAT; no heartbeat comes with a change of mode."""
    assert sitl.command(511, 0, 200_000) == mav.MAV_RESULT_DENIED
    assert sitl.command(511, CURRENT_MODE, 100_000) == ACCEPTED
    sitl.take_off()
    sitl.until(lambda: sitl.t_s % 1.0 < 0.04)
    sitl.receive_bytes()
    sitl.send_command(SET_MODE, 1, 4, 5)
    sitl.run(0.3)
    data = sitl.receive_bytes()
    assert not frames_of(data, mav.MAVLINK_MSG_ID_HEARTBEAT)
    assert reported_modes(data)[-1] == (Px4Mode.RTL, Px4Mode.RTL)
    assert len(reported_modes(data)) == 3


def test_parameter_that_was_set_is_reported_once_more_up_to_50_ms_later(sitl):
    """Set to 3, answered, sent again, set to 1: a client that takes any PARAM_VALUE reads the 3."""
    sitl.put(GF_ACTION=3)
    sitl.put(GF_ACTION=1)
    sitl.run(0.05)
    copies = [m.param_value for m in sitl.received("PARAM_VALUE")]
    assert copies == [bytewise(3), bytewise(1)]
    sitl.run(1.0)
    assert not sitl.received("PARAM_VALUE")


NEAR = (5100, 473977420 + 500, 85455940, 2.0)  # 5.6 m to the north


@pytest.mark.parametrize(
    ("frame", "reported", "hangs"), [(0, 5, False), (3, 6, False), (6, 6, True)]
)
def test_rally_points_are_reported_in_int_frames_that_no_return_accepts(
    sitl, frame, reported, hangs
):
    """A dry run restored the owner's rally point as received; the RTL to it hung for 55 s."""
    height_m = 490.0 if frame == 0 else 2.0
    assert sitl.upload([(*NEAR[:3], height_m)], kind=2, frame=frame) == 0
    sitl.send(mav.MAVLink_mission_request_int_message(1, 1, 0, 2))
    assert sitl.expect("MISSION_ITEM_INT").frame == reported
    sitl.take_off()
    assert sitl.reposition(NEAR[1], NEAR[2], 498.0) == ACCEPTED
    sitl.run(8.0)
    sitl.ground_station()
    sitl.receive()
    assert sitl.set_mode("RTL") == ACCEPTED
    sitl.run(55.0)
    complaints = [m for m in sitl.receive() if "MAV_FRAME" in getattr(m, "text", "")]
    assert (len(complaints) > 50) == hangs
    assert (sitl.truth.height_m > 9.0) == hangs
    assert sitl.truth.mode == (Px4Mode.RTL if hangs else sitl.truth.mode)


def test_second_copy_of_an_item_is_ignored(sitl):
    sitl.send(mav.MAVLink_mission_count_message(1, 1, 2, 2))
    for _ in range(2):
        sitl.send(
            mav.MAVLink_mission_item_int_message(1, 1, 0, 3, 5100, 0, 1, 0, 0, 0, 0, *NEAR[1:], 2)
        )
    assert not sitl.received("MISSION_ACK")


def test_two_battery_messages_round_differently(sitl):
    """BATTERY_STATUS had 78 while SYS_STATUS had 79, for seconds at each percent."""
    sitl.take_off()
    sitl.receive()
    charges = {}
    differ = agree = 0
    for _ in range(60):
        sitl.run(1.0)
        share = 100.0 * sitl.truth.energy_wh / 60.0
        for m in sitl.receive():
            if m.get_type() in ("BATTERY_STATUS", "SYS_STATUS"):
                charges[m.get_type()] = m.battery_remaining
        assert charges["SYS_STATUS"] in (math.ceil(share), math.ceil(share + 0.2))
        apart = charges["SYS_STATUS"] - charges["BATTERY_STATUS"]
        assert apart in (0, 1, -1)
        differ, agree = differ + (apart == 1), agree + (apart == 0)
    assert min(differ, agree) > 10


def test_low_charge_is_reported_in_both_flavours(sitl):
    """ArduPilot's failsafe: charge_state 2; critical 3. A PX4's comes from its thresholds."""
    sitl.fail.battery_sag(8.0)
    sitl.run(4.0)
    reported = sitl.received("BATTERY_STATUS")
    assert reported[-1].charge_state == mav.MAV_BATTERY_CHARGE_STATE_EMERGENCY
