"""Simulated vehicles with a client, for the tests on virtual time."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import LatLon
from sitl.codec import cut
from sitl.px4.modes import Px4Mode
from sitl.quirks import Quirks
from sitl.scenario import Setup
from sitl.testing import Fleet, Vehicle

NAN = math.nan
AUTOPILOTS = ("ardupilot", "px4")
AMSL_M = 488.0
LAT, LON = 473977420, 85455940
NORTH = LAT + 2700  # 30 m
ACCEPTED, REJECTED = mav.MAV_RESULT_ACCEPTED, mav.MAV_RESULT_TEMPORARILY_REJECTED
DENIED, UNSUPPORTED = mav.MAV_RESULT_DENIED, mav.MAV_RESULT_UNSUPPORTED
ARM, TAKEOFF, LAND, RTL, SET_MODE = 400, 22, 21, 20, 176
VELOCITY, RELATIVE, ABSOLUTE, CONSTANT = 0x06, 0x08, 0x10, 0x80  # flags of the filter's report
MAIN = {
    "HOLD": (4, 3), "MISSION": (4, 4), "RTL": (4, 5), "LAND": (4, 6), "OFFBOARD": (6, 0),
    "POSITION": (3, 0), "ALTITUDE": (2, 0), "MANUAL": (1, 0),
}  # fmt: skip


class Piloted(Vehicle):
    @property
    def where(self):
        """True place east and north of the start of the first vehicle, m."""
        return self._vehicle.world.plane.to_plane(self.truth.position)

    @property
    def reported(self):
        """Place by GLOBAL_POSITION_INT, m."""
        m = self.ask("GLOBAL_POSITION_INT")
        return self._vehicle.world.plane.to_plane(LatLon(m.lat / 1e7, m.lon / 1e7))

    @property
    def off_m(self):
        return math.hypot(*self.truth.estimate_error_m)

    @property
    def flags(self):
        reports = {"ardupilot": "EKF_STATUS_REPORT", "px4": "ESTIMATOR_STATUS"}
        return self.ask(reports[self.fleet.setup.autopilot]).flags

    def place(self, east_m, north_m):
        at = self._vehicle.world.plane.to_wgs84(east_m, north_m)
        return round(at.lat_deg * 1e7), round(at.lon_deg * 1e7)

    def received(self, *kinds):
        """Return the messages since the last call, of some kinds or of all."""
        return [m for m in self.receive() if not kinds or m.get_type() in kinds]

    def during(self, seconds, *kinds):
        """Return the messages of the next seconds."""
        self.receive()
        self.run(seconds)
        return self.received(*kinds)

    def texts(self):
        return [m.text for m in self.received("STATUSTEXT")]

    def expect_text(self, text):
        while text not in self.expect("STATUSTEXT").text:
            pass

    def ask(self, kind):
        """Request a message and return it."""
        self.receive()
        message_id = getattr(mav, f"MAVLINK_MSG_ID_{kind}")
        self.send_command(mav.MAV_CMD_REQUEST_MESSAGE, message_id)
        return self.received(kind)[0]

    def send_command(self, command, *p, component=1):
        """Send a command without waiting for its answer."""
        p = (*p, *([0.0] * (7 - len(p))))
        self.send(mav.MAVLink_command_long_message(self.system_id, component, command, 0, *p))

    def put(self, **values):
        """Set parameters; whole numbers of a PX4 are sent bytewise."""
        vehicle = self._vehicle
        for name, value in values.items():
            parameter = vehicle._ap.parameters.by_name[name]
            sent = vehicle._interpreter._on_wire(parameter, value)
            number = self.system_id, 1
            self.send(mav.MAVLink_param_set_message(*number, name.encode(), sent, parameter.type))
            answer = self.expect("PARAM_VALUE", param_id=name)
            assert answer.param_type == parameter.type
            assert answer.param_value == pytest.approx(sent, rel=1e-6, abs=0.0)

    def fly_to(self, east_m, north_m):
        self.send(
            mav.MAVLink_command_int_message(
                self.system_id, 1, 5, mav.MAV_CMD_DO_REPOSITION, 0, 0, -1, 1, 0, NAN,
                *self.place(east_m, north_m), AMSL_M + 10.0,
            )
        )  # fmt: skip

    # --- a PX4 ----------------------------------------------------------------------------------

    def set_mode(self, name):
        """Set a mode; return the commander's answer, the second: the receiver's is always yes."""
        assert self.command(SET_MODE, 1, *MAIN[name]) == ACCEPTED
        return self.expect("COMMAND_ACK", timeout_s=0.1, command=SET_MODE).result

    def take_off(self, height_m=10.0):
        assert self.command(ARM, 1) == ACCEPTED
        assert self.command(TAKEOFF, 0, 0, 0, NAN, NAN, NAN, AMSL_M + height_m) == ACCEPTED
        self.until(lambda: self.truth.mode == Px4Mode.HOLD)

    def reposition(self, lat, lon, amsl_m, *, flags=1, frame=mav.MAV_FRAME_GLOBAL_INT, yaw=NAN):
        p = (-1.0, flags, 0.0, yaw)
        self.send(mav.MAVLink_command_int_message(1, 1, frame, 192, 0, 0, *p, lat, lon, amsl_m))
        return self.expect("COMMAND_ACK", command=192).result

    def stream(self, message, seconds):
        for _ in range(round(seconds / 0.1)):
            self.send(message)
            self.run(0.1)

    def upload(self, items, kind=0, frame=6):
        self.send(mav.MAVLink_mission_count_message(1, 1, len(items), kind))
        while True:
            self.run(0.05)
            for m in self.received("MISSION_REQUEST_INT", "MISSION_ACK"):
                if m.get_type() == "MISSION_ACK":
                    return m.type
                command, x, y, z, *p = items[m.seq]
                p = (*p, *([0.0] * (4 - len(p))))
                self.send(
                    mav.MAVLink_mission_item_int_message(
                        1, 1, m.seq, frame, command, 0, 1, *p, x, y, z, kind
                    )
                )


def piloted(**setup):
    """Return a fleet on the ground."""
    fleet = Fleet(Setup(**{"gps_sigma_m": 0.0, **setup}))
    fleet.vehicles = tuple(Piloted(fleet, vehicle) for vehicle in fleet._simulated)
    return fleet


def px4(*, wind_m_s=0.0, station=False, **quirks):
    """Return a vehicle that has found its position; `station`: its client is a ground station."""
    (vehicle,) = piloted(autopilot="px4", wind_speed_m_s=wind_m_s, quirks=Quirks(**quirks))
    vehicle.run(6.0)
    if station:
        vehicle.ground_station()
    vehicle.receive()
    return vehicle


def fleet_in_the_air(autopilot, **setup):
    """Return a fleet ten metres up, in GUIDED or Hold."""
    setup = {"optical_flow": True, "quirks": Quirks(home_moves_m=0.0), **setup}
    fleet = piloted(autopilot=autopilot, **setup)
    fleet.run(6.0)
    orders = ((ARM, 1), (TAKEOFF, 0, 0, 0, NAN, NAN, NAN, AMSL_M + 10.0))
    if autopilot == "ardupilot":
        orders = ((SET_MODE, 1, 4), (ARM, 1), (TAKEOFF, 0, 0, 0, 0, 0, 0, 10.0))
    for vehicle in fleet:
        vehicle.ground_station()
        for command, *values in orders:
            assert vehicle.command(command, *values) == ACCEPTED
    fleet.until(lambda: all(vehicle.truth.height_m > 9.5 for vehicle in fleet))
    fleet.run(3.0)
    return fleet


def in_the_air(autopilot, **setup):
    return fleet_in_the_air(autopilot, **setup)[0]


def local(x, y, z, mask=0xDF8, frame=1, velocity=(0.0, 0.0, 0.0)):
    """Return a setpoint of the offboard stream."""
    return mav.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, frame, mask, x, y, z, *velocity, 0, 0, 0, 0, 0
    )


def frames_of(data, message_id):
    return [frame for frame in cut(data) if int.from_bytes(frame[7:10], "little") == message_id]
