"""Checks of arguments from Python, like those of the command line's options."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence

from missions.errors import UavmapError

Paths = str | os.PathLike[str]


def path_text(name: str, value: Paths) -> str:
    """Return a path as text. Raises `UavmapError` for another value.

    >>> from pathlib import Path
    >>> path_text("out", Path("results") / "field")
    'results/field'
    """
    try:
        text = os.fspath(value)
    except TypeError:
        raise UavmapError(f"{name} = {value!r}: expected a path") from None
    if not text or not isinstance(text, str):
        raise UavmapError(f"{name} = {value!r}: expected a path that is text")
    return text


def texts(name: str, value: str | Sequence[str]) -> tuple[str, ...]:
    """Return one text, or several, as a tuple. Raises `UavmapError`.

    >>> texts("connect", "udpin://0.0.0.0:14550")
    ('udpin://0.0.0.0:14550',)
    """
    several = (value,) if isinstance(value, str) else tuple(value)
    for one in several:
        if not isinstance(one, str) or not one:
            raise UavmapError(f"{name} = {value!r}: expected a text, or a list of texts")
    return several


def whole(name: str, value: int, low: int, high: int) -> int:
    """Return a whole number from `low` to `high`. Raises `UavmapError`.

    >>> whole("seed", 7, 0, 100)
    7
    >>> whole("robots", 0, 1, 100)
    Traceback (most recent call last):
    missions.errors.UavmapError: robots = 0: expected a whole number from 1 to 100
    """
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise UavmapError(f"{name} = {value!r}: expected a whole number from {low} to {high}")
    return value


def number(name: str, value: float, low: float, high: float) -> float:
    """Return a finite number from `low` to `high`. Raises `UavmapError`."""
    good = isinstance(value, int | float) and not isinstance(value, bool)
    if not good or not math.isfinite(value) or not low <= value <= high:
        raise UavmapError(f"{name} = {value!r}: expected a number from {low:g} to {high:g}")
    return float(value)


def choice(name: str, value: str, known: Sequence[str]) -> str:
    """Return a text that is one of the known ones. Raises `UavmapError`."""
    if value not in known:
        raise UavmapError(f"{name} = {value!r}: expected one of {', '.join(known)}")
    return value
