"""The boundary of a region at pixel level, as the writers of results take it.

Coordinates are ground metres of the grid's moving frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from shapely.geometry import MultiPolygon
from shapely.geometry.base import BaseGeometry


class Line(NamedTuple):
    """A closed line of the boundary.

    Attributes:
        points: Shape (n, 2), its first point again at the end.
        hole: Whether the region lies outside of it.
        uncertainty_m: Half of the way from P = 0.1 to P = 0.9 across it, at each point but the
            last; infinite where P comes to 0.9 nowhere.
    """

    points: NDArray[np.float64]
    hole: bool
    uncertainty_m: NDArray[np.float64]

    def uncertainty(self, share: float) -> float:
        """What the uncertainty is below along this share of the line, metres."""
        return weighted_quantile(self.uncertainty_m, _lengths(self.points), share)


@dataclass(frozen=True, slots=True)
class Boundary:
    """The region, and where its edge may be.

    Attributes:
        probability: P at the boundary.
        region: P is at least that in it; valid, maybe empty.
        likely: Where P is at least 0.9.
        possible: Where P is at least 0.1.
        band: What is possible and not likely.
        lines: Those of `region`, outer ones first.
        open_lines: Where the boundary runs along the end of what pictures show.
        pitch_m: Edge of a pixel of the raster, metres on the ground.
        tolerance_m: By how much lines were moved at most to have fewer points.
    """

    probability: float
    region: MultiPolygon
    likely: MultiPolygon
    possible: MultiPolygon
    band: MultiPolygon
    lines: tuple[Line, ...]
    open_lines: BaseGeometry
    pitch_m: float
    tolerance_m: float

    def uncertainty_m(self, share: float) -> float | None:
        """What the uncertainty is below for this share of all points of all lines."""
        if not self.lines:
            return None
        steps = np.concatenate([_lengths(line.points) for line in self.lines])
        values = np.concatenate([line.uncertainty_m for line in self.lines])
        return weighted_quantile(values, steps, share)


def weighted_quantile(
    values: NDArray[np.float64], weights: NDArray[np.float64], share: float
) -> float:
    """The value that this share of the weight does not exceed.

    >>> weighted_quantile(np.array([3.0, 1.0, 2.0]), np.array([1.0, 8.0, 1.0]), 0.85)
    2.0
    """
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    at = int(np.searchsorted(total, share * total[-1]))
    return float(values[order][min(at, len(values) - 1)])


def _lengths(ring: NDArray[np.float64]) -> NDArray[np.float64]:
    """What each point of a closed line stands for: half of the way to its neighbours."""
    steps = np.hypot(*np.diff(ring, axis=0).T)
    lengths: NDArray[np.float64] = (steps + np.roll(steps, 1)) / 2.0
    return lengths
