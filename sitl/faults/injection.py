"""Faults injected over MAVLink: MAV_CMD_INJECT_FAILURE (420) and SIM_* parameters.

420 takes a unit, a failure type and an instance, and needs SYS_FAILURE_EN 1, as on PX4. The
parameters are those with which ArduPilot's own tests break its simulator.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.faults.faults import Faults, Kind

_OK, _OFF = mav.FAILURE_TYPE_OK, mav.FAILURE_TYPE_OFF
_WRONG, _INTERMITTENT = mav.FAILURE_TYPE_WRONG, mav.FAILURE_TYPE_INTERMITTENT
_SLOW, _GARBAGE, _STUCK = mav.FAILURE_TYPE_SLOW, mav.FAILURE_TYPE_GARBAGE, mav.FAILURE_TYPE_STUCK

# There is no unit for a camera in the standard: a number above those it has
CAMERA_UNIT = 150

_WRONG_PLACE_M, _DRIFT_M_S = 50.0, 2.0
_WRONG_HEADING_RAD = math.pi / 2.0
_DEAD_PACK_SAG_V, _WEAK_PACK_SAG_V = 12.0, 4.0
_WEAK_MOTOR = 0.6
_FAILURES: Mapping[tuple[int, int], tuple[Kind, tuple[float, ...]]] = {
    (mav.FAILURE_UNIT_SENSOR_GPS, _OFF): ("gps", ()),
    (mav.FAILURE_UNIT_SENSOR_GPS, _WRONG): ("gps_glitch", (_WRONG_PLACE_M, 0.0)),
    (mav.FAILURE_UNIT_SENSOR_GPS, _SLOW): ("gps_drift", (_DRIFT_M_S, 0.0)),
    (mav.FAILURE_UNIT_SENSOR_MAG, _WRONG): ("compass", (_WRONG_HEADING_RAD,)),
    (mav.FAILURE_UNIT_SYSTEM_BATTERY, _OFF): ("battery_sag", (_DEAD_PACK_SAG_V,)),
    (mav.FAILURE_UNIT_SYSTEM_BATTERY, _WRONG): ("battery_sag", (_WEAK_PACK_SAG_V,)),
    (mav.FAILURE_UNIT_SYSTEM_MOTOR, _OFF): ("motor", (0.0,)),
    (mav.FAILURE_UNIT_SYSTEM_MOTOR, _SLOW): ("motor", (_WEAK_MOTOR,)),
    (mav.FAILURE_UNIT_SYSTEM_RC_SIGNAL, _OFF): ("rc", ()),
    (CAMERA_UNIT, _OFF): ("camera_stall", ()),
    (CAMERA_UNIT, _STUCK): ("camera_stall", ()),
    (CAMERA_UNIT, _WRONG): ("camera_black", ()),
    (CAMERA_UNIT, _GARBAGE): ("camera_corrupt", ()),
}
_UNITS = {unit for unit, _ in _FAILURES}


def inject(faults: Faults, unit: int | None, failure: int | None, enabled: bool) -> int:
    """Execute MAV_CMD_INJECT_FAILURE; return its MAV_RESULT. Type OK ends the unit's fault."""
    if not enabled:
        return int(mav.MAV_RESULT_DENIED)
    source = f"420 {unit}"
    if unit in _UNITS and failure == _OK:
        faults.hold(source, "gps", on=False)
        return int(mav.MAV_RESULT_ACCEPTED)
    found = None if unit is None or failure is None else _FAILURES.get((unit, failure))
    if found is None:
        return int(mav.MAV_RESULT_UNSUPPORTED)
    faults.hold(source, *found)
    return int(mav.MAV_RESULT_ACCEPTED)


def _glitch(axis: int) -> Callable[[Faults, float], None]:
    def hold(faults: Faults, degrees: float) -> None:
        """SIM_GPS_GLITCH_X and _Y are degrees of latitude and longitude."""
        east_north = list(faults.held("SIM_GPS_GLITCH") or (0.0, 0.0))
        # the length of a degree is the same on both axes here: a fault has no need of better
        east_north[axis] = max(-1.0, min(1.0, degrees)) * 111_320.0
        faults.hold("SIM_GPS_GLITCH", "gps_glitch", (east_north[0], east_north[1]), any(east_north))

    return hold


def _wind(faults: Faults, speed_m_s: float | None, from_deg: float | None) -> None:
    old = faults.held("SIM_WIND") or (0.0, 0.0, 0.0, 180.0)
    speed = old[2] if speed_m_s is None else max(0.0, min(60.0, speed_m_s))
    bearing = old[3] if from_deg is None else from_deg
    towards = math.radians(bearing + 180.0)
    numbers = (speed * math.sin(towards), speed * math.cos(towards), speed, bearing)
    faults.hold("SIM_WIND", "wind_gust", numbers)


def _engine(faults: Faults, share: float | None, failed: bool | None) -> None:
    """Set SIM_ENGINE_MUL, the share of thrust of the motors in SIM_ENGINE_FAIL."""
    old = faults.held("SIM_ENGINE") or (1.0, 0.0, 0.0)
    mul = old[1] if share is None else max(0.0, min(1.0, share))
    on = bool(old[2]) if failed is None else failed
    faults.hold("SIM_ENGINE", "motor", (mul if on else 1.0, mul, float(on)))


SIM_PARAMETERS: Mapping[str, Callable[[Faults, float], None]] = {
    "SIM_BATT_VOLTAGE": lambda f, v: f.hold(
        "SIM_BATT_VOLTAGE", "battery_voltage", (min(v, 100.0),), on=v > 0.0
    ),
    "SIM_ENGINE_FAIL": lambda f, v: _engine(f, None, v != 0.0),
    "SIM_ENGINE_MUL": lambda f, v: _engine(f, v, None),
    "SIM_GPS_DISABLE": lambda f, v: f.hold("SIM_GPS_DISABLE", "gps", on=v != 0.0),
    "SIM_GPS1_ENABLE": lambda f, v: f.hold("SIM_GPS1_ENABLE", "gps", on=v == 0.0),
    "SIM_GPS_GLITCH_X": _glitch(1),
    "SIM_GPS_GLITCH_Y": _glitch(0),
    "SIM_RC_FAIL": lambda f, v: f.hold("SIM_RC_FAIL", "rc", on=v != 0.0),
    "SIM_WIND_DIR": lambda f, v: _wind(f, None, v % 360.0),
    "SIM_WIND_SPD": lambda f, v: _wind(f, v, None),
}
"""Executes a change of a parameter."""
