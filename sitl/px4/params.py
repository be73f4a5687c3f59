"""The parameters of the simulated PX4, with the names, defaults and types of 1.15.

Only those that change what it does or that clients ask for; all are INT32 or REAL32. Integers
travel bytewise: their four bytes lie in the float field `param_value`.
"""

from __future__ import annotations

import math
import struct
from functools import partial

from sitl.copter.control import Limits, Tuning
from sitl.copter.fence import ALT_MAX, CIRCLE, POLYGON, Fence
from sitl.copter.params import INT32, REAL32, Parameter, Parameters

_ROWS = (
    Parameter("BAT1_CAPACITY", -1.0, REAL32),  # mAh, set to the pack's at the start
    Parameter("BAT1_N_CELLS", 6, INT32, fixed=True),
    Parameter("BAT1_V_EMPTY", 3.3, REAL32),  # V a cell: below it the pack counts as empty
    Parameter("BAT_CRIT_THR", 0.07, REAL32),  # share of the charge
    Parameter("BAT_EMERGEN_THR", 0.05, REAL32),
    Parameter("BAT_LOW_THR", 0.15, REAL32),
    Parameter("CAL_ACC0_ID", 1310988, INT32, fixed=True),  # not 0: calibrated
    Parameter("CAL_GYRO0_ID", 1310988, INT32, fixed=True),
    Parameter("CAL_MAG0_ID", 197388, INT32, fixed=True),
    Parameter("COM_DISARM_LAND", 2.0, REAL32),  # s, 0: never
    Parameter("COM_DISARM_PRFLT", 10.0, REAL32),  # s, 0: never
    Parameter("COM_DL_LOSS_T", 10, INT32),  # s
    Parameter("COM_FAIL_ACT_T", 5.0, REAL32),  # s of Hold before a failsafe acts
    Parameter("COM_LOW_BAT_ACT", 0, INT32),  # 0 warn, 2 land, 3 return when critical
    Parameter("COM_OBL_RC_ACT", 0, INT32),  # 0-2 by hand, 3 return, 4 land, 5 hold, 6, 7 motors off
    Parameter("COM_OF_LOSS_T", 1.0, REAL32),  # s
    Parameter("COM_POS_FS_EPH", 5.0, REAL32),  # m, below 0: never
    Parameter("COM_RCL_EXCEPT", 0, INT32),  # 1 mission, 2 hold, 4 offboard
    Parameter("COM_TAKEOFF_ACT", 0, INT32),  # 0 hold, 1 mission
    Parameter("EKF2_EVP_NOISE", 0.1, REAL32),  # m
    Parameter("EKF2_EV_CTRL", 0, INT32),  # 1: positions of a companion are fused
    Parameter("EKF2_GPS_CTRL", 7, INT32),  # 1: positions by satellites are fused
    Parameter("EKF2_NOAID_TOUT", 5000000, INT32),  # us
    Parameter("EKF2_OF_CTRL", 0, INT32),  # 1: optical flow is fused; no effect
    Parameter("GF_ACTION", 2, INT32),  # 0, 1 warn, 2 hold, 3 return, 4 motors off, 5 land
    Parameter("GF_MAX_HOR_DIST", 0.0, REAL32),  # m, 0: none
    Parameter("GF_MAX_VER_DIST", 0.0, REAL32),  # m, 0: none
    Parameter("MAV_SYS_ID", 1, INT32, fixed=True),
    Parameter("MAV_TYPE", 2, INT32, fixed=True),
    Parameter("MIS_TAKEOFF_ALT", 2.5, REAL32),  # m
    Parameter("MPC_ACC_HOR", 3.0, REAL32),  # m/s^2
    Parameter("MPC_ACC_UP_MAX", 4.0, REAL32),  # m/s^2
    Parameter("MPC_JERK_AUTO", 4.0, REAL32),  # m/s^3
    Parameter("MPC_LAND_ALT1", 10.0, REAL32),  # m: from here slower
    Parameter("MPC_LAND_ALT2", 5.0, REAL32),  # m: from here at MPC_LAND_SPEED
    Parameter("MPC_LAND_SPEED", 0.7, REAL32),
    Parameter("MPC_TKO_SPEED", 1.5, REAL32),
    Parameter("MPC_XY_CRUISE", 5.0, REAL32),
    Parameter("MPC_XY_P", 0.95, REAL32),
    Parameter("MPC_XY_VEL_MAX", 12.0, REAL32),
    Parameter("MPC_YAWRAUTO_MAX", 45.0, REAL32),  # degrees/s
    Parameter("MPC_YAW_MODE", 0, INT32),  # 0, 3, 4: the nose towards the waypoint
    Parameter("MPC_Z_P", 1.0, REAL32),
    Parameter("MPC_Z_VEL_MAX_DN", 1.5, REAL32),
    Parameter("MPC_Z_VEL_MAX_UP", 3.0, REAL32),
    Parameter("MPC_Z_V_AUTO_DN", 1.5, REAL32),
    Parameter("MPC_Z_V_AUTO_UP", 3.0, REAL32),
    Parameter("NAV_ACC_RAD", 2.0, REAL32),  # m
    Parameter("NAV_DLL_ACT", 0, INT32),  # 0 none, 1 hold, 2 return, 3 land, 5, 6 motors off
    Parameter("NAV_RCL_ACT", 2, INT32),  # the same
    Parameter("RTL_CONE_ANG", 45, INT32),  # degrees from the vertical, 0: no cone
    Parameter("RTL_DESCEND_ALT", 10.0, REAL32),  # m
    Parameter("RTL_LAND_DELAY", 0.0, REAL32),  # s, -1: stay above home
    Parameter("RTL_RETURN_ALT", 30.0, REAL32),  # m
    Parameter("RTL_TYPE", 0, INT32),
    Parameter("SYS_AUTOSTART", 10016, INT32, fixed=True),
    Parameter("SYS_FAILURE_EN", 0, INT32),  # 1: MAV_CMD_INJECT_FAILURE is obeyed
)

TABLE = tuple(sorted(_ROWS, key=lambda parameter: parameter.name))

_INT, _FLOAT = struct.Struct("<i"), struct.Struct("<f")


def bytewise(value: int) -> float:
    """Return the float whose four bytes are those of an integer.

    >>> bytewise(1), from_bytewise(bytewise(-1))
    (1.401298464324817e-45, -1)
    """
    found: float = _FLOAT.unpack(_INT.pack(value))[0]
    return found


def from_bytewise(value: float) -> int:
    """Return the integer of a float's bytes, also of a NaN."""
    found: int = _INT.unpack(_FLOAT.pack(value))[0]
    return found


_NOSE_FORWARD = (0, 3, 4)  # MPC_YAW_MODE


def px4_tuning(parameters: Parameters) -> Tuning:
    """Return PX4's tuning by MPC_*, RTL_*, NAV_*.

    >>> tuning = px4_tuning(Parameters(TABLE))
    >>> tuning.return_height_m(100.0, 12.0), round(tuning.return_height_m(15.0, 12.0), 6)
    (30.0, 15.0)
    """
    get = parameters.positive
    stays = parameters["RTL_LAND_DELAY"] < 0.0
    return Tuning(
        limits=Limits(
            speed_m_s=min(get("MPC_XY_CRUISE", 0.1, 50.0), get("MPC_XY_VEL_MAX", 0.1, 50.0)),
            climb_m_s=min(get("MPC_Z_V_AUTO_UP", 0.1, 10.0), get("MPC_Z_VEL_MAX_UP", 0.1, 10.0)),
            descent_m_s=min(get("MPC_Z_V_AUTO_DN", 0.1, 5.0), get("MPC_Z_VEL_MAX_DN", 0.1, 5.0)),
            accel_m_s2=get("MPC_ACC_HOR", 0.5, 5.0),
            accel_z_m_s2=get("MPC_ACC_UP_MAX", 0.5, 2.0),
            p_xy=get("MPC_XY_P", 0.5, 2.0),
            p_z=get("MPC_Z_P", 0.5, 2.0),
            yaw_rate_rad_s=math.radians(get("MPC_YAWRAUTO_MAX", 5.0, 90.0)),
        ),
        jerk_m_s3=get("MPC_JERK_AUTO", 1.0, 80.0),
        turns_nose=int(parameters["MPC_YAW_MODE"]) in _NOSE_FORWARD,
        arrival_m=get("NAV_ACC_RAD", 0.05, 200.0),
        return_height_m=partial(_return_height, parameters),
        landing_m_s=partial(_landing_speed, parameters),
        return_hover_s=max(0.0, parameters["RTL_LAND_DELAY"]),
        return_final_m=get("RTL_DESCEND_ALT", 2.0, 1000.0) if stays else 0.0,
    )


def _return_height(parameters: Parameters, away_m: float, height_m: float) -> float:
    """Return RTL_RETURN_ALT; inside the cone over home less, down to RTL_DESCEND_ALT."""
    wanted = parameters["RTL_RETURN_ALT"]
    angle = math.radians(parameters.positive("RTL_CONE_ANG", 0.0, 90.0))
    if angle > 0.0:
        wanted = min(wanted, max(parameters["RTL_DESCEND_ALT"], away_m / math.tan(angle)))
    return max(height_m, wanted)


def _landing_speed(parameters: Parameters, limits: Limits, height_m: float) -> float:
    """Return MPC_LAND_SPEED below MPC_LAND_ALT2, more from there up to MPC_LAND_ALT1."""
    slow = parameters.positive("MPC_LAND_SPEED", 0.3, 2.0)
    low_m = parameters.positive("MPC_LAND_ALT2", 0.0, 100.0)
    high_m = max(low_m + 0.1, parameters["MPC_LAND_ALT1"])
    share = max(0.0, min(1.0, (height_m - low_m) / (high_m - low_m)))
    return slow + share * max(0.0, limits.descent_m_s - slow)


class Px4Fence(Fence):
    """Uploaded polygons and circles, GF_MAX_HOR_DIST and GF_MAX_VER_DIST."""

    def enabled(self, parameters: Parameters) -> bool:
        """Return whether there is a limit, and GF_ACTION enables it."""
        there = self.zones or parameters["GF_MAX_HOR_DIST"] or parameters["GF_MAX_VER_DIST"]
        return bool(there) and parameters["GF_ACTION"] != 0.0

    def _limits(self, parameters: Parameters) -> tuple[int, float, float, float]:
        farthest = (parameters[name] for name in ("GF_MAX_VER_DIST", "GF_MAX_HOR_DIST"))
        high_m, far_m = (limit_m if limit_m > 0.0 else math.inf for limit_m in farthest)
        return ALT_MAX | CIRCLE | POLYGON, -math.inf, high_m, far_m
