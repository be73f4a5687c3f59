"""Localization with errors: how probable each cell is, a histogram filter.

Given right error rates, and errors that are independent of each other, of all answers given with
95 % confidence 95 % are right.

    belief = Belief.uniform(GridMap.of(cells))
    belief = belief.saw(pattern, noise)
    belief = belief.moved(1, 0, slip=0.02).saw(pattern, noise)
    belief.best, belief.confidence
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.errors import LocalizationError
from missions.lab.localization.grid_map import GridMap
from missions.lab.localization.neighbourhood import DIRECTIONS, EAST, NORTH, SOUTH, WEST
from missions.units import Cell

ALL: Final = 0xFF
"""All eight neighbours, as a mask."""
_EVERY: Final = np.arange(256, dtype=np.uint8)
MAX_RATE: Final = 0.49
"""A sensor that errs in half of all cases says nothing."""


@dataclass(frozen=True, slots=True)
class Noise:
    """How often a sensor errs, about each neighbour independently of the others.

    A positive is an unobstructed cell, a cell of the region. Both rates are 0 to `MAX_RATE`; a
    `LocalizationError` names the one that is not.
    """

    false_positive: float = 0.0
    """Of obstructed cells, the share that is taken for unobstructed ones."""
    false_negative: float = 0.0
    """Of unobstructed cells, the share that is taken for obstructed ones."""

    def __post_init__(self) -> None:
        for name in ("false_positive", "false_negative"):
            value = getattr(self, name)
            if not 0.0 <= value <= MAX_RATE:
                raise LocalizationError(f"{name} = {value:g}: expected 0 to {MAX_RATE}")

    def likelihoods(self, seen: int, judged: int = ALL) -> NDArray[np.float64]:
        """The likelihood of the pattern `seen` where the truth is each of the 256 patterns; only
        neighbours in the mask `judged` were sensed."""
        free, blocked = _EVERY & judged, ~_EVERY & judged
        unseen = ~seen & 0xFF
        hits, misses = np.bitwise_count(free & seen), np.bitwise_count(free & unseen)
        false, right = np.bitwise_count(blocked & seen), np.bitwise_count(blocked & unseen)
        likelihoods: NDArray[np.float64] = (
            (1.0 - self.false_negative) ** hits
            * self.false_negative**misses
            * self.false_positive**false
            * (1.0 - self.false_positive) ** right
        )
        return likelihoods


EXACT: Final = Noise()
"""A sensor that does not err."""


@dataclass(frozen=True, eq=False, slots=True)
class Belief:
    """The probability of each cell of a map to be the one. A value: every change makes a new one.

    >>> row = GridMap.of({Cell(i, 0) for i in range(4)})
    >>> belief = Belief.uniform(row).saw(row.patterns[1], Noise(0.05, 0.1))
    >>> belief.best, round(belief.confidence, 3)
    (Cell(east=1, north=0), 0.474)
    >>> belief = belief.moved(-1, 0, slip=0.02).saw(row.patterns[0], Noise(0.05, 0.1))
    >>> belief.best, round(belief.confidence, 3)
    (Cell(east=0, north=0), 0.902)
    """

    known: GridMap
    mass: NDArray[np.float64]
    """Of each cell, in the order of the map; the sum is 1."""

    @classmethod
    def uniform(cls, known: GridMap) -> Belief:
        """Nothing is known but the map."""
        return cls(known, np.full(known.size, 1.0 / known.size))

    def moved(self, dx: int, dy: int, slip: float = 0.0) -> Belief:
        """The belief after a move of `dx` cells east and `dy` north, cell by cell, east first.

        With the probability `slip` a step stays or goes in one of the three other directions, each
        of the four equally likely. A step off the map stays, unnoticed. Raises `LocalizationError`
        for a slip outside 0 to 1.
        """
        if not 0.0 <= slip <= 1.0:
            raise LocalizationError(f"slip = {slip:g}: expected a probability, 0 to 1")
        steps = [EAST if dx > 0 else WEST] * abs(dx) + [NORTH if dy > 0 else SOUTH] * abs(dy)
        mass = self.mass
        for direction in steps:
            mass = self._stepped(mass, direction, slip)
        return Belief(self.known, mass)

    def _stepped(
        self, mass: NDArray[np.float64], direction: int, slip: float
    ) -> NDArray[np.float64]:
        landings, size = self.known.landings, self.known.size
        there = np.bincount(landings[direction], mass, size).astype(np.float64)
        if slip == 0.0:
            return there
        wrong = mass + sum(
            np.bincount(landings[d], mass, size) for d in DIRECTIONS if d != direction
        )
        return (1.0 - slip) * there + slip / 4.0 * wrong

    def saw(
        self,
        neighbours: int,
        noise: Noise = EXACT,
        *,
        judged: int = ALL,
        own: bool | None = None,
    ) -> Belief:
        """The belief after a look that shows a pattern of `neighbours`, sensed where `judged` says.

        `own`: whether the cell itself looks unobstructed, for an aircraft, which may be beside the
        region; None where that was not sensed. Raises `LocalizationError` where no cell fits: the
        map is of something else, or the sensor errs more than `noise` says.
        """
        mass = self.mass * noise.likelihoods(neighbours, judged)[self.known.pattern_array]
        if own is not None:
            free = np.array(self.known.own)
            fp, fn = noise.false_positive, noise.false_negative
            mass = mass * (np.where(free, 1.0 - fn, fp) if own else np.where(free, fn, 1.0 - fp))
        total = float(mass.sum())
        if not total > 0.0:
            raise LocalizationError(
                "what is seen fits no cell of the map that is still possible: the map is of "
                "another place, or the error rates are too small"
            )
        return Belief(self.known, mass / total)

    @property
    def best(self) -> Cell:
        """The most probable cell; of equals the first in the order of the map."""
        return self.known.cells[self.number]

    @property
    def number(self) -> int:
        """The number of the most probable cell."""
        return int(self.mass.argmax())

    @property
    def confidence(self) -> float:
        """The probability of the most probable cell."""
        return float(self.mass.max())
