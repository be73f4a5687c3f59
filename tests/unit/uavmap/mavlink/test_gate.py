"""Impossible messages are refused, counted and reported: real MAVLink frames with valid ids."""

import itertools
import math
import random
import struct
import tracemalloc
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import LatLon
from tests.support.hostile import Hostile
from tests.support.mavlink_peer import Peer, heartbeat, text
from tests.support.mavlink_peer import position as position_at
from uavmap.base.clock import VirtualClock, run
from uavmap.mavlink.continuity import JUMP_CONFIRMED_S, BootClock, distance_m
from uavmap.mavlink.identity import same_aircraft
from uavmap.mavlink.message_gate import LOG_INTERVAL_S, NO_FIX
from uavmap.mavlink.session import Session
from uavmap.mavlink.vehicle_view import VehicleView
from uavmap.mavlink.view_updates import update

Message = Any
LAT, LON = 47.3, 8.5
M_PER_DEG = 111_195.0
TLOG = Path(__file__).parents[5] / "shared" / "data" / "arducopter" / "flight-4.6.tlog"


def position(lat=LAT, lon=LON, **how):
    return position_at(LatLon(lat, lon), **how)


def home(lat=LAT, lon=LON, amsl_m=500.0):
    return mav.MAVLink_home_position_message(
        round(lat * 1e7), round(lon * 1e7), round(amsl_m * 1e3), 0, 0, 0, [1, 0, 0, 0], 0, 0, 0
    )


def battery(percent, number=0, consumed_hj=-1, charge=1):
    return mav.MAVLink_battery_status_message(
        number, 0, 1, 0, [4000] * 10, 100, 0, consumed_hj, percent, 0, charge
    )


def sys_status(percent):
    return mav.MAVLink_sys_status_message(0, 0, 0, 0, 11_000, -1, percent, 0, 0, 0, 0, 0, 0)


def captured(t_s, index=0, lat=LAT):
    return mav.MAVLink_camera_image_captured_message(
        round(t_s * 1000), 0, 0, round(lat * 1e7), round(LON * 1e7), 512_000, 12_000,
        [1.0, 0.0, 0.0, 0.0], index, 1, b"http://127.0.0.1/0.jpg",
    )  # fmt: skip


class Vehicle:
    def __init__(self, first=None):
        self.view = VehicleView()
        self.lines = []
        self.view.gate.say = self.lines.append
        self.receive(first or heartbeat(), 0.0)

    def receive(self, message, now_s, component=1, system=1):
        out = mav.MAVLink(None, srcSystem=system, srcComponent=component)
        (decoded,) = mav.MAVLink(None).parse_buffer(message.pack(out))
        return update(self.view, decoded, now_s)

    def at(self, t_s, north_m=0.0, **how):
        return self.receive(position(LAT + north_m / M_PER_DEG, t_s=t_s, **how), t_s)


# --- ranges ----------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "message",
    [
        position(214.7, t_s=2.0),  # one of these once made a journal unreadable
        position(90.5, t_s=2.0),
        position(-90.1, t_s=2.0),
        position(LAT, 180.1, t_s=2.0),
        position(LAT, -181.0, t_s=2.0),
        position(0.0, 0.0, t_s=2.0),
        position(t_s=2.0, up_m=20_000.0),
        position(t_s=2.0, up_m=12.0, amsl_m=-9_000.0),
        position(t_s=2.0, velocity=(32_767, 0, 0)),
        home(91.0),
        home(0.0, 0.0),
        home(LAT, 181.0),
        home(amsl_m=2_000_000.0),
        home(LAT + 5.0),
        battery(101),
        battery(-2),
        battery(50, number=99),
        battery(50, consumed_hj=2**31 - 1),
        sys_status(-7),
        sys_status(127),
        mav.MAVLink_extended_sys_state_message(0, 200),
        mav.MAVLink_attitude_message(0, math.nan, 0.0, 0.0, 0.0, 0.0, 0.0),
        mav.MAVLink_attitude_message(0, 0.0, math.inf, 0.0, 0.0, 0.0, 0.0),
        mav.MAVLink_attitude_quaternion_message(0, *([math.nan] * 4), 0.0, 0.0, 0.0),
        mav.MAVLink_attitude_quaternion_message(0, 0, 0, 0, 0, 0.0, 0.0, 0.0),
        mav.MAVLink_attitude_quaternion_message(0, 1.1, 0, 0, 0, 0.0, 0.0, 0.0),
        mav.MAVLink_wind_message(math.nan, 1.0, 0.0),
        heartbeat(100_000),
        mav.MAVLink_heartbeat_message(77, mav.MAV_AUTOPILOT_ARDUPILOTMEGA, 0, 4, 4, 3),
        mav.MAVLink_heartbeat_message(2, mav.MAV_AUTOPILOT_ARDUPILOTMEGA, 0, 4, 99, 3),
        heartbeat(autopilot=mav.MAV_AUTOPILOT_PX4),
        heartbeat(4 << 16 | 3 << 24, autopilot=mav.MAV_AUTOPILOT_PX4),
    ],
    ids=lambda m: m.get_type(),
)
def test_impossible_message_changes_nothing(message):
    vehicle = Vehicle()
    assert vehicle.at(1.0)
    assert vehicle.receive(home(), 1.0)
    assert vehicle.receive(battery(60), 1.0)
    before = seen(vehicle.view)
    assert not vehicle.receive(message, 2.0)
    assert seen(vehicle.view) == before
    ((kind, _), count) = vehicle.view.gate.refused.most_common(1)[0]
    assert (kind, count) == (message.get_type(), 1)


def seen(view):
    return (
        view.mode, view.armed, view.received_s, view.position, view.position_s, view.height_m,
        view.home_amsl_m, view.velocity_ned_m_s, view.home, view.battery_percent, view.battery_s,
        view.energy_consumed_j, view.landed_state, view.uid, view.camera_component,
    )  # fmt: skip


def test_zeros_before_the_first_fix_are_no_place():
    vehicle = Vehicle()
    assert not vehicle.at(1.0, -LAT * M_PER_DEG, lon=0.0)
    assert vehicle.view.position is None
    assert vehicle.view.gate.refused == {("GLOBAL_POSITION_INT", NO_FIX): 1}
    assert len(vehicle.lines) == 0


@pytest.mark.parametrize("mode", [0, 3 << 24, 4 << 16 | 3 << 24 | 1])
def test_mode_that_no_px4_has_is_refused(mode):
    hold = 4 << 16 | 3 << 24
    vehicle = Vehicle(heartbeat(hold, autopilot=mav.MAV_AUTOPILOT_PX4))
    assert not vehicle.receive(heartbeat(mode, autopilot=mav.MAV_AUTOPILOT_PX4), 1.0)
    assert vehicle.view.mode == hold
    assert vehicle.view.gate.refused == {("HEARTBEAT", "no such mode"): 1}


def test_second_component_does_not_report_for_the_autopilot():
    vehicle = Vehicle()
    assert vehicle.at(1.0)
    for message in (
        position(t_s=1.1),
        home(),
        battery(80),
        sys_status(80),
        mav.MAVLink_extended_sys_state_message(0, 2),
        mav.MAVLink_ekf_status_report_message(0x33F, 0, 0, 0, 0, 0),
    ):
        before = seen(vehicle.view)
        assert not vehicle.receive(message, 1.1, component=180)
        assert seen(vehicle.view) == before
    assert set(vehicle.view.gate.refused) == {
        (kind, "not sent by the autopilot")
        for kind in (
            "GLOBAL_POSITION_INT", "HOME_POSITION", "BATTERY_STATUS", "SYS_STATUS",
            "EXTENDED_SYS_STATE", "EKF_STATUS_REPORT",
        )
    }  # fmt: skip


def test_pictures_are_announced_by_the_first_camera_only():
    vehicle = Vehicle()
    beat = mav.MAVLink_heartbeat_message(mav.MAV_TYPE_CAMERA, mav.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)
    assert vehicle.receive(captured(1.0), 1.0, component=100)
    assert not vehicle.receive(captured(1.0), 1.0, component=1)
    vehicle.receive(beat, 2.0, component=101)
    assert vehicle.view.camera_component == 101
    vehicle.receive(beat, 3.0, component=102)
    assert vehicle.view.camera_component == 101
    assert not vehicle.receive(captured(3.0), 3.0, component=102)
    vehicle.receive(beat, 13.5, component=102)  # the other has been silent for long
    assert vehicle.view.camera_component == 102


@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
def test_home_height_of_px4_in_air_is_known_in_any_order(order):
    """A real PX4 sends state and estimator before its position.

    An earlier version assumed its home at sea level and landed it on the spot: "55.8 Wh are left,
    and landing takes 132.2".
    """
    vehicle = Vehicle(heartbeat(4 << 16 | 3 << 24, armed=True, autopilot=mav.MAV_AUTOPILOT_PX4))
    messages = (
        mav.MAVLink_extended_sys_state_message(0, mav.MAV_LANDED_STATE_IN_AIR),
        position(t_s=1.0, up_m=12.0, amsl_m=548.0),
        home(amsl_m=536.0),
    )
    for index in order:
        assert vehicle.receive(messages[index], 1.0)
    assert (vehicle.view.home_amsl_m, vehicle.view.height_m) == (536.0, 12.0)
    vehicle.receive(position(t_s=1.1, up_m=11.0, amsl_m=548.0), 1.1)  # a PX4 corrects its home
    assert (vehicle.view.home_amsl_m, vehicle.view.height_m) == (536.0, 12.0)


def test_home_height_of_px4_that_stands_is_the_height_at_which_it_stands():
    """On the ground between two flights a PX4 1.17 moved its home by 1.4 m.

    Its own height changed by 0.1 m; then it flew 1.5 m lower than ordered.
    """
    vehicle = Vehicle(heartbeat(4 << 16 | 3 << 24, autopilot=mav.MAV_AUTOPILOT_PX4))
    vehicle.receive(mav.MAVLink_extended_sys_state_message(0, mav.MAV_LANDED_STATE_ON_GROUND), 1.0)
    for second, above_home_m in enumerate((0.8, -0.6, 1.4), start=1):
        vehicle.receive(position(t_s=second, up_m=above_home_m, amsl_m=536.1), float(second))
        assert vehicle.view.home_amsl_m == pytest.approx(536.1)
        assert vehicle.view.height_m == pytest.approx(0.0)
    # on a slope below its home it does not stand at the height of its home
    vehicle.receive(position(t_s=4.0, up_m=-9.0, amsl_m=527.1), 4.0)
    assert vehicle.view.home_amsl_m == pytest.approx(536.1)


# --- the battery -----------------------------------------------------------------------------
@pytest.mark.parametrize(
    "charges",
    [
        [(battery(12), 7.8), (battery(97, number=1), 7.8)],
        [(battery(97, number=2, consumed_hj=36), 58.8), (battery(12, number=0), 7.8)],
        [(sys_status(50), 30.6), (battery(-1, consumed_hj=1440), 20.0), (sys_status(-1), 20.0)],
    ],
    ids=["a second one", "the lowest number", "two messages"],
)
def test_charge_is_that_of_the_battery_it_flies_on(charges):
    vehicle = Vehicle()
    for second, (message, left_wh) in enumerate(charges):
        vehicle.receive(message, 1.0 + second)
        assert vehicle.view.remaining_wh(60.0) == pytest.approx(left_wh)
    assert (vehicle.view.battery_percent is None) == (len(charges) == 3)


def test_message_without_a_charge_does_not_renew_an_old_one():
    vehicle = Vehicle()
    vehicle.receive(battery(-1, consumed_hj=1080), 1.0)
    assert vehicle.view.remaining_wh(60.0) == pytest.approx(30.0)
    vehicle.receive(sys_status(-1), 300.0)
    vehicle.receive(battery(-1), 300.0)
    assert vehicle.view.battery_s == 1.0
    assert vehicle.view.remaining_wh(60.0) is None


def test_two_messages_that_round_differently_are_one_battery():
    """A real PX4 sent 78 % in BATTERY_STATUS and 79 % in SYS_STATUS for seconds at each percent."""
    vehicle, percents = Vehicle(), []
    for n in range(100):
        left = 90.0 - 0.08 * n
        vehicle.receive(battery(math.floor(left)), 1.0 + 0.5 * n)
        percents.append(vehicle.view.battery_percent)
        vehicle.receive(sys_status(math.ceil(left)), 1.3 + 0.5 * n)
        percents.append(vehicle.view.battery_percent)
    assert percents == sorted(percents, reverse=True)
    assert percents[-1] == 82
    for n in range(10):  # BATTERY_STATUS falls silent: the other counts before the charge is stale
        vehicle.receive(sys_status(80), 51.0 + n)
    assert vehicle.view.battery_percent == 80
    assert vehicle.view.battery_s == 60.0


@pytest.mark.parametrize(("charge", "reported"), [(0, ""), (1, ""), (2, "low"), (7, "")])
def test_charge_state_of_the_flown_battery_is_read(charge, reported):
    vehicle = Vehicle()
    vehicle.receive(battery(64, number=1, charge=4), 0.5)
    vehicle.receive(battery(64, charge=charge), 1.0)
    vehicle.receive(battery(64, number=1, charge=4), 1.5)  # of the camera
    assert vehicle.view.battery_low == reported
    assert vehicle.view.grounded_by == (reported and "its autopilot reports its battery as low")


def test_critical_state_of_an_ardupilot_is_reported_and_grounds_no_vehicle():
    vehicle = Vehicle()
    beat = heartbeat(armed=True)
    beat.system_status = mav.MAV_STATE_CRITICAL
    vehicle.receive(beat, 1.0)
    assert vehicle.view.grounded_by == ""
    assert vehicle.view.texts_since(0.0) == ["system status CRITICAL"]


# --- leaps -----------------------------------------------------------------------------------
def test_leap_is_not_believed_at_once():
    vehicle = Vehicle()
    assert vehicle.at(1.0)
    assert not vehicle.at(1.1, 500.0)
    assert vehicle.at(1.2, 1.0)
    assert vehicle.view.position == LatLon(round((LAT + 1.0 / M_PER_DEG) * 1e7) / 1e7, LON)
    assert vehicle.view.gate.track.jumps == 0


def test_leap_that_stays_is_believed_and_reported():
    vehicle = Vehicle()
    assert vehicle.at(1.0)
    taken = [vehicle.at(2.0 + 0.1 * n, 500.0) for n in range(40)]
    assert taken == [False] * 30 + [True] * 10
    assert round(30 * 0.1, 3) == JUMP_CONFIRMED_S
    assert vehicle.view.gate.track.jumps == 1
    assert any("jumped by 500 m" in line for line in vehicle.lines)


def test_stranger_between_the_true_positions_never_wins():
    vehicle = Vehicle()
    for n in range(200):
        assert vehicle.at(1.0 + 0.1 * n)
        assert not vehicle.at(1.05 + 0.1 * n, 500.0)


@pytest.mark.parametrize("speed_m_s", [0.0, 12.0, 30.0])
@pytest.mark.parametrize("gap_s", [0.1, 1.0, 20.0])
def test_flight_is_no_leap(speed_m_s, gap_s):
    vehicle = Vehicle()
    assert all(vehicle.at(1.0 + gap_s * n, speed_m_s * gap_s * n) for n in range(20))


def test_height_that_leaps_is_a_leap():
    vehicle = Vehicle()
    assert vehicle.at(1.0)
    assert not vehicle.at(1.1, up_m=400.0)
    assert not vehicle.at(1.2, up_m=400.0, amsl_m=512.0)
    assert vehicle.at(1.3)


def test_place_far_from_the_mission_is_refused():
    vehicle = Vehicle()
    vehicle.view.gate.area = LatLon(-33.0, 151.0)
    assert not any(vehicle.at(1.0 + n) for n in range(20))
    assert vehicle.view.position is None
    vehicle.view.gate.area = LatLon(LAT, LON)
    assert vehicle.at(30.0)


# --- clocks ----------------------------------------------------------------------------------
def test_old_message_is_refused():
    vehicle = Vehicle()
    for t_s in (5.0, 5.1):
        assert vehicle.at(t_s)
    assert not vehicle.receive(position(t_s=3.0), 5.15)
    assert vehicle.lines == []  # links that change the order of frames are common
    assert vehicle.receive(position(t_s=5.1), 5.15)  # the same twice, as radios do
    assert vehicle.view.position_s == 5.15
    assert vehicle.view.boot_offset_s == pytest.approx(0.0)


def test_message_repeated_for_ever_is_no_news():
    vehicle = Vehicle()
    for n in range(100):
        vehicle.receive(position(t_s=5.0), 5.0 + 0.1 * n)
    assert vehicle.view.position_s == pytest.approx(7.0)


def test_restart_is_recognised_after_a_second():
    vehicle = Vehicle()
    assert vehicle.at(500.0)
    taken = [vehicle.receive(position(t_s=1.0 + 0.1 * n), 510.0 + 0.1 * n) for n in range(20)]
    assert taken == [False] * 10 + [True] * 10
    assert vehicle.view.gate.clock.reboots == 1
    assert vehicle.view.boot_offset_s == pytest.approx(509.0)
    assert any("restarted" in line for line in vehicle.lines)


def test_clock_that_leaps_ahead_once_is_not_followed():
    vehicle = Vehicle()
    assert vehicle.at(1.0)
    assert not vehicle.receive(position(t_s=4_000_000.0), 1.1)
    assert vehicle.at(1.2)
    assert vehicle.view.boot_offset_s == pytest.approx(0.0)


@pytest.mark.parametrize("rate", [0.3, 1.0, 10.0])
def test_clock_of_another_speed_is_followed(rate):
    """A simulator may run slower or faster than its stated speed."""
    clock = BootClock()
    for n in range(1, 2000):
        assert clock.add(rate * 0.1 * n, 0.1 * n) is None
    now_s, boot_s = 199.9, rate * 199.9
    assert clock.offset_s is not None
    assert boot_s + clock.offset_s == pytest.approx(now_s, abs=4.0)


def test_backlog_of_seconds_is_no_change_of_the_clock():
    vehicle = Vehicle()
    for n in range(600):
        assert vehicle.receive(position(t_s=100.0 + 0.1 * n), 0.02 + 0.1 * n)
    for n in range(120):  # 12 s, read with a growing delay
        late_s = min(0.05 * n, 3.4)
        assert vehicle.receive(position(t_s=160.0 + 0.1 * n), 60.02 + 0.1 * n + late_s)
        assert vehicle.view.age_s(60.02 + 0.1 * n + late_s) == pytest.approx(late_s, abs=0.1)
    assert vehicle.view.boot_offset_s == pytest.approx(-99.98, abs=0.1)


@pytest.mark.parametrize("rate", [0.97, 1.0, 1.03])
def test_age_is_right_where_a_simulator_runs_a_little_slower(rate):
    vehicle = Vehicle()
    for n in range(1, 1200):
        assert vehicle.receive(position(t_s=rate * 0.1 * n), 0.1 * n)
        assert vehicle.view.age_s(0.1 * n) < 0.95
    assert vehicle.view.age_s(119.9) < 0.1


def test_clock_that_stood_still_is_followed_within_two_minutes():
    """A simulator that was stopped for 3 s: its later frames are no backlog for ever."""
    vehicle = Vehicle()
    for n in range(2400):
        stopped_s = 3.0 if n >= 600 else 0.0
        vehicle.receive(position(t_s=1.0 + 0.1 * n), 0.1 * n + stopped_s)
    assert vehicle.view.age_s(0.1 * 2399 + 3.0) < 0.1


@given(st.lists(st.tuples(st.floats(0.0, 1e6), st.floats(0.0, 100.0)), max_size=60))
def test_clock_never_lies_in_the_future(times):
    clock, now_s = BootClock(), 0.0
    for boot_s, step_s in times:
        now_s += step_s
        if clock.add(boot_s, now_s) is None:
            assert clock.offset_s is not None
            assert boot_s + clock.offset_s <= now_s + 1e-6


# --- the camera's clock ----------------------------------------------------------------------
@pytest.mark.parametrize("ahead_s", [60.0, -4.0, 1.0, 0.0, 3600.0])
def test_camera_with_its_own_clock_is_dated_right(ahead_s):
    vehicle = Vehicle()
    for n in range(50, 100):
        vehicle.at(0.1 * n)
    for n in range(5):
        taken_s = 10.0 + n
        assert vehicle.receive(captured(taken_s + ahead_s, n), taken_s + 0.05, component=100)
        boot_ms = round((taken_s + ahead_s) * 1000)
        assert vehicle.view.captured_s(boot_ms, taken_s + 0.1) == pytest.approx(taken_s, abs=0.06)


def test_cameras_clock_that_leaps_costs_at_most_one_stamp():
    vehicle = Vehicle()
    vehicle.at(5.0)
    for taken_s, boot_s in ((6.0, 6.0), (7.0, 900_000.0), (8.0, 8.0)):
        vehicle.receive(captured(boot_s), taken_s, component=100)
        stamp_s = vehicle.view.captured_s(round(boot_s * 1000), taken_s + 0.1, since_s=5.9)
        assert 5.4 <= stamp_s <= taken_s + 0.1
    assert stamp_s == pytest.approx(8.0)
    for taken_s in (20.0, 21.0, 22.0):  # a restart: the second frame makes it certain
        vehicle.receive(captured(taken_s - 2000.0 + 4000.0), taken_s, component=100)
    assert vehicle.view.captured_s(2022_000, 22.1) == pytest.approx(22.0)


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 1e5), st.floats(0.0, 1e3))
def test_stamp_lies_between_order_and_now(boot_ms, now_s, ago_s):
    view = VehicleView()
    since_s = now_s - ago_s
    assert since_s - 0.5 - 1e-6 <= view.captured_s(boot_ms, now_s, since_s) <= now_s


# --- what is told ----------------------------------------------------------------------------
def test_refused_kind_is_reported_once_in_ten_seconds():
    vehicle = Vehicle()
    for n in range(300):
        vehicle.receive(position(214.7, t_s=1.0 + 0.1 * n), 1.0 + 0.1 * n)
    assert len(vehicle.lines) == math.ceil(30.0 / LOG_INTERVAL_S)
    assert vehicle.lines[0] == "GLOBAL_POSITION_INT refused: lat is out of range"
    assert vehicle.view.gate.figures() == {"GLOBAL_POSITION_INT: lat is out of range": 300}


def test_position_without_a_fix_is_counted_and_not_reported():
    vehicle = Vehicle()
    vehicle.receive(position(0.0, 0.0, t_s=1.0), 1.0)
    assert vehicle.lines == []
    assert vehicle.view.boot_offset_s == pytest.approx(0.0)  # its clock is right nevertheless


def test_texts_are_made_printable_and_old_ones_left_out():
    vehicle = Vehicle()
    vehicle.receive(text("\x1b]0;owned\x07\x1b[31mPreArm: bad\x1b[0m\r\x08"), 1.0)
    assert vehicle.view.recent_texts(2.0) == " (vehicle: PreArm: bad)"
    assert vehicle.view.recent_texts(6.5) == ""  # seconds from now, not from the latest


# --- two links to one aircraft ---------------------------------------------------------------
def identified(uid=0, uid2=0, system=1, north_m=0.0, boot_s=1.0):
    vehicle = Vehicle()
    if system != 1:
        vehicle.view = VehicleView()
        vehicle.receive(heartbeat(), 0.0, system=system)
    version = mav.MAVLink_autopilot_version_message(
        0, 0, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, uid, [uid2] * 18
    )
    vehicle.receive(version, 1.0, system=system)
    vehicle.receive(position(LAT + north_m / M_PER_DEG, t_s=boot_s), 1.0, system=system)
    return vehicle.view


@pytest.mark.parametrize(
    ("a", "b", "same"),
    [
        (identified(uid2=5), identified(uid2=5), True),
        (identified(uid2=5), identified(uid2=6), False),
        (identified(uid=7), identified(uid=7), True),
        (identified(uid=7), identified(uid=8), False),
        (identified(), identified(), True),
        (identified(), identified(uid=7), True),
        (identified(), identified(north_m=2.0), False),
        (identified(), identified(boot_s=4.0), False),
        (identified(), identified(system=2), False),
        (
            identified(uid2=5),
            identified(uid2=5, system=2),
            False,
        ),  # simulators share a made-up number
        (VehicleView(), VehicleView(), False),
    ],
)
def test_links_to_the_same_aircraft_are_recognised(a, b, same):
    assert same_aircraft(a, b) is same
    assert same_aircraft(b, a) is same


# --- whatever comes ----------------------------------------------------------------------------
def in_session(body):
    async def main():
        peer = Peer()
        peer.session.feed(peer.frame(heartbeat()))
        body(peer)
        return peer

    return run(main(), VirtualClock())


_KINDS = (
    "HEARTBEAT", "GLOBAL_POSITION_INT", "HOME_POSITION", "SYS_STATUS", "BATTERY_STATUS",
    "EXTENDED_SYS_STATE", "EKF_STATUS_REPORT", "ESTIMATOR_STATUS", "AUTOPILOT_VERSION",
    "STATUSTEXT", "CAMERA_IMAGE_CAPTURED", "COMMAND_ACK", "ATTITUDE", "ATTITUDE_QUATERNION",
    "GPS_RAW_INT",
)  # fmt: skip


def poisoned(hostile, rng):
    """Return a message that the session reads, with any values, or with a few bad ones."""
    kind = mav.mavlink_map[getattr(mav, f"MAVLINK_MSG_ID_{rng.choice(_KINDS)}")]
    message = hostile._fill(kind, wrong_target=False)
    if kind.msgname == "GLOBAL_POSITION_INT" and rng.random() < 0.7:
        message.lat, message.lon = round(LAT * 1e7), round(LON * 1e7)
        setattr(
            message,
            rng.choice(("lat", "lon", "alt", "relative_alt")),
            rng.randrange(-(2**31), 2**31),
        )
    return message


def test_ten_thousand_poisoned_frames_with_the_vehicles_ids_are_survived():
    rng, hostile = random.Random(11), Hostile(11)
    heard = []

    def bombard(peer):
        session = peer.session
        session.listen(lambda message: heard.append(message.get_type()))
        chunks = hostile.chunks(well_addressed=True)
        settled = None
        tracemalloc.start()
        for number in range(10_000):
            if number % 20 == 0:
                session.feed(peer.frame(position(t_s=1.0 + number / 100)))
            elif rng.random() < 0.3:
                session.feed(next(chunks)[1])
            else:
                component = rng.choice((1, 1, 1, 100, 180))
                frame = bytearray(peer.frame(poisoned(hostile, rng), component))
                session.feed(bytes(frame))
            assert finite(session.view)
            if number == 3000:
                heard.clear()
                settled = tracemalloc.get_traced_memory()[0]
                heard_before = len(peer.frames)
            if number >= 3000:
                del peer.frames[heard_before:]  # the log is on disk in a flight
                heard.clear()
        grown = tracemalloc.get_traced_memory()[0] - settled
        tracemalloc.stop()
        assert grown < 300_000

    peer = in_session(bombard)
    assert peer.session.view.gate.refused.total() > 1000
    assert len(peer.session.view.gate.refused) < 100


def finite(view):
    numbers = [view.height_m, view.home_amsl_m, *view.velocity_ned_m_s]
    for place in (view.position, view.home):
        if place is not None:
            numbers += [place.lat_deg, place.lon_deg]
            assert abs(place.lat_deg) <= 90.0
            assert abs(place.lon_deg) <= 180.0
    numbers += [view.boot_offset_s or 0.0, view.remaining_wh(60.0) or 0.0]
    return all(map(math.isfinite, numbers))


def test_stream_that_is_never_read_to_its_end_takes_no_memory():
    """The parser releases its buffer only if no bytes are left over."""

    def endless(peer):
        frame = peer.frame(text("x" * 40))
        peer.session.feed(frame[:5])
        for _ in range(2000):
            peer.session.feed(frame[5:] + frame[:5])
        assert len(peer.session._codec.buf) < 10_000
        assert peer.session.view.text_count == 2000

    in_session(endless)


def test_parser_that_raises_costs_its_bytes_only(monkeypatch):
    def hit(peer):
        parse = peer.session._codec.parse_char

        def raising(data):
            if data.startswith(b"bad"):
                raise struct.error("unpack requires more")
            return parse(data)

        monkeypatch.setattr(peer.session._codec, "parse_char", raising)
        assert not peer.session.feed(b"bad")
        assert peer.session.feed(peer.frame(heartbeat(9)))
        assert peer.session.view.mode == 9

    in_session(hit)


@pytest.mark.skipif(not TLOG.is_file(), reason="the recorded flight is not beside this repository")
def test_recording_of_a_real_flight_passes_whole():
    """In the recording of an ArduCopter only positions before the fix are refused."""
    data = TLOG.read_bytes()
    session = []
    refusals = []
    heard = Counter()
    clock = VirtualClock()

    async def main():
        link = Session(lambda frame: None, lambda frame: None)
        session.append(link)
        link.view.gate.say = refusals.append
        link.listen(lambda message: heard.update([message.get_type()]))
        at, begun_us = 0, None
        reader = mav.MAVLink(None)
        reader.robust_parsing = True
        while at < len(data):
            (stamp_us,) = struct.unpack_from(">Q", data, at)
            begun_us = begun_us or stamp_us
            length = data[at + 9] + (12 if data[at + 8] == 0xFD else 8)
            length += 13 if data[at + 8] == 0xFD and data[at + 10] & 1 else 0
            clock._now_s = max(clock._now_s, (stamp_us - begun_us) / 1e6)
            link.feed(data[at + 8 : at + 8 + length])
            at += 8 + length

    run(main(), clock)
    view = session[0].view
    assert view.position is not None
    assert view.home is not None
    assert distance_m(view.position, view.home) < 100.0
    reasons = {reason for (_, reason) in view.gate.refused}
    assert reasons <= {"no position yet"}
    assert refusals == []
    assert heard["GLOBAL_POSITION_INT"] > 700
    assert view.uid != ""
