"""Where within its cell a vehicle is: a particle filter for a position that is not a cell's centre.

The heading is known. A look shows, at points around the position (the corners and the centre of a
footprint, say), whether the map is unobstructed there; so positions whose points would show
something else become improbable. Each particle is a position; their number is what it costs.

    swarm = Particles.spread(known, 2000, rng)
    swarm = swarm.saw(shown, noise, rng)
    swarm = swarm.moved(1.0, 0.0, 0.1, rng).saw(shown, noise, rng)
    swarm.mean, swarm.spread_cells
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.errors import LocalizationError
from missions.lab.localization.belief import Noise
from missions.lab.localization.grid_map import GridMap
from missions.units import Cell

Point = tuple[float, float]
"""East and north, in cells; the centre of cell (0, 0) is (0, 0)."""
FEWEST: Final = 0.5
"""Share of particles that count, below which they are drawn anew."""
JITTER: Final = 0.02
"""Cells, by which those that are drawn twice are moved apart, as a standard deviation."""


@dataclass(frozen=True, eq=False, slots=True)
class Particles:
    """Positions with their weights. A value: every change makes a new one.

    >>> rng = np.random.default_rng(1)
    >>> row = GridMap.of({Cell(i, 0) for i in range(4)})
    >>> swarm = Particles.spread(row, 500, rng)
    >>> looks = {(-0.8, 0.0): False, (0.0, 0.0): True}  # 0.8 cells in the west it ends
    >>> swarm = swarm.saw(looks, Noise(0.01, 0.01), rng)
    >>> swarm.best, swarm.confidence > 0.9, -0.2 < swarm.mean[0] < 0.1
    (Cell(east=0, north=0), True, True)
    """

    known: GridMap
    points: NDArray[np.float64]
    """East and north of each, in cells."""
    weights: NDArray[np.float64]
    """Of each; the sum is 1."""

    @classmethod
    def spread(cls, known: GridMap, count: int, rng: np.random.Generator) -> Particles:
        """Anywhere in the cells of a map.

        Args:
            known: the map.
            count: particles, at least 1.
            rng: random numbers.
        """
        if count < 1:
            raise LocalizationError(f"{count} particles: expected at least 1")
        centres = np.array(known.cells, np.float64)
        points = centres[rng.integers(known.size, size=count)] + rng.uniform(-0.5, 0.5, (count, 2))
        return cls(known, points, np.full(count, 1.0 / count))

    def moved(
        self, east_cells: float, north_cells: float, sigma_cells: float, rng: np.random.Generator
    ) -> Particles:
        """After a move whose length is known but for a standard deviation each way, in cells."""
        way = np.array([east_cells, north_cells])
        noise = rng.normal(0.0, sigma_cells, self.points.shape)
        return Particles(self.known, self.points + way + noise, self.weights)

    def saw(self, shown: Mapping[Point, bool], noise: Noise, rng: np.random.Generator) -> Particles:
        """After a look: whether it is unobstructed at points relative to the position, in cells.

        Raises:
            LocalizationError: no particle fits what is shown.
        """
        weights = self.weights.copy()
        fp, fn = noise.false_positive, noise.false_negative
        for offset, free in shown.items():
            there = self._free(self.points + offset)
            weights *= np.where(there, 1.0 - fn, fp) if free else np.where(there, fn, 1.0 - fp)
        total = float(weights.sum())
        if not total > 0.0:
            raise LocalizationError(
                "what is shown fits no particle: there are too few, or the map is of another place"
            )
        seen = Particles(self.known, self.points, weights / total)
        if 1.0 / float((seen.weights**2).sum()) < FEWEST * len(weights):
            return seen._drawn_anew(rng)
        return seen

    def _free(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether the map is unobstructed at points."""
        known = self.known
        raster = np.zeros((known.width, known.height), np.bool_)
        cells = np.array(known.cells)[np.array(known.own)]
        raster[cells[:, 0] - known.west, cells[:, 1] - known.south] = True
        at = np.floor(points + 0.5).astype(np.intp) - (known.west, known.south)
        inside = ((at >= 0) & (at < raster.shape)).all(axis=1)
        free = np.zeros(len(points), np.bool_)
        free[inside] = raster[at[inside, 0], at[inside, 1]]
        return free

    def _drawn_anew(self, rng: np.random.Generator) -> Particles:
        """As many, each as often as its weight says (systematic resampling)."""
        count = len(self.weights)
        marks = (np.arange(count) + rng.random()) / count
        drawn = np.minimum(np.searchsorted(self.weights.cumsum(), marks), count - 1)
        points = self.points[drawn] + rng.normal(0.0, JITTER, (count, 2))
        return Particles(self.known, points, np.full(count, 1.0 / count))

    @property
    def mean(self) -> Point:
        """The mean position."""
        east, north = self.weights @ self.points
        return float(east), float(north)

    @property
    def spread_cells(self) -> float:
        """The root of the mean square distance from the mean, in cells."""
        offsets = self.points - np.array(self.mean)
        return math.sqrt(float(self.weights @ (offsets**2).sum(axis=1)))

    @property
    def best(self) -> Cell:
        """The cell with the most weight in it."""
        return self._best()[0]

    @property
    def confidence(self) -> float:
        """The weight in that cell, 0 to 1."""
        return self._best()[1]

    def _best(self) -> tuple[Cell, float]:
        cells, number = np.unique(np.floor(self.points + 0.5), axis=0, return_inverse=True)
        mass = np.bincount(number.ravel(), self.weights)
        most = int(mass.argmax())
        return Cell(int(cells[most, 0]), int(cells[most, 1])), float(mass[most])
