"""The sources of PX4's EKF2 for its position, and the correction of the height of home.

EKF2_GPS_CTRL and EKF2_EV_CTRL (bit 0: horizontal position) choose the sources. Beside satellites
only the changes of a companion's positions count: their offset is estimated. It accepts a position
of EXTERNAL_POSITION_ESTIMATE while nothing else aids it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from sitl.body.estimator import Estimator
from sitl.body.physics import Body
from sitl.copter.aiding import Aiding, Answer
from sitl.copter.params import Parameters

_POSITION = 1  # of EKF2_GPS_CTRL and EKF2_EV_CTRL
_VISION_S = 0.4
_DEAD_RECKONING_S = 1.0
_STOPS_AFTER_S = 7.0  # satellites without a fix are fused no more
_OFFSET_SHARE = 0.1  # of a difference that the offset follows with each position
_UNKNOWN_SIGMA_M = 50.0
_HARD_SIGMA_M = 1.0  # what is better than this is taken as it is
_GATE = 5.0


class Ekf2Aiding(Aiding):
    """PX4's."""

    most_delay_s = 15.0

    def __init__(self, body: Body, error: Estimator, parameters: Parameters) -> None:
        super().__init__(body, error, parameters)
        self._version = -1
        self._fuses_satellites = True
        self._fuses_vision = False
        self._offset = (0.0, 0.0)
        self.just_stopped = self.just_started = False
        """Fusion of satellites stopped, or started, in this step."""

    @property
    def absolute(self) -> bool:
        """True if satellites or a companion give its position."""
        return self._fuses_satellites or self._fuses_vision

    def step(self, t_s: float) -> None:
        """Stop fusing satellites some time after the last fix; begin with one."""
        self._t_s = t_s
        error, get = self._error, self._get
        if error.calm and self._version == get.version:
            self.just_stopped = self.just_started = False
            return
        self._version = get.version
        error.satellites_used = bool(int(get["EKF2_GPS_CTRL"]) & _POSITION)
        error.still_near = before = self._fuses_satellites
        self._fuses_satellites = error.satellites_used and (
            error.by_satellites or (before and error.outage_s < _STOPS_AFTER_S)
        )
        self.just_stopped = before and not self._fuses_satellites
        self.just_started = self._fuses_satellites and not before
        if self._fuses_vision and (
            t_s - self._vision_s > _VISION_S or not int(get["EKF2_EV_CTRL"]) & _POSITION
        ):
            self._fuses_vision = False
        error.aided = self._fuses_vision

    def vision(self, east_m: float, north_m: float, sigma_m: float, resets: int) -> None:
        """Fuse its position as it is if it is alone, with an offset beside satellites."""
        error = self._error
        if not int(self._get["EKF2_EV_CTRL"]) & _POSITION:
            return
        if not self._is_somewhere(east_m, north_m):
            return
        starts = not self._fuses_vision or self._t_s - self._vision_s > _VISION_S
        leapt = self._leapt(resets)
        self._fuses_vision, self._vision_s = True, self._t_s
        east, north = self._errs_by(east_m, north_m)
        sigma_m = max(sigma_m, self._get["EKF2_EVP_NOISE"], 0.01)
        if self._fuses_satellites and (error.by_satellites or starts or leapt):
            away = (east - error.east, north - error.north)
            share = 1.0 if starts or leapt else _OFFSET_SHARE
            self._offset = (
                self._offset[0] + share * (away[0] - self._offset[0]),
                self._offset[1] + share * (away[1] - self._offset[1]),
            )
            return
        if starts:
            self._offset = (0.0, 0.0)
        errs_by = (east - self._offset[0], north - self._offset[1])
        if starts or leapt:
            error.reset_to(*errs_by, sigma_m)
        else:
            error.fuse(*errs_by, sigma_m)
        error.aided, error.no_fix_s = True, 0.0

    def receiver(self, east_m: float, north_m: float, sigma_m: float, fix_type: int) -> None:
        """Ignore GPS_INPUT."""

    def external_position(
        self, east_m: float, north_m: float, sigma_m: float | None, delay_s: float, *, flying: bool
    ) -> Answer:
        """Refuse while satellites, optical flow or a companion aid it."""
        error = self._error
        reckons = error.outage_s >= _DEAD_RECKONING_S and error.unaided
        if not (reckons or (not flying and not self._fuses_satellites)):
            return Answer.REFUSED
        if not self._is_somewhere(east_m, north_m):
            return Answer.NOWHERE
        sigma_m = sigma_m if sigma_m is not None and sigma_m > 0.0 else _UNKNOWN_SIGMA_M
        errs_by = self._errs_by(east_m, north_m, delay_s)
        if not flying or sigma_m < _HARD_SIGMA_M or error.far_off(*errs_by, sigma_m, _GATE):
            error.reset_to(*errs_by, sigma_m)
        else:
            error.fuse(*errs_by, sigma_m)
        return Answer.TAKEN


_LASTS_S = 120.0
_EVERY_S = 2.0


class HomeCorrection:
    """Error of the height of home after each take-off, while a better estimate corrects it.

    >>> home = HomeCorrection([1], most_m=1.5)
    >>> home.height_m(1.9)
    0.0
    >>> home.height_m(2.0) == home.height_m(3.9) != home.height_m(4.0)
    True
    >>> abs(home.height_m(500.0)) <= 1.5
    True
    """

    def __init__(self, seed: Sequence[int], most_m: float) -> None:
        rng = np.random.default_rng(list(seed))
        count = int(_LASTS_S / _EVERY_S)
        drawn = rng.standard_normal(count) * (0.5 * most_m)
        self._heights_m: list[float] = [0.0, *np.clip(drawn, -most_m, most_m).tolist()]
        self._since_s: float | None = None  # when it took off
        self._up = 0.0  # of home then

    def height_m(self, flown_s: float) -> float:
        """Return the error `flown_s` after take-off."""
        at = min(int(flown_s / _EVERY_S + 1e-9), len(self._heights_m) - 1)
        return self._heights_m[max(at, 0)]

    def home_up(self, t_s: float, up: float, *, airborne: bool) -> float:
        """Return the height of home over the plane at `t_s`; `up` is the height that it has."""
        if not airborne:
            self._since_s = None
            return up
        if self._since_s is None:
            self._since_s, self._up = t_s, up
        flown_s = t_s - self._since_s
        return self._up + self.height_m(flown_s) if flown_s <= _LASTS_S else up

    def end(self) -> None:
        """Keep home at its place until the next take-off."""
        self._since_s = -math.inf
