"""How the parameters of an autopilot say that it flies, whatever their names and units are."""

from __future__ import annotations

from typing import Protocol

from sitl.copter.control import Limits
from sitl.copter.modes import landing_speed, return_height
from sitl.copter.params import Parameters
from sitl.copter.streaming import Follower, ShapedFollower
from sitl.copter.trajectory import MOST_JERK_M_S3, Shaper, shaping_jerk


class Tuning(Protocol):
    """Lengths in metres, heights above home, times in seconds, speeds in m/s."""

    @property
    def jerk_m_s3(self) -> float:
        """Of a shaped path; 0: as directly as it can."""

    @property
    def turns_nose(self) -> bool:
        """Whether a far target turns the nose."""

    @property
    def return_speed_m_s(self) -> float:
        """Of the way home; 0: as any other."""

    @property
    def return_hover_s(self) -> float:
        """Above home before it comes down."""

    @property
    def return_final_m(self) -> float:
        """Height at which a return ends; 0: on the ground."""

    @property
    def rally_within_m(self) -> float:
        """How far away a rally point may be; 0: anywhere."""

    @property
    def rally_or_home(self) -> bool:
        """Whether home is a place to return to although there are rally points."""

    @property
    def arrival_m(self) -> float:
        """Distance at which a waypoint counts as reached."""

    @property
    def mission_restarts(self) -> bool:
        """Whether a mission that was left begins anew."""

    def shaper(self) -> Shaper:
        """What shapes the path to a target."""

    def follower(self) -> Follower:
        """What follows a stream of setpoints."""

    def limits(self, max_speed_m_s: float, max_accel_m_s2: float) -> Limits:
        """Speeds and accelerations, held to the airframe's own."""

    def return_height_m(self, away_m: float, height_m: float) -> float:
        """Height of the way home from `away_m`, now at `height_m`."""

    def landing_m_s(self, limits: Limits, height_m: float) -> float:
        """Descent of a landing at `height_m`."""


class CopterTuning:
    """ArduCopter's."""

    def __init__(self, parameters: Parameters) -> None:
        self._get = parameters

    @property
    def jerk_m_s3(self) -> float:
        """PSC_JERK_XY."""
        return self._get["PSC_JERK_XY"]

    @property
    def turns_nose(self) -> bool:
        """WP_YAW_BEHAVIOR."""
        return self._get["WP_YAW_BEHAVIOR"] != 0

    @property
    def return_speed_m_s(self) -> float:
        """RTL_SPEED."""
        return self._get["RTL_SPEED"] / 100.0

    @property
    def return_hover_s(self) -> float:
        """RTL_LOIT_TIME."""
        return self._get["RTL_LOIT_TIME"] / 1000.0

    @property
    def return_final_m(self) -> float:
        """RTL_ALT_FINAL."""
        return self._get["RTL_ALT_FINAL"] / 100.0

    @property
    def rally_within_m(self) -> float:
        """RALLY_LIMIT_KM."""
        return 1000.0 * self._get["RALLY_LIMIT_KM"]

    @property
    def rally_or_home(self) -> bool:
        """RALLY_INCL_HOME."""
        return bool(self._get["RALLY_INCL_HOME"])

    @property
    def arrival_m(self) -> float:
        """WPNAV_RADIUS."""
        return self._get.positive("WPNAV_RADIUS", 5, 1000) / 100.0

    @property
    def mission_restarts(self) -> bool:
        """MIS_RESTART."""
        return self._get["MIS_RESTART"] != 0.0

    def shaper(self) -> Shaper:
        """By a square root of the distance."""
        return Shaper()

    def follower(self) -> Follower:
        """PSC_JERK_XY; 0 leaves it to what the vehicle can do."""
        return ShapedFollower(lambda: shaping_jerk(self._get["PSC_JERK_XY"] or MOST_JERK_M_S3))

    def limits(self, max_speed_m_s: float, max_accel_m_s2: float) -> Limits:
        """WPNAV_* and PSC_*."""
        return Limits.of(self._get, max_speed_m_s, max_accel_m_s2)

    def return_height_m(self, away_m: float, height_m: float) -> float:
        """RTL_ALT and its like."""
        return return_height(self._get, away_m, height_m)

    def landing_m_s(self, limits: Limits, height_m: float) -> float:
        """LAND_*."""
        return landing_speed(self._get, limits, height_m)
