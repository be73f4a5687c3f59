"""How PX4's parameters say that it flies."""

from __future__ import annotations

import math

from sitl.copter.control import Limits
from sitl.copter.params import Parameters
from sitl.copter.streaming import DelayedFollower, Follower
from sitl.copter.trajectory import Shaper, px4_speed

_NOSE_FORWARD = (0, 3, 4)  # MPC_YAW_MODE
_ANYWHERE_M = 0.0
# A stream of places and velocities at 10 Hz was followed 0.17 to 0.19 s late
_SETPOINT_DELAY_S = 0.18


class Px4Tuning:
    """MPC_*, RTL_*, NAV_*; see `sitl.copter.tuning.Tuning`.

    >>> from sitl.px4.params import TABLE
    >>> tuning = Px4Tuning(Parameters(TABLE))
    >>> tuning.return_height_m(away_m=100.0, height_m=12.0)
    30.0
    >>> round(tuning.return_height_m(away_m=15.0, height_m=12.0), 6)
    15.0
    """

    return_speed_m_s = 0.0
    rally_within_m = _ANYWHERE_M
    rally_or_home = True
    mission_restarts = False

    def __init__(self, parameters: Parameters) -> None:
        self._get = parameters

    @property
    def jerk_m_s3(self) -> float:
        """MPC_JERK_AUTO."""
        return self._get.positive("MPC_JERK_AUTO", 1.0, 80.0)

    @property
    def turns_nose(self) -> bool:
        """MPC_YAW_MODE."""
        return int(self._get["MPC_YAW_MODE"]) in _NOSE_FORWARD

    @property
    def return_hover_s(self) -> float:
        """RTL_LAND_DELAY."""
        return max(0.0, self._get["RTL_LAND_DELAY"])

    @property
    def return_final_m(self) -> float:
        """RTL_DESCEND_ALT, with a negative RTL_LAND_DELAY."""
        stays = self._get["RTL_LAND_DELAY"] < 0.0
        return self._get.positive("RTL_DESCEND_ALT", 2.0, 1000.0) if stays else 0.0

    @property
    def arrival_m(self) -> float:
        """NAV_ACC_RAD."""
        return self._get.positive("NAV_ACC_RAD", 0.05, 200.0)

    def shaper(self) -> Shaper:
        """PX4's own, by acceleration and jerk."""
        return Shaper(px4_speed)

    def follower(self) -> Follower:
        """Offboard flight."""
        return DelayedFollower(_SETPOINT_DELAY_S)

    def limits(self, max_speed_m_s: float, max_accel_m_s2: float) -> Limits:
        """MPC_*, held to what can be flown."""
        get = self._get.positive
        speed_m_s = min(get("MPC_XY_CRUISE", 0.1, 50.0), get("MPC_XY_VEL_MAX", 0.1, 50.0))
        climb_m_s = min(get("MPC_Z_V_AUTO_UP", 0.1, 10.0), get("MPC_Z_VEL_MAX_UP", 0.1, 10.0))
        descent_m_s = min(get("MPC_Z_V_AUTO_DN", 0.1, 5.0), get("MPC_Z_VEL_MAX_DN", 0.1, 5.0))
        return Limits(
            speed_m_s=min(max_speed_m_s, speed_m_s),
            climb_m_s=climb_m_s,
            descent_m_s=descent_m_s,
            accel_m_s2=min(max_accel_m_s2, get("MPC_ACC_HOR", 0.5, 5.0)),
            accel_z_m_s2=get("MPC_ACC_UP_MAX", 0.5, 2.0),
            p_xy=get("MPC_XY_P", 0.5, 2.0),
            p_z=get("MPC_Z_P", 0.5, 2.0),
            yaw_rate_rad_s=math.radians(get("MPC_YAWRAUTO_MAX", 5.0, 90.0)),
        )

    def return_height_m(self, away_m: float, height_m: float) -> float:
        """RTL_RETURN_ALT; inside the cone over home lower, down to RTL_DESCEND_ALT."""
        wanted = self._get["RTL_RETURN_ALT"]
        angle = math.radians(self._get.positive("RTL_CONE_ANG", 0.0, 90.0))
        if angle > 0.0:
            cone_m = max(self._get["RTL_DESCEND_ALT"], away_m / math.tan(angle))
            wanted = min(wanted, cone_m)
        return max(height_m, wanted)

    def landing_m_s(self, limits: Limits, height_m: float) -> float:
        """MPC_LAND_SPEED below MPC_LAND_ALT2, faster from there up to MPC_LAND_ALT1."""
        slow = self._get.positive("MPC_LAND_SPEED", 0.3, 2.0)
        low_m = self._get.positive("MPC_LAND_ALT2", 0.0, 100.0)
        high_m = max(low_m + 0.1, self._get["MPC_LAND_ALT1"])
        share = max(0.0, min(1.0, (height_m - low_m) / (high_m - low_m)))
        return slow + share * max(0.0, limits.descent_m_s - slow)
