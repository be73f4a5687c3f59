"""Compiled where numba is installed, plain Python where it is not: the same functions either way.

A kernel takes and returns numbers and numpy arrays only, so both ways give the same results.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

try:
    from numba import njit
except ImportError:
    COMPILED = False
    """Whether kernels are compiled; without it they are some hundred times slower."""
else:
    COMPILED = True


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function of arrays if numba is there; a kernel may call others of its own module.

    Of another only what never changes (`missions.planning.kernels.annealing`): numba compiles anew
    when the file of a kernel changes, but does not see that a callee in another file did.

    The compiled code is kept beside the source, else in the user's cache, so that only the first
    run on a machine compiles. Where neither can be written every run does.
    """
    if not COMPILED:
        return function
    compiled: Callable[P, R]
    try:
        compiled = njit(cache=True)(function)
    except RuntimeError:  # numba finds no folder to write to
        compiled = njit(cache=False)(function)
    return compiled
