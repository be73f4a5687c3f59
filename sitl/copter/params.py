"""The parameters of the simulated ArduCopter, with the names, defaults and types of 4.6.

Only those that change what it does or that clients ask for.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial

from sitl.copter.control import Limits, Tuning, sqrt_controller


@dataclass(frozen=True, slots=True)
class Parameter:
    """Name, default and MAV_PARAM_TYPE (2 INT8, 4 INT16, 6 INT32, 9 REAL32).

    A `fixed` one cannot be changed: the autopilot answers with its value.
    """

    name: str
    default: float
    type: int
    fixed: bool = False


INT8, INT16, INT32, REAL32 = 2, 4, 6, 9

_ROWS = (
    Parameter("ARMING_CHECK", 1, INT32),  # 0: arm without a position
    Parameter("ATC_SLEW_YAW", 6000.0, REAL32),  # centidegrees/s
    Parameter("AUTO_OPTIONS", 0, INT32),  # 1: arm in AUTO, 2: take off without MISSION_START
    Parameter("BATT_ARM_VOLT", 0.0, REAL32),  # V, 0: none
    Parameter("BATT_CAPACITY", 3300, INT32),  # mAh, set to the pack's at the start
    Parameter("BATT_CRT_MAH", 0.0, REAL32),  # mAh left, 0: none
    Parameter("BATT_CRT_VOLT", 0.0, REAL32),  # V, 0: none
    Parameter("BATT_FS_CRT_ACT", 0, INT8),
    Parameter("BATT_FS_LOW_ACT", 0, INT8),
    Parameter("BATT_LOW_MAH", 0.0, REAL32),  # mAh left, 0: none
    Parameter("BATT_LOW_TIMER", 10, INT8),  # s below the voltage
    Parameter("BATT_LOW_VOLT", 10.5, REAL32),  # V
    Parameter("BATT_MONITOR", 4, INT8, fixed=True),
    Parameter("CAM1_TYPE", 0, INT8, fixed=True),  # 1: a camera that the autopilot triggers
    Parameter("COMPASS_ENABLE", 1, INT8, fixed=True),
    Parameter("DISARM_DELAY", 10, INT8),  # s
    Parameter("EK3_POSNE_M_NSE", 0.5, REAL32),  # m
    Parameter("EK3_SRC1_POSXY", 3, INT8),  # 0 none, 3 satellites, 6 a companion
    Parameter("EK3_SRC2_POSXY", 0, INT8),
    Parameter("EK3_SRC3_POSXY", 0, INT8),
    Parameter("EK3_SRC_OPTIONS", 0, INT16),  # 1: all velocities are fused; no effect here
    Parameter("FENCE_ACTION", 1, INT8),
    Parameter("FENCE_ALT_MAX", 100.0, REAL32),  # m
    Parameter("FENCE_ALT_MIN", -10.0, REAL32),  # m
    Parameter("FENCE_ENABLE", 0, INT8),
    Parameter("FENCE_RADIUS", 150.0, REAL32),  # m
    Parameter("FENCE_TOTAL", 0, INT8, fixed=True),
    Parameter("FENCE_TYPE", 7, INT8),  # 1 top, 2 circle, 4 polygons, 8 bottom
    Parameter("FLOW_TYPE", 0, INT8),  # not 0: an optical flow sensor; no effect
    Parameter("FORMAT_VERSION", 120, INT16, fixed=True),
    Parameter("FRAME_CLASS", 1, INT8, fixed=True),
    Parameter("FRAME_TYPE", 0, INT8, fixed=True),
    Parameter("FS_EKF_ACTION", 1, INT8),
    Parameter("FS_GCS_ENABLE", 0, INT8),
    Parameter("FS_GCS_TIMEOUT", 5.0, REAL32),  # s
    Parameter("FS_OPTIONS", 16, INT32),
    Parameter("FS_THR_ENABLE", 1, INT8),
    Parameter("GPS1_TYPE", 1, INT8, fixed=True),
    Parameter("GPS2_TYPE", 0, INT8),  # 14: by GPS_INPUT
    Parameter("GPS_AUTO_SWITCH", 1, INT8),  # 1, 4: the second where the first has no fix
    Parameter("GUID_TIMEOUT", 3.0, REAL32),  # s
    Parameter("LAND_ALT_LOW", 1000, INT16),  # cm
    Parameter("LAND_SPEED", 50, INT16),  # cm/s
    Parameter("LAND_SPEED_HIGH", 0, INT16),  # cm/s, 0: WPNAV_SPEED_DN
    Parameter("MIS_RESTART", 0, INT8),  # 1: from the beginning each time
    Parameter("MIS_TOTAL", 0, INT16, fixed=True),
    Parameter("PSC_JERK_XY", 5.0, REAL32),  # m/s^3; 0: as directly as it can
    Parameter("PSC_POSXY_P", 1.0, REAL32),  # 1/s
    Parameter("PSC_POSZ_P", 1.0, REAL32),  # 1/s
    Parameter("RALLY_INCL_HOME", 1, INT8),
    Parameter("RALLY_LIMIT_KM", 0.3, REAL32),
    Parameter("RALLY_TOTAL", 0, INT8, fixed=True),
    Parameter("RTL_ALT", 1500, INT32),  # cm
    Parameter("RTL_ALT_FINAL", 0, INT16),  # cm, 0: land
    Parameter("RTL_CLIMB_MIN", 0, INT16),  # cm
    Parameter("RTL_CONE_SLOPE", 3.0, REAL32),  # metres up a metre away
    Parameter("RTL_LOIT_TIME", 5000, INT32),  # ms
    Parameter("RTL_SPEED", 0, INT16),  # cm/s, 0: WPNAV_SPEED
    Parameter("SYSID_MYGCS", 255, INT16),
    Parameter("SYSID_THISMAV", 1, INT16, fixed=True),
    # SIM_*: what sitl.faults.injection does with them
    Parameter("SIM_BATT_VOLTAGE", 0.0, REAL32),  # V, 0: by the charge
    Parameter("SIM_ENGINE_FAIL", 0, INT32),  # not 0: a motor gives SIM_ENGINE_MUL
    Parameter("SIM_ENGINE_MUL", 1.0, REAL32),
    Parameter("SIM_GPS1_ENABLE", 1, INT8),
    Parameter("SIM_GPS_DISABLE", 0, INT8),
    Parameter("SIM_GPS_GLITCH_X", 0.0, REAL32),  # degrees of latitude
    Parameter("SIM_GPS_GLITCH_Y", 0.0, REAL32),  # degrees of longitude
    Parameter("SIM_RC_FAIL", 0, INT8),
    Parameter("SIM_SPEEDUP", 1.0, REAL32, fixed=True),
    Parameter("SIM_WIND_DIR", 180.0, REAL32),  # degrees, the direction that it comes from
    Parameter("SIM_WIND_SPD", 0.0, REAL32),  # m/s besides the world's
    Parameter("SYS_FAILURE_EN", 0, INT8),  # 1: MAV_CMD_INJECT_FAILURE is obeyed
    Parameter("VISO_POS_M_NSE", 0.2, REAL32),  # m
    Parameter("VISO_TYPE", 0, INT8),  # not 0: positions of a companion are used
    Parameter("WPNAV_ACCEL", 250.0, REAL32),  # cm/s^2
    Parameter("WPNAV_ACCEL_Z", 100.0, REAL32),  # cm/s^2
    Parameter("WPNAV_RADIUS", 200.0, REAL32),  # cm
    Parameter("WPNAV_SPEED", 1000.0, REAL32),  # cm/s
    Parameter("WPNAV_SPEED_DN", 150.0, REAL32),  # cm/s
    Parameter("WPNAV_SPEED_UP", 250.0, REAL32),  # cm/s
    Parameter("WP_YAW_BEHAVIOR", 2, INT8),  # 0: keep the heading
)

TABLE = tuple(sorted(_ROWS, key=lambda parameter: parameter.name))

_INTEGER_RANGE = {INT8: 2**7 - 1, INT16: 2**15 - 1, INT32: 2**31 - 1}
_LARGEST = 3.4028234e38  # of a REAL32


class Parameters:
    """Values by name and by index, in the order of `table`."""

    def __init__(self, table: tuple[Parameter, ...] = TABLE) -> None:
        self.table = table
        self.by_name = {p.name: p for p in table}
        self.index = {p.name: i for i, p in enumerate(table)}
        self._values = {p.name: float(p.default) for p in table}
        # raised at every change, so that what is derived from parameters can be cached
        self.version = 0
        # called with what a client has set: simulated faults
        self.watch: Callable[[str, float], None] | None = None
        # names of what the autopilot has changed by itself and has not sent yet
        self.unsent: list[str] = []

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def set(self, name: str, value: float) -> bool:
        """Set as ArduPilot does: no range check, fractions of integers cut.

        Returns False, and changes nothing, for an unknown name or a value that is not finite.
        """
        parameter = self.by_name.get(name)
        if parameter is None or not math.isfinite(value):
            return False
        if not parameter.fixed:
            self._keep(parameter, value)
            if self.watch is not None:
                self.watch(name, self._values[name])
        return True

    def set_up(self, values: Iterable[tuple[str, float]]) -> None:
        """Set what the owner of the vehicle has set; raises `ValueError` for what cannot be set."""
        for name, value in values:
            if name not in self or self.by_name[name].fixed:
                names = [parameter.name for parameter in self.table if not parameter.fixed]
                near = ", ".join(difflib.get_close_matches(name, names, cutoff=0.8))
                raise ValueError(
                    f"parameters: the autopilot has no {name!r} that can be set"
                    + (f"; near: {near}" if near else "")
                )
            self.set(name, value)

    def preset(self, name: str, value: float) -> None:
        """Set a value at the start, without a message to clients."""
        self._keep(self.by_name[name], value)

    def change(self, name: str, value: float) -> None:
        """Change a value that no client has set; it is sent with the index 65535."""
        before = self._values[name]
        self._keep(self.by_name[name], value)
        if self._values[name] != before and name not in self.unsent:
            self.unsent.append(name)

    def _keep(self, parameter: Parameter, value: float) -> None:
        limit = _INTEGER_RANGE.get(parameter.type)
        if limit is not None:
            value = float(max(-limit - 1, min(limit, math.trunc(value))))
        else:
            value = max(-_LARGEST, min(_LARGEST, value))
        self._values[parameter.name] = value
        self.version += 1

    def positive(self, name: str, low: float, high: float) -> float:
        """Return a value limited to a range in which flying is possible."""
        return max(low, min(high, self._values[name]))


_LOWEST_RETURN_M = 2.0


def copter_tuning(parameters: Parameters) -> Tuning:
    """Return ArduCopter's tuning.

    >>> tuning = copter_tuning(Parameters())
    >>> tuning.return_height_m(100.0, 12.0), tuning.return_height_m(4.5, 12.0)
    (15.0, 13.5)
    >>> tuning.landing_m_s(tuning.limits, 3.0)
    0.5
    """
    get = parameters.positive
    return Tuning(
        limits=Limits(
            speed_m_s=get("WPNAV_SPEED", 10, 5000) / 100,
            climb_m_s=get("WPNAV_SPEED_UP", 10, 1000) / 100,
            descent_m_s=get("WPNAV_SPEED_DN", 10, 500) / 100,
            accel_m_s2=get("WPNAV_ACCEL", 50, 500) / 100,
            accel_z_m_s2=get("WPNAV_ACCEL_Z", 50, 200) / 100,
            p_xy=get("PSC_POSXY_P", 0.5, 2.0),
            p_z=get("PSC_POSZ_P", 0.5, 2.0),
            yaw_rate_rad_s=math.radians(get("ATC_SLEW_YAW", 500, 9000) / 100),
        ),
        jerk_m_s3=parameters["PSC_JERK_XY"],
        turns_nose=parameters["WP_YAW_BEHAVIOR"] != 0,
        arrival_m=get("WPNAV_RADIUS", 5, 1000) / 100.0,
        return_height_m=partial(_return_height, parameters),
        landing_m_s=partial(_landing_speed, parameters),
        return_speed_m_s=parameters["RTL_SPEED"] / 100.0,
        return_hover_s=parameters["RTL_LOIT_TIME"] / 1000.0,
        return_final_m=parameters["RTL_ALT_FINAL"] / 100.0,
        rally_within_m=1000.0 * parameters["RALLY_LIMIT_KM"],
        rally_or_home=bool(parameters["RALLY_INCL_HOME"]),
        mission_restarts=parameters["MIS_RESTART"] != 0.0,
    )


def _return_height(parameters: Parameters, away_m: float, height_m: float) -> float:
    """Return RTL_ALT, less inside a cone over home, at least RTL_CLIMB_MIN above the height."""
    wanted = parameters["RTL_ALT"] / 100.0
    slope = parameters["RTL_CONE_SLOPE"]
    if slope > 0.0:
        wanted = min(wanted, max(_LOWEST_RETURN_M, away_m * slope))
    return max(height_m + max(0.0, parameters["RTL_CLIMB_MIN"] / 100.0), wanted)


def _landing_speed(parameters: Parameters, limits: Limits, height_m: float) -> float:
    """Return the descent rate: slow below LAND_ALT_LOW, braking towards it above."""
    slow = parameters.positive("LAND_SPEED", 30, 200) / 100.0
    above_m = height_m - parameters["LAND_ALT_LOW"] / 100.0
    if above_m <= 0.0:
        return slow
    speed = sqrt_controller(above_m, limits.p_z, limits.accel_z_m_s2)
    fast = parameters["LAND_SPEED_HIGH"] / 100.0
    return max(slow, min(fast if fast > 0.0 else limits.descent_m_s, speed))
