"""The lawn-mower baseline of Sung and Tokekar, section 6."""

from __future__ import annotations

from collections.abc import Collection

from missions.planning.stepwise.metric import Metric
from missions.units import Cell


def lawn_mower(roi: Collection[Cell], robots: int, metric: Metric) -> float:
    """Time to mow the rectangle around a ROI, which is known beforehand, one strip a robot.

    The rectangle is split along its length or its breadth, whichever is sooner done; the ways to
    the strips and home are not counted. So it is a baseline, neither a strategy nor a lower bound.

    >>> lawn_mower([Cell(0, 0), Cell(3, 1)], 2, Metric())
    3.0
    """
    wide = max(c.east for c in roi) - min(c.east for c in roi) + 1
    high = max(c.north for c in roi) - min(c.north for c in roi) + 1
    return min(
        _mow(-(-wide // robots), high, metric),
        _mow(wide, -(-high // robots), metric),
    )


def _mow(wide: int, high: int, metric: Metric) -> float:
    """A rectangle of cells from the best corner, in lanes along the better axis."""
    east, north = Cell(1, 0), Cell(0, 1)
    return min(
        _lanes(wide, high, east, north, metric),
        _lanes(high, wide, north, east, metric),
    )


def _lanes(steps: int, lanes: int, along: Cell, across: Cell, metric: Metric) -> float:
    """Lanes of so many cells, up and down in turns."""
    origin = Cell(0, 0)
    forth, back = metric.leg(origin, along), metric.leg(along, origin)
    aside = min(metric.leg(origin, across), metric.leg(across, origin))
    first, second = -(-lanes // 2), lanes // 2
    up_and_down = min(first * forth + second * back, first * back + second * forth)
    return (steps - 1) * up_and_down + (lanes - 1) * aside
