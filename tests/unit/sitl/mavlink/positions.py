"""For the tests of the position estimate: vehicles in the air, and what they say of it."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import LatLon
from sitl.quirks import Quirks
from sitl.scenario import Setup
from sitl.testing import Fleet

NAN = math.nan
AUTOPILOTS = ("ardupilot", "px4")
REPORT = {"ardupilot": "EKF_STATUS_REPORT", "px4": "ESTIMATOR_STATUS"}
VELOCITY, RELATIVE, ABSOLUTE, CONSTANT = 0x06, 0x08, 0x10, 0x80
HOME_AMSL_M = 488.0


def fleet_in_the_air(autopilot, vehicles=1, **setup):
    setup = {
        "optical_flow": True, "gps_sigma_m": 0.0, "quirks": Quirks(home_moves_m=0.0), **setup,
    }  # fmt: skip
    fleet = Fleet(Setup(autopilot=autopilot, vehicles=vehicles, **setup))
    fleet.run(6.0)
    orders = ((400, 1), (22, 0, 0, 0, NAN, NAN, NAN, HOME_AMSL_M + 10.0))
    if autopilot == "ardupilot":
        orders = ((176, 1, 4), (400, 1), (22, 0, 0, 0, 0, 0, 0, 10.0))
    for vehicle in fleet:
        vehicle.ground_station()
        for command, *values in orders:
            assert vehicle.command(command, *values) == mav.MAV_RESULT_ACCEPTED
    fleet.until(lambda: all(vehicle.truth.height_m > 9.5 for vehicle in fleet))
    fleet.run(3.0)
    return fleet


def in_the_air(autopilot, **setup):
    return fleet_in_the_air(autopilot, **setup)[0]


def place(vehicle, east_m, north_m):
    at = vehicle._vehicle.world.plane.to_wgs84(east_m, north_m)
    return round(at.lat_deg * 1e7), round(at.lon_deg * 1e7)


def where(vehicle):
    """East and north of it, in truth."""
    return vehicle._vehicle.world.plane.to_plane(vehicle.truth.position)


def told(vehicle):
    """East and north of it, by GLOBAL_POSITION_INT."""
    m = ask(vehicle, "GLOBAL_POSITION_INT")
    return vehicle._vehicle.world.plane.to_plane(LatLon(m.lat / 1e7, m.lon / 1e7))


def fly_to(vehicle, east_m, north_m):
    vehicle.send(
        mav.MAVLink_command_int_message(
            vehicle.system_id, 1, 5, mav.MAV_CMD_DO_REPOSITION, 0, 0, -1, 1, 0, NAN,
            *place(vehicle, east_m, north_m), HOME_AMSL_M + 10.0,
        )
    )  # fmt: skip


def ask(vehicle, kind):
    vehicle.receive()
    message_id = getattr(mav, f"MAVLINK_MSG_ID_{kind}")
    vehicle.send(
        mav.MAVLink_command_long_message(
            vehicle.system_id, 1, mav.MAV_CMD_REQUEST_MESSAGE, 0, message_id, 0, 0, 0, 0, 0, 0
        )
    )
    return next(m for m in vehicle.receive() if m.get_type() == kind)


def flags(vehicle):
    return ask(vehicle, REPORT[vehicle.fleet.setup.autopilot]).flags


def off_m(vehicle):
    return math.hypot(*vehicle.truth.estimate_error_m)


def put(vehicle, **values):
    for name, value in values.items():
        parameter = vehicle._vehicle._ap.parameters.by_name[name]
        vehicle.send(
            mav.MAVLink_param_set_message(
                vehicle.system_id, 1, name.encode(), _on_wire(vehicle, parameter, value),
                parameter.type,
            )
        )  # fmt: skip
        assert vehicle._vehicle._ap.parameters[name] == value


def _on_wire(vehicle, parameter, value):
    return vehicle._vehicle._interpreter._on_wire(parameter, value)


def texts(vehicle):
    return [m.text for m in vehicle.receive() if m.get_type() == "STATUSTEXT"]
