"""What the annealings of paths and of tours share: random numbers, and what a team's time costs.

Compiled code of other modules holds these functions, and is not compiled anew when this file
changes (`missions.planning.kernels.jit`). So each keeps its meaning under its name: what is to give
other numbers gets another name.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from missions.planning.kernels.jit import kernel

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@kernel
def uniform(state: Ints) -> float:
    """A number from 0 to 1 (Park and Miller's generator, multiplier 48271)."""
    state[0] = state[0] * 48271 % 2147483647
    return float(state[0]) / 2147483647.0


@kernel
def draw(state: Ints, n: int) -> int:
    """A whole number from 0 to n - 1."""
    return int(uniform(state) * n) % n


@kernel
def team_s(total: Floats, last: float) -> float:
    """Seconds of a team: the part `last` of the last vehicle's, the rest of everybody's."""
    most, both = 0.0, 0.0
    for v in range(total.shape[0]):
        most = max(most, total[v])
        both += total[v]
    cost: float = last * most + (1.0 - last) * both / total.shape[0]
    return cost
