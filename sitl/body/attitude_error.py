"""What an autopilot's attitude errs by: roll and pitch for seconds, the heading for longer.

A PX4 1.17 in flight, held against its simulator's truth: heading 2 degrees (standard deviation),
for some 20 s alike, up to 4; roll and pitch 0.8 degrees, for 3 s.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

TILT_TAU_S: Final = 3.0
HEADING_TAU_S: Final = 20.0
_STEP_S: Final = 0.1
_BLOCK: Final = 3 * 64


class AttitudeError:
    """Errors of roll, pitch and heading, radians: each a Gauss-Markov process.

    >>> exact = AttitudeError([1], 0.0, 0.0)
    >>> exact.step(10.0)
    >>> exact.roll, exact.pitch, exact.heading
    (0.0, 0.0, 0.0)
    """

    def __init__(self, seed: Sequence[int], tilt_rad: float, heading_rad: float) -> None:
        self._sigmas = tilt_rad, tilt_rad, heading_rad
        self._rng = np.random.default_rng(list(seed))
        self._kicks: list[float] = []
        self._waits_s = 0.0
        self.roll = self.pitch = self.heading = 0.0
        self._keep = [
            math.exp(-_STEP_S / tau_s) for tau_s in (TILT_TAU_S, TILT_TAU_S, HEADING_TAU_S)
        ]
        if self.any:
            drawn = self._rng.standard_normal(3).tolist()
            self.roll, self.pitch, self.heading = (
                sigma * kick for sigma, kick in zip(self._sigmas, drawn, strict=True)
            )

    @property
    def any(self) -> bool:
        """Whether there is an error at all."""
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
            self._kicks = self._rng.standard_normal(_BLOCK).tolist()
        return self._kicks.pop()
