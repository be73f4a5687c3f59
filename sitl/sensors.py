"""How the autopilot's idea of its position errs: slowly, as satellite navigation does."""

from __future__ import annotations

import math

import numpy as np

_SMOOTHING_S = 3.0  # a navigation filter lets no jump through
_BLOCK = 1024


class PositionError:
    """Error of the estimated position, metres (east, north, up), zero at the beginning.

    A Gauss-Markov process of standard deviation `sigma_m` and correlation time `tau_s`, smoothed
    so that its rate is finite: the estimate moves, it does not jitter. The vertical error (a
    barometer's) has a third of the deviation.
    """

    __slots__ = (
        "_at",
        "_noise",
        "_raw",
        "_rng",
        "_sigma",
        "_tau_s",
        "east",
        "north",
        "up",
        "v_east",
        "v_north",
        "v_up",
    )

    def __init__(self, rng: np.random.Generator, sigma_m: float, tau_s: float) -> None:
        self._rng = rng
        # smoothing takes away variance: tau / (tau + smoothing) of it is left
        widened = sigma_m * math.sqrt((tau_s + _SMOOTHING_S) / tau_s)
        self._sigma = (widened, widened, widened / 3.0)
        self._tau_s = tau_s
        self._raw = [0.0, 0.0, 0.0]
        self._noise: list[float] = []
        self._at = 0
        self.east = self.north = self.up = 0.0
        self.v_east = self.v_north = self.v_up = 0.0

    def step(self, dt_s: float) -> None:
        """Advance by `dt_s`."""
        if self._sigma[0] == 0.0:
            return
        if self._at + 3 > len(self._noise):
            # drawn in blocks: one call of numpy a step would cost more than the physics
            self._noise = self._rng.standard_normal(3 * _BLOCK).tolist()
            self._at = 0
        keep = math.exp(-dt_s / self._tau_s)
        kick = math.sqrt(1.0 - keep * keep)
        for axis in range(3):
            self._raw[axis] = (
                keep * self._raw[axis] + kick * self._sigma[axis] * self._noise[self._at + axis]
            )
        self._at += 3
        self.v_east = (self._raw[0] - self.east) / _SMOOTHING_S
        self.v_north = (self._raw[1] - self.north) / _SMOOTHING_S
        self.v_up = (self._raw[2] - self.up) / _SMOOTHING_S
        follow = -math.expm1(-dt_s / _SMOOTHING_S) * _SMOOTHING_S
        self.east += follow * self.v_east
        self.north += follow * self.v_north
        self.up += follow * self.v_up
