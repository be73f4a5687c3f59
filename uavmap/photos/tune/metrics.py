"""Precision, recall and IoU of marks against what is painted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Counts:
    """Of pixels or cells: marked and region, marked only, region only."""

    both: float = 0.0
    marked_only: float = 0.0
    region_only: float = 0.0

    @classmethod
    def of(
        cls, marked: NDArray[np.bool_], region: NDArray[np.bool_], known: NDArray[np.bool_]
    ) -> Counts:
        """Count where it is known what is region."""
        return cls(
            float(np.count_nonzero(marked & region & known)),
            float(np.count_nonzero(marked & ~region & known)),
            float(np.count_nonzero(~marked & region & known)),
        )

    def __add__(self, other: Counts) -> Counts:
        return Counts(
            self.both + other.both,
            self.marked_only + other.marked_only,
            self.region_only + other.region_only,
        )

    @property
    def precision(self) -> float:
        """The part of what is marked that is region; 1 where nothing is marked."""
        return _ratio(self.both, self.both + self.marked_only)

    @property
    def recall(self) -> float:
        """The part of the region that is marked; 1 where there is none."""
        return _ratio(self.both, self.both + self.region_only)

    @property
    def iou(self) -> float:
        """Intersection over union; 1 where both are empty.

        >>> Counts(1.0, 1.0, 0.0).iou
        0.5
        """
        return _ratio(self.both, self.both + self.marked_only + self.region_only)


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole else 1.0


def total(counts: Sequence[Counts]) -> Counts:
    """Return the sum over pictures."""
    return sum(counts, Counts())


def by_cell(values: NDArray[np.float32], cell: float) -> NDArray[np.float32]:
    """Return the mean over squares of `cell` places, which is what a cell of the map sees."""
    rows, columns = (max(1, round(side / cell)) for side in values.shape)
    return np.asarray(cv2.resize(values, (columns, rows), interpolation=cv2.INTER_AREA), np.float32)


def cell_counts(
    share: NDArray[np.float32],
    region: NDArray[np.float32],
    known: NDArray[np.bool_],
    cell: float,
    least: float,
) -> Counts:
    """Count cells whose mean share is at least `least`, against those that are region by half.

    Args:
        share: The marked part of each place, or its probability, (rows, columns).
        region: The part that is region.
        cell: Side of a cell in places.
        least: The share that makes a cell positive.
    """
    seen = by_cell(known.astype(np.float32), cell)
    weight = np.maximum(seen, 1e-6)
    there = by_cell(region * known, cell) / weight >= 0.5
    found = by_cell(share * known, cell) / weight >= least
    return Counts.of(found, there, seen >= 0.5)
