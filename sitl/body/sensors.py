"""Errors of a vehicle's own sensors: its height above the sea, and its attitude.

Heights by satellites differ by metres from receiver to receiver, and wander. On the ground the
autopilot follows them; armed its height is that of arming and what the barometer adds.

The attitude errs in roll and pitch for seconds, in the heading for longer. These are standard
deviations of a PX4 1.17 in flight, against its simulator's truth. Heading: 2 degrees, at most 4,
correlated over some 20 s. Roll and pitch: 0.8 degrees, over 3 s.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

WORST_M = 8.0
_HEIGHT_TAU_S = 300.0
"""Correlation time of a receiver's height, s."""
_FOLLOWS_M_S = 0.2  # on the ground
_HEIGHT_BLOCK = 64


class Altimeter:
    """Errors of heights above the sea: `receiver_m` the receiver's, `datum_m` the autopilot's.

    `sea_m` is the height of the world's plane. The receiver's error has the standard deviation
    `sigma_m` and never exceeds `WORST_M`.
    """

    def __init__(self, sea_m: float, seed: Sequence[int], sigma_m: float) -> None:
        self.sea_m = sea_m
        self.receiver_m = self.datum_m = 0.0
        self._rng = np.random.default_rng(list(seed))
        self.sigma_m = sigma_m
        self._second_s = 0.0  # since the last number was drawn
        self._from_m = self._to_m = 0.0
        self._kicks: list[float] = []
        if sigma_m > 0.0:
            self.start()

    @property
    def amsl_m(self) -> float:
        """Height of the world's plane above the sea by the autopilot."""
        return self.sea_m + self.datum_m

    def start(self) -> None:
        """Draw another error: the vehicle is switched on, or has another battery."""
        if self.sigma_m > 0.0:
            self._to_m = self._held(self.sigma_m * float(self._rng.standard_normal()))
            self._next()
            self.receiver_m = self.datum_m = self._from_m

    def step(self, dt_s: float, *, armed: bool) -> None:
        """Let the receiver wander; disarmed the autopilot follows it."""
        if self.sigma_m == 0.0:
            return
        self._second_s += dt_s
        while self._second_s >= 1.0:
            self._second_s -= 1.0
            self._next()
        self.receiver_m = self._from_m + (self._to_m - self._from_m) * self._second_s
        if not armed:
            most_m = _FOLLOWS_M_S * dt_s
            self.datum_m += max(-most_m, min(most_m, self.receiver_m - self.datum_m))

    def _next(self) -> None:
        if not self._kicks:
            self._kicks = self._rng.standard_normal(_HEIGHT_BLOCK).tolist()
        keep = math.exp(-1.0 / _HEIGHT_TAU_S)
        kick = self.sigma_m * math.sqrt(1.0 - keep * keep)
        self._from_m = self._to_m
        self._to_m = self._held(keep * self._from_m + kick * self._kicks.pop())

    def _held(self, error_m: float) -> float:
        return max(-WORST_M, min(WORST_M, error_m))


_TILT_TAU_S, _HEADING_TAU_S = 3.0, 20.0
_STEP_S = 0.1
_ATTITUDE_BLOCK = 3 * 64


class AttitudeError:
    """Errors of roll, pitch and heading, radians: each a Gauss-Markov process."""

    def __init__(self, seed: Sequence[int], tilt_rad: float, heading_rad: float) -> None:
        self._sigmas = tilt_rad, tilt_rad, heading_rad
        self._rng = np.random.default_rng(list(seed))
        self._kicks: list[float] = []
        self._waits_s = 0.0
        self.roll = self.pitch = self.heading = 0.0
        self._keep = [
            math.exp(-_STEP_S / tau_s) for tau_s in (_TILT_TAU_S, _TILT_TAU_S, _HEADING_TAU_S)
        ]
        if self.any:
            drawn = self._rng.standard_normal(3).tolist()
            self.roll, self.pitch, self.heading = (
                sigma * kick for sigma, kick in zip(self._sigmas, drawn, strict=True)
            )

    @property
    def any(self) -> bool:
        """True if there is an error at all."""
        return any(self._sigmas)

    def step(self, dt_s: float) -> None:
        """Advance by `dt_s`, in steps of a tenth of a second."""
        if not self.any:
            return
        self._waits_s += dt_s
        while self._waits_s >= _STEP_S:
            self._waits_s -= _STEP_S
            self.roll, self.pitch, self.heading = (
                keep * error + math.sqrt(1.0 - keep * keep) * sigma * self._kick()
                for keep, error, sigma in zip(
                    self._keep, (self.roll, self.pitch, self.heading), self._sigmas, strict=True
                )
            )

    def _kick(self) -> float:
        if not self._kicks:
            self._kicks = self._rng.standard_normal(_ATTITUDE_BLOCK).tolist()
        return self._kicks.pop()
