"""The sources of ArduPilot's EKF3 for its position.

SET_EKF_SOURCE_SET chooses one of three sets of sources (EK3_SRCn_POSXY). It also uses a second
receiver by GPS_INPUT, and a companion's positions by VISO_TYPE. It uses single positions by
EXTERNAL_POSITION_ESTIMATE once no position has been fused for a second.
"""

from __future__ import annotations

import math

from sitl.body.estimator import Estimator
from sitl.body.physics import Body
from sitl.copter.aiding import Aiding, Answer
from sitl.copter.params import Parameters

_GPS, _EXTERNAL_NAV = 3, 6  # EK3_SRCn_POSXY
_BY_MAVLINK = 14  # GPS2_TYPE
_SWITCHES = (1, 4)  # GPS_AUTO_SWITCH: the best, the first while it has a fix
_FIX_3D = 3
_RECEIVER_S = 4.0  # time without a message after which a receiver is gone
_VISION_S = 0.3  # a companion's positions come at 4 Hz at least
_DEAD_RECKONING_S = 1.0  # time without a position after which it accepts one by command
_ABSOLUTE_S = 10.0  # time for which it still calls its position absolute
_NO_AIDING_S = 15.0  # time without any help after which its horizontal position is given up
_LARGEST_SIGMA_M = 100.0


class Ek3Aiding(Aiding):
    """ArduCopter's."""

    most_delay_s = 5.0

    def __init__(self, body: Body, error: Estimator, parameters: Parameters) -> None:
        super().__init__(body, error, parameters)
        self._set = 1
        self._receiver_s = -math.inf
        self._source = _GPS
        self._changed = False  # to another source, whose first position is not there yet
        self._version = -1

    @property
    def absolute(self) -> bool:
        """True if a position was fused in the last seconds."""
        return self._error.no_fix_s < _ABSOLUTE_S

    def step(self, t_s: float) -> None:
        """Take satellites, the second receiver or the companion, by the set of sources."""
        self._t_s = t_s
        error = self._error
        if self._version != self._get.version:
            self._version = self._get.version
            self._look_at_source()
        elif error.calm:
            return
        by_gps = self._source == _GPS
        error.satellites_used = by_gps
        error.still_near = self.absolute and not self._changed
        if error.by_satellites:
            self._changed = False
        if self._source == _EXTERNAL_NAV:
            error.aided = t_s - self._vision_s <= _VISION_S
        else:
            error.aided = by_gps and not error.by_satellites and self._has_second_receiver

    def _look_at_source(self) -> None:
        source = int(self._get[f"EK3_SRC{self._set}_POSXY"])
        if source != self._source:
            self._source, self._changed = source, True

    @property
    def _has_second_receiver(self) -> bool:
        get = self._get
        return (
            int(get["GPS2_TYPE"]) == _BY_MAVLINK
            and int(get["GPS_AUTO_SWITCH"]) in _SWITCHES
            and self._t_s - self._receiver_s <= _RECEIVER_S
        )

    def vision(self, east_m: float, north_m: float, sigma_m: float, resets: int) -> None:
        """Fuse it where the set of sources has it; a leap of the companion's is a reset here."""
        if self._get["VISO_TYPE"] <= 0.0 or not self._is_somewhere(east_m, north_m):
            return
        leapt, self._vision_s = self._leapt(resets), self._t_s
        if self._source == _EXTERNAL_NAV:
            sigma_m = min(max(sigma_m, self._get["VISO_POS_M_NSE"], 0.05), _LARGEST_SIGMA_M)
            self._fuse(east_m, north_m, sigma_m, leapt)

    def receiver(self, east_m: float, north_m: float, sigma_m: float, fix_type: int) -> None:
        """Fuse GPS_INPUT if it has a fix and the first receiver has none."""
        if fix_type < _FIX_3D or not self._is_somewhere(east_m, north_m):
            return
        self._receiver_s = self._t_s
        if self._source == _GPS and self._has_second_receiver and not self._error.by_satellites:
            self._fuse(east_m, north_m, max(sigma_m, self._get["EK3_POSNE_M_NSE"], 0.1), False)

    def _fuse(self, east_m: float, north_m: float, sigma_m: float, leapt: bool) -> None:
        error = self._error
        errs_by = self._errs_by(east_m, north_m)
        if leapt or self._changed or not self.absolute:
            error.reset_to(*errs_by, sigma_m)
        else:
            error.fuse(*errs_by, sigma_m)
        self._changed, error.aided, error.no_fix_s = False, True, 0.0

    def external_position(
        self, east_m: float, north_m: float, sigma_m: float | None, delay_s: float, *, flying: bool
    ) -> Answer:
        """Reset the horizontal position; refuse while positions are fused anyway."""
        error = self._error
        if not self._is_somewhere(east_m, north_m):
            return Answer.NOWHERE
        aids_nothing = error.unaided and error.no_fix_s >= _NO_AIDING_S
        if error.no_fix_s < _DEAD_RECKONING_S or aids_nothing:
            return Answer.REFUSED
        sigma_m = max(sigma_m or 0.0, self._get["EK3_POSNE_M_NSE"], 0.1)
        error.reset_to(*self._errs_by(east_m, north_m, delay_s), sigma_m)
        return Answer.TAKEN

    def choose_sources(self, number: int) -> bool:
        """Choose one of three."""
        if not 1 <= number <= 3:
            return False
        self._set = number
        self._look_at_source()
        return True
