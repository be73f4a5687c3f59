"""The height above the sea as a vehicle has it: a receiver's, then the air's pressure.

Heights by satellites differ by metres from receiver to receiver, and wander. On the ground the
autopilot follows them; from arming on its height is that of arming and what the barometer adds.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

WORST_M = 8.0
TAU_S = 300.0
"""How slowly a receiver's height wanders."""
_FOLLOWS_M_S = 0.2  # on the ground
_BLOCK = 64


class Altimeter:
    """What heights above the sea err by: `receiver_m` the receiver's, `datum_m` the autopilot's.

    `sea_m` is the height of the world's plane. The receiver's error has the standard deviation
    `sigma_m` and is never beyond `WORST_M`.

    >>> exact = Altimeter(500.0, [1], 0.0)
    >>> exact.step(10.0, armed=False)
    >>> exact.amsl_m, exact.receiver_m
    (500.0, 0.0)
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
        """The height of the world's plane above the sea, as the autopilot has it."""
        return self.sea_m + self.datum_m

    def start(self) -> None:
        """The vehicle is switched on, or has been given a battery: another error than before."""
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
        """Where it will be in a second."""
        if not self._kicks:
            self._kicks = self._rng.standard_normal(_BLOCK).tolist()
        keep = math.exp(-1.0 / TAU_S)
        kick = self.sigma_m * math.sqrt(1.0 - keep * keep)
        self._from_m = self._to_m
        self._to_m = self._held(keep * self._from_m + kick * self._kicks.pop())

    def _held(self, error_m: float) -> float:
        return max(-WORST_M, min(WORST_M, error_m))
