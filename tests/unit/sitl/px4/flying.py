"""For the tests of a PX4: one that is ready, and what its clients say to it."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.codec import EVENT, cut
from sitl.px4.modes import Px4Mode
from sitl.px4.params import TABLE, bytewise, from_bytewise
from sitl.quirks import Quirks
from sitl.scenario import Setup
from sitl.testing import Fleet

NAN = math.nan
AMSL_M = 488.0
LAT, LON = 473977420, 85455940
NORTH = LAT + 2700  # 30 m
INT32, REAL32 = mav.MAV_PARAM_TYPE_INT32, mav.MAV_PARAM_TYPE_REAL32
ACCEPTED, REJECTED = mav.MAV_RESULT_ACCEPTED, mav.MAV_RESULT_TEMPORARILY_REJECTED
UNSUPPORTED = mav.MAV_RESULT_UNSUPPORTED
ARM, TAKEOFF, LAND, RTL, SET_MODE = 400, 22, 21, 20, 176
MAIN = {
    "HOLD": (4, 3), "MISSION": (4, 4), "RTL": (4, 5), "LAND": (4, 6), "OFFBOARD": (6, 0),
    "POSITION": (3, 0), "ALTITUDE": (2, 0), "MANUAL": (1, 0),
}  # fmt: skip


def px4(wind_m_s=0.0, **quirks):
    """One that has found its position, to a client that is no ground station."""
    setup = Setup(
        autopilot="px4", gps_sigma_m=0.0, wind_speed_m_s=wind_m_s, quirks=Quirks(**quirks)
    )
    vehicle = Fleet(setup)[0]
    vehicle.run(6.0)
    vehicle.receive()
    return vehicle


def mode(sitl, name):
    """The commander's answer; the receiver's, before it, is always yes."""
    assert sitl.command(SET_MODE, 1, *MAIN[name]) == ACCEPTED
    return sitl.expect("COMMAND_ACK", timeout_s=0.1, command=SET_MODE).result


def take_off(sitl, height_m=10.0):
    assert sitl.command(ARM, 1) == ACCEPTED
    assert sitl.command(TAKEOFF, 0, 0, 0, NAN, NAN, NAN, AMSL_M + height_m) == ACCEPTED
    sitl.until(lambda: sitl.truth.mode == Px4Mode.HOLD)


def reposition(
    sitl, lat, lon, amsl_m, *, flags=1, frame=mav.MAV_FRAME_GLOBAL_INT, yaw=NAN, speed=-1.0
):
    p = (speed, flags, 0.0, yaw)
    sitl.send(mav.MAVLink_command_int_message(1, 1, frame, 192, 0, 0, *p, lat, lon, amsl_m))
    return sitl.expect("COMMAND_ACK", command=192).result


def set_param(sitl, name, value):
    kind = next(p.type for p in TABLE if p.name == name)
    sent = bytewise(value) if kind == INT32 else value
    sitl.send(mav.MAVLink_param_set_message(1, 1, name.encode(), sent, kind))
    answer = sitl.expect("PARAM_VALUE", param_id=name)
    got = from_bytewise(answer.param_value) if kind == INT32 else answer.param_value
    assert (answer.param_type, got) == (kind, pytest.approx(value))


def local(x, y, z, mask=0xDF8, frame=1, velocity=(0.0, 0.0, 0.0)):
    return mav.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, frame, mask, x, y, z, *velocity, 0, 0, 0, 0, 0
    )


def stream(sitl, message, seconds, every_s=0.1):
    for _ in range(round(seconds / every_s)):
        sitl.send(message)
        sitl.run(every_s)


def texts(sitl):
    return " | ".join(m.text for m in sitl.receive() if m.get_type() == "STATUSTEXT")


def said(sitl, text):
    while text not in sitl.expect("STATUSTEXT").text:
        pass


def upload(sitl, items, kind=0, frame=6):
    sitl.send(mav.MAVLink_mission_count_message(1, 1, len(items), kind))
    while True:
        sitl.run(0.05)
        for m in sitl.receive():
            if m.get_type() == "MISSION_REQUEST_INT":
                command, x, y, z, *p = items[m.seq]
                p = tuple(p) + (0.0,) * (4 - len(p))
                sitl.send(
                    mav.MAVLink_mission_item_int_message(
                        1, 1, m.seq, frame, command, 0, 1, *p, x, y, z, kind
                    )
                )
            elif m.get_type() == "MISSION_ACK":
                return m.type


def events(data):
    return [frame for frame in cut(data) if int.from_bytes(frame[7:10], "little") == EVENT]
