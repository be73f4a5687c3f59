"""A robot that does not know where it is, on a grid, with errors of its sensor and its odometry."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from missions.errors import LocalizationError
from missions.lab.localization.grid_map import GridMap
from missions.lab.localization.homing import Moves
from missions.lab.localization.localization_run import Localized
from missions.lab.localization.methods import Method
from missions.lab.localization.neighbourhood import DIRECTIONS, STEP
from missions.lab.localization.noisy_planner import NoisyPlanner
from missions.lab.localization.pose_belief import EXACT, Belief, Noise
from missions.units import Cell

PATIENCE: Final = 50
"""Moves a cell after which a robot gives up."""


@dataclass(frozen=True, slots=True)
class Errors:
    """How a robot errs, and how sure it has to be.

    Args of the constructor outside of their range are a `LocalizationError`.
    """

    noise: Noise = EXACT
    """Of each look at the eight neighbours."""
    slip: float = 0.0
    """Of each move, 0 to 0.9: the probability that it does not happen or goes elsewhere."""
    confidence: float = 0.95
    """The probability of a cell with which a robot is content, 0.5 to 0.9999."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.slip <= 0.9:
            raise LocalizationError(f"slip = {self.slip:g}: expected 0 to 0.9")
        if not 0.5 <= self.confidence <= 0.9999:
            raise LocalizationError(f"confidence = {self.confidence:g}: expected 0.5 to 0.9999")


def localize_with_errors(
    known: GridMap, start: Cell, method: Method, errors: Errors, rng: np.random.Generator
) -> Localized:
    """Put a robot with a map into a cell, and let it go on until it is sure enough.

    It senses its first cell and each cell after a move, and believes by `Belief`. A method is
    shown the neighbours of the most probable cell, which a map makes more reliable than those that
    were sensed. It begins anew when it has no more moves, and when the most probable cell is not
    the one where the last move should have led. `plan` is `NoisyPlanner`.

    Raises:
        KeyError: the start is not on the map.

    >>> from missions.lab.localization.methods import METHODS
    >>> row = GridMap.of({Cell(i, 0) for i in range(6)})
    >>> errors = Errors(Noise(0.05, 0.1), slip=0.02)
    >>> rng = np.random.default_rng(1)
    >>> done = localize_with_errors(row, Cell(2, 0), METHODS["plan"], errors, rng)
    >>> done.right, done.confidence >= 0.95
    (True, True)
    """
    here = known.index[start]
    walk = _Walk(known, method, errors, rng)
    belief = Belief.uniform(known).saw(
        _sensed(known.patterns[here], errors.noise, rng), errors.noise
    )
    moves = 0
    while belief.confidence < errors.confidence:
        if moves >= PATIENCE * known.size:
            return Localized(known.cells[here], None, moves, belief.confidence)
        direction = walk.move(belief)
        here = _landed(known, here, direction, errors.slip, rng)
        moves += 1
        seen = _sensed(known.patterns[here], errors.noise, rng)
        belief = belief.moved(*STEP[direction], errors.slip).saw(seen, errors.noise)
    return Localized(known.cells[here], belief.best, moves, belief.confidence)


class _Walk:
    """A method that goes on, whatever it is shown."""

    def __init__(
        self, known: GridMap, method: Method, errors: Errors, rng: np.random.Generator
    ) -> None:
        self._known, self._method, self._rng = known, method, rng
        self._planner = None
        if method.needs_map:
            self._planner = NoisyPlanner(known, errors.noise, errors.confidence)
        self._moves: Moves | None = None
        self._ahead = -1
        """The cell where the last move should have led."""

    def move(self, belief: Belief) -> int:
        """The next direction."""
        if self._planner is not None:
            return self._planner.move(belief)
        here = belief.number
        direction = self._next(here)
        self._ahead = int(self._known.landings[direction, here])
        return direction

    def _next(self, here: int) -> int:
        """The method's next direction; it begins anew where it has none, or where the robot turns
        out to be elsewhere, and what the method remembers is of another place."""
        pattern = self._known.patterns[here]
        if self._moves is not None and here == self._ahead:
            try:
                return self._moves.send(pattern)
            except StopIteration:
                pass
        self._moves = self._method.start(pattern, None, self._rng)
        return next(self._moves)


def _sensed(pattern: int, noise: Noise, rng: np.random.Generator) -> int:
    """What a sensor makes of a pattern."""
    if noise == EXACT:
        return pattern
    wrong = rng.random(8)
    return sum(
        (bit ^ bool(wrong[i] < (noise.false_negative if bit else noise.false_positive))) << i
        for i in range(8)
        for bit in (pattern >> i & 1,)
    )


def _landed(
    known: GridMap, here: int, direction: int, slip: float, rng: np.random.Generator
) -> int:
    """Where a move ends."""
    if rng.random() < slip:
        wrong = [None, *(d for d in DIRECTIONS if d != direction)][int(rng.integers(4))]
        if wrong is None:
            return here
        direction = wrong
    return int(known.landings[direction, here])
