"""Round steps of 1, 2 or 5 times a power of ten; the scale bar and the north arrow of a map."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from uavmap.output.drawing.palette import FAINT, INK, PAPER, Style
from uavmap.output.drawing.scene import Area, Box, Label, Line, Place, Shape

LONGEST_PX: Final = 190.0
"""Maximum length of a scale bar, px."""
BAR_HEIGHT_PX: Final = 26.0
ARROW_HEIGHT_PX: Final = 40.0
_MIDDLE_PX: Final = 110.0
"""Minimum length of a scale bar with a label in its middle, px."""
_STEPS: Final = (1.0, 2.0, 5.0, 10.0)
_SLACK: Final = 1e-6


def step_down(longest: float) -> float:
    """Return the largest round step that is at most `longest`.

    >>> step_down(37.0), step_down(5.0), step_down(1900.0)
    (20.0, 5.0, 1000.0)
    """
    power = 10.0 ** math.floor(math.log10(longest))
    return max(step * power for step in _STEPS if step * power <= longest * (1.0 + _SLACK))


def step_up(least: float) -> float:
    """Return the smallest round step that is at least `least`.

    >>> step_up(0.00031), step_up(0.7), step_up(3.0)
    (0.0005, 1.0, 5.0)
    """
    power = 10.0 ** math.floor(math.log10(least))
    return min(step * power for step in _STEPS if step * power >= least * (1.0 - _SLACK))


def step_near(about: float) -> float:
    """Return the round step nearest to `about`, by ratio.

    >>> step_near(1.9), step_near(0.27), step_near(26.0)
    (2.0, 0.2, 20.0)
    """
    power = 10.0 ** math.floor(math.log10(about))
    nearest = min(_STEPS, key=lambda step: abs(math.log(step * power / about)))
    return round(nearest * power, 6)


def scale_bar(corner: Place, px_per_m: float) -> Iterator[Shape]:
    """Draw a bar of a round length, rightwards and downwards from a corner."""
    x, y = corner
    length_m = step_down(LONGEST_PX / px_per_m)
    right, low = x + length_m * px_per_m, y + 6.0
    yield Box((x - 1.0, y - 1.0), (right + 1.0, low + 1.0), INK)
    yield Box(((x + right) / 2.0, y), (right, low), PAPER)
    yield Label((x, low + 12.0), "0", 13.0, INK)
    if right - x >= _MIDDLE_PX:
        yield Label(((x + right) / 2.0, low + 12.0), f"{length_m / 2.0:g}", 13.0, INK, "middle")
    yield Label((right, low + 12.0), f"{length_m:g} m", 13.0, INK, "end")


def north_arrow(corner: Place) -> Iterator[Shape]:
    """Draw an arrow upwards, half dark, with its meaning on its right."""
    x, y = corner
    base, notch = y + ARROW_HEIGHT_PX, y + ARROW_HEIGHT_PX - 9.0
    tip = (x + 12.0, y)
    right = (tip, (x + 21.0, base), (x + 12.0, notch))
    yield Area((tip, (x + 3.0, base), (x + 12.0, notch)), INK)
    yield Area(right, PAPER)
    yield Line.through(right, Style(INK, 1.0), closed=True)
    yield Label((x + 32.0, y + 16.0), "N", 17.0, INK)
    yield Label((x + 32.0, y + 34.0), "grid north", 13.0, FAINT)
