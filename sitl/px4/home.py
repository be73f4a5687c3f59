"""A PX4 corrects the height of its home after take-off, when its estimate gets better."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

LASTS_S = 120.0
EVERY_S = 2.0


class HomeCorrection:
    """By how much the height of home is off, as a seed has it.

    >>> home = HomeCorrection([1], most_m=1.5)
    >>> home.height_m(None), home.height_m(1.9)
    (0.0, 0.0)
    >>> home.height_m(2.0) == home.height_m(3.9) != home.height_m(4.0)
    True
    >>> abs(home.height_m(500.0)) <= 1.5
    True
    """

    def __init__(self, seed: Sequence[int], most_m: float) -> None:
        rng = np.random.default_rng(list(seed))
        count = int(LASTS_S / EVERY_S)
        drawn = rng.standard_normal(count) * (0.5 * most_m)
        self._heights_m: list[float] = [0.0, *np.clip(drawn, -most_m, most_m).tolist()]

    def height_m(self, flown_s: float | None) -> float:
        """The error so long after take-off; None: before it."""
        if flown_s is None:
            return 0.0
        at = min(int(flown_s / EVERY_S + 1e-9), len(self._heights_m) - 1)
        return self._heights_m[max(at, 0)]
