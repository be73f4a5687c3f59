"""Table 1 of the paper: path, steps and turns of two robots in a rectangle, by formula.

A rectangle of length `x_m` along the stripes and breadth `y_m` across them; counts are real
numbers, for the formulas know neither ends of stripes nor borders of the rectangle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from missions.lab.cooperation.trapezoids import Cover


@dataclass(frozen=True, slots=True)
class Reckoned:
    """A column of the table."""

    path_m: float
    steps: float
    turns: float
    """As printed."""
    turns_corrected: float
    """With the turns inside of stripes in every stripe; the print has those of one."""


def reckoned(cover: Cover, x_m: float, y_m: float, range_m: float, theta_rad: float) -> Reckoned:
    """The formulas, simplified: 1 + cos(a) is 2 cos(a/2)^2, and 1 - cos(a) is 2 sin(a/2)^2.

    >>> found = reckoned(Cover.TRIANGLES, 400.0, 200.0, 10.0, math.radians(60.0))
    >>> round(found.path_m, 1), round(found.steps, 1), round(found.turns, 1)
    (18875.2, 1847.5, 46.2)
    >>> found = reckoned(Cover.DIAMONDS, 400.0, 200.0, 10.0, math.radians(60.0))
    >>> round(found.path_m, 1), found.steps, found.turns, found.turns_corrected
    (16964.4, 1600.0..., 200.0..., 3240.0...)
    """
    if cover is Cover.TRIANGLES:
        rows_m = range_m * math.cos(theta_rad / 2.0)
        turns = 2.0 * y_m / rows_m
        steps = 2.0 * x_m * y_m / (range_m**2 * math.sin(theta_rad))
        return Reckoned(2.0 * y_m + 2.0 * x_m * y_m / rows_m, steps, turns, turns)
    inside = 4.0 * x_m / (range_m * math.sqrt(2.0 - 2.0 * math.cos(theta_rad)))
    between = 2.0 * y_m / range_m
    return Reckoned(
        path_m=2.0 * y_m + 2.0 * x_m * y_m / (range_m * math.cos(theta_rad / 4.0)),
        steps=x_m * y_m / (range_m**2 * math.sin(theta_rad / 2.0)),
        turns=between + inside,
        turns_corrected=between + inside * y_m / range_m,
    )
