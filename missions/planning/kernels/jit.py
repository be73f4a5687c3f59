"""The same functions compiled with numba, or as plain Python without it.

A kernel takes and returns numbers and numpy arrays only, so both ways give the same results.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

P = ParamSpec("P")
R = TypeVar("R")

try:
    from numba import njit
    from numba.extending import register_jitable
except ImportError:
    COMPILED = False
    """True if kernels are compiled; without it they are some hundred times slower."""
else:
    COMPILED = True


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function of arrays if numba is installed; a kernel may call others of its own
    module.

    A kernel may call functions of another module only if they never change (the end of this one).
    Numba compiles anew when the file of a kernel changes, but does not see a change of a callee in
    another file.

    The compiled code is kept beside the source, else in the user's cache, so that only the first
    run on a machine compiles. If neither can be written, every run compiles.
    """
    if not COMPILED:
        return function
    compiled: Callable[P, R]
    try:
        compiled = njit(cache=True)(function)
    except RuntimeError:  # numba finds no folder to write to
        compiled = njit(cache=False)(function)
    return compiled


def part(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function as a part of the kernels that call it; from Python it is plain Python.

    A part has no entry from Python and no file of its own, which take longer to make than its code.
    """
    if not COMPILED:
        return function
    compiled: Callable[P, R] = register_jitable(no_cpython_wrapper=True, no_cfunc_wrapper=True)(
        function
    )
    return compiled


# --- what kernels of several modules share --------------------------------------------------------
# Compiled code of other modules holds these functions, and is not compiled anew when this file
# changes. So each keeps its meaning under its name: what is to give other numbers gets another.
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@part
def uniform(state: Ints) -> float:
    """Return a number from 0 to 1 (Park and Miller's generator, multiplier 48271)."""
    state[0] = state[0] * 48271 % 2147483647
    return float(state[0]) / 2147483647.0


@part
def draw(state: Ints, n: int) -> int:
    """Return a whole number from 0 to n - 1."""
    return int(uniform(state) * n) % n


@part
def team_s(total: Floats, last: float) -> float:
    """Return the seconds of a team: the part `last` of the last vehicle's, the rest of the mean."""
    most, both = 0.0, 0.0
    for v in range(total.shape[0]):
        most = max(most, total[v])
        both += total[v]
    cost: float = last * most + (1.0 - last) * both / total.shape[0]
    return cost


@part
def copy_piece(source: NDArray[Any], begin: int, end: int, target: NDArray[Any], at: int) -> None:
    """Copy `begin` to `end` - 1 of one row to another row, from its place `at` on.

    A loop: the assignment of a slice takes a second to compile, with its errors and its overlaps.
    """
    for k in range(begin, end):
        target[at + k - begin] = source[k]
