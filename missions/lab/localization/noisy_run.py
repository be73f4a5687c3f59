"""A robot that does not know where it is, on a grid, with errors of its sensor and its odometry.

A planner for a robot whose sensor and odometry err: moves after which its belief is sharper.

It considers some cells, the more probable ones first. The number of neighbours in which two of them
differ along a way distinguishes them. After each such neighbour the probability to confuse them is
smaller by a factor, the Bhattacharyya coefficient of the two readings. All ways of `AHEAD` moves
and straight ways as long as the grid are tried in all these cells at once. The best needs the
fewest moves, together with the expected ones after it. If none helps, the robot takes the shortest
way after which the two most probable cells look different. It follows the way to its end, or until
the doubt has shrunk by a third; then it plans everything anew. There is no bound.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.errors import LocalizationError
from missions.lab.localization.grid_map import DIRECTIONS, EAST, NORTH, SOUTH, STEP, WEST, GridMap
from missions.lab.localization.homing import Moves
from missions.lab.localization.localization_run import Localized, Method
from missions.units import Cell

ALL: Final = 0xFF
"""All eight neighbours, as a mask."""
_EVERY: Final = np.arange(256, dtype=np.uint8)
MAX_RATE: Final = 0.49
"""A sensor that errs in half of all cases has no information."""


@dataclass(frozen=True, slots=True)
class Noise:
    """The error rate of a sensor, about each neighbour independently of the others.

    A positive is an unobstructed cell, a cell of the region. Both rates are 0 to `MAX_RATE`, or
    `LocalizationError` names the wrong one.
    """

    false_positive: float = 0.0
    """Share of obstructed cells that are taken for unobstructed ones."""
    false_negative: float = 0.0
    """Share of unobstructed cells that are taken for obstructed ones."""

    def __post_init__(self) -> None:
        for name in ("false_positive", "false_negative"):
            value = getattr(self, name)
            if not 0.0 <= value <= MAX_RATE:
                raise LocalizationError(f"{name} = {value:g}: expected 0 to {MAX_RATE}")

    def likelihoods(self, seen: int, judged: int = ALL) -> NDArray[np.float64]:
        """Return the likelihood of the pattern `seen` if each of the 256 patterns is the truth.

        Only neighbours in the mask `judged` were sensed.
        """
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
    """The probability of each cell of a map to be the one: a histogram filter.

    A value: every change makes a new one. With right error rates, and errors that are independent
    of each other, 95 % of all answers with 95 % confidence are right.

    >>> row = GridMap.from_cells({Cell(i, 0) for i in range(4)})
    >>> belief = Belief.uniform(row).saw(row.patterns[1], Noise(0.05, 0.1))
    >>> belief.best, round(belief.confidence, 3)
    (Cell(east=1, north=0), 0.474)
    >>> belief = belief.moved(-1, 0, slip=0.02).saw(row.patterns[0], Noise(0.05, 0.1))
    >>> belief.best, round(belief.confidence, 3)
    (Cell(east=0, north=0), 0.902)
    """

    known: GridMap
    mass: NDArray[np.float64]
    """Probability of each cell, in the order of the map; the sum is 1."""

    @classmethod
    def uniform(cls, known: GridMap) -> Belief:
        """Begin with the map alone."""
        return cls(known, np.full(known.size, 1.0 / known.size))

    def moved(self, dx: int, dy: int, slip: float = 0.0) -> Belief:
        """Return the belief after a move of `dx` cells east and `dy` north, east first.

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
        """Return the belief after an observation of `neighbours`; `judged` is the sensed mask.

        `own`: True if the cell itself looks unobstructed, for an aircraft, which may be beside the
        region; None if that was not sensed. Raises `LocalizationError` if no cell fits: the map is
        of another place, or the sensor errs more often than `noise` states.
        """
        mass = self.mass * noise.likelihoods(neighbours, judged)[self.known.pattern_array]
        if own is not None:
            free = np.array(self.known.own)
            fp, fn = noise.false_positive, noise.false_negative
            mass = mass * (np.where(free, 1.0 - fn, fp) if own else np.where(free, fn, 1.0 - fp))
        total = float(mass.sum())
        if not total > 0.0:
            raise LocalizationError(
                "the observation fits no cell of the map that is still possible: the map is of "
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


QUANTILES: Final = 40
"""Quantiles of the belief whose cells are considered."""
MAX_PROBABLE_CELLS: Final = 8
"""Further cells that are considered."""
AHEAD: Final = 3
"""Length of the ways that are all tried, moves."""
MIN_GAIN: Final = 0.1
"""Expected moves: a way that saves fewer does not help."""
NEWS: Final = 2 / 3
"""Share of the doubt at planning below which a new way is planned."""
MOVES_A_HALVING: Final = 1.0
"""Expected moves for each halving of the doubt that is left."""

Doubts = NDArray[np.float64]
"""Probability of each way and pair of hypotheses that one is taken for the other."""


class NoisyPlanner:
    """Plans for one robot with a map, up to a wanted confidence below 1."""

    def __init__(self, known: GridMap, noise: Noise, confidence: float) -> None:
        self._known = known
        fp, fn = noise.false_positive, noise.false_negative
        alike = math.sqrt(fp * (1.0 - fn)) + math.sqrt(fn * (1.0 - fp))
        self._factors = alike ** np.arange(9.0)
        self._enough = 1.0 - confidence
        self._longest = max(known.width, known.height)
        self._way: list[int] = []
        self._doubt = 1.0

    def move(self, belief: Belief) -> int:
        """Return the direction to go next."""
        doubt = 1.0 - float((belief.mass**2).sum())
        if not self._way or doubt < NEWS * self._doubt:
            self._way, self._doubt = self._planned(belief), doubt
        return self._way.pop(0)

    def _planned(self, belief: Belief) -> list[int]:
        places, weights = self._hypotheses(belief.mass)
        doubts = np.outer(weights, weights)
        np.fill_diagonal(doubts, 0.0)
        best, ways, at = self._straight(doubts, places), doubts[None], places[None]
        for length in range(1, AHEAD + 1):
            directions = np.tile(DIRECTIONS, len(at))
            at = self._known.landings[directions, np.repeat(at, 4, axis=0).T].T
            ways = np.repeat(ways, 4, axis=0) * self._distinction(at)
            value, number = self._best(ways, length)
            if value < best[0]:
                best = (value, [number // 4**i % 4 for i in reversed(range(length))])
        reckoned = best[0] - len(best[1])
        if reckoned < self._best(doubts[None], 0)[0] - MIN_GAIN:
            return best[1]
        first, second = np.argsort(-belief.mass, kind="stable")[:2]
        return self._distinguishing_way(int(first), int(second))

    def _distinguishing_way(self, first: int, second: int) -> list[int]:
        """Return the shortest way after which two cells look different."""
        landings, patterns = self._known.landings, self._known.patterns
        met = {(first, second)}
        rim: list[tuple[int, int, list[int]]] = [(first, second, [])]
        for one, other, way in rim:  # grows on the way
            for d in DIRECTIONS:
                pair = (int(landings[d, one]), int(landings[d, other]))
                if patterns[pair[0]] != patterns[pair[1]]:
                    return [*way, d]
                if pair not in met and pair[0] != pair[1]:
                    met.add(pair)
                    rim.append((*pair, [*way, d]))
        raise AssertionError("no finite grid has two cells that look alike after all ways")

    def _hypotheses(
        self, mass: NDArray[np.float64]
    ) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        """Return cells to weigh: quantiles, for many that are alike, and the most probable ones."""
        middles = (np.arange(QUANTILES) + 0.5) / QUANTILES
        drawn = np.minimum(np.searchsorted(mass.cumsum(), middles), len(mass) - 1)
        weights = np.bincount(drawn, minlength=len(mass)) / QUANTILES
        first = np.argsort(-mass, kind="stable")[:MAX_PROBABLE_CELLS]
        weights[first] = np.maximum(weights[first], mass[first])
        places = np.flatnonzero(weights)
        return places, weights[places] / weights[places].sum()

    def _straight(self, doubts: Doubts, places: NDArray[np.intp]) -> tuple[float, list[int]]:
        best = (math.inf, [0])
        directions = np.array(DIRECTIONS, np.intp)
        ways, at = np.repeat(doubts[None], 4, axis=0), np.repeat(places[None], 4, axis=0)
        for length in range(1, self._longest + 1):
            if length >= best[0]:
                break
            at = self._known.landings[directions[:, None], at]
            ways = ways * self._distinction(at)
            value, direction = self._best(ways, length)
            if value < best[0]:
                best = (value, [direction] * length)
        return best

    def _distinction(self, at: NDArray[np.intp]) -> Doubts:
        """Return the factors of the doubts by observations in these places, way by way."""
        patterns = self._known.pattern_array[at]
        factors: Doubts = self._factors[
            np.bitwise_count(patterns[:, :, None] ^ patterns[:, None, :])
        ]
        return factors

    def _best(self, ways: Doubts, length: int) -> tuple[float, int]:
        """Return the moves to certainty by the way with the least doubt, and its number."""
        left = ways.sum(axis=(1, 2))
        least = int(left.argmin())
        more = math.log2(max(float(left[least]) / self._enough, 1.0))
        return length + MOVES_A_HALVING * more, least


PATIENCE: Final = 50
"""Moves for each cell after which a robot gives up."""


@dataclass(frozen=True, slots=True)
class Errors:
    """The errors of a robot, and the certainty that it needs. Raises `LocalizationError` beyond the
    ranges."""

    noise: Noise = EXACT
    slip: float = 0.0
    """Probability that a move does not happen or goes elsewhere, 0 to 0.9."""
    confidence: float = 0.95
    """Probability of a cell that is enough for the robot, 0.5 to 0.9999."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.slip <= 0.9:
            raise LocalizationError(f"slip = {self.slip:g}: expected 0 to 0.9")
        if not 0.5 <= self.confidence <= 0.9999:
            raise LocalizationError(f"confidence = {self.confidence:g}: expected 0.5 to 0.9999")


def localize_with_errors(
    known: GridMap, start: Cell, method: Method, errors: Errors, rng: np.random.Generator
) -> Localized:
    """Put a robot with a map into a cell, and let it move until it is certain enough.

    It senses its first cell and each cell after a move, and believes by `Belief`. A method gets the
    neighbours of the most probable cell, which a map makes more reliable than the sensed ones. It
    begins anew when it has no more moves, and when the most probable cell is not the expected one
    after the last move. `plan` is `NoisyPlanner`. Raises KeyError for a start off the map.
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
    """A method that continues, whatever it senses."""

    def __init__(
        self, known: GridMap, method: Method, errors: Errors, rng: np.random.Generator
    ) -> None:
        self._known, self._method, self._rng = known, method, rng
        self._planner = None
        if method.needs_map:
            self._planner = NoisyPlanner(known, errors.noise, errors.confidence)
        self._moves: Moves | None = None
        self._ahead = -1
        """The expected cell after the last move."""

    def move(self, belief: Belief) -> int:
        """Return the next direction."""
        if self._planner is not None:
            return self._planner.move(belief)
        here = belief.number
        direction = self._next(here)
        self._ahead = int(self._known.landings[direction, here])
        return direction

    def _next(self, here: int) -> int:
        """Return the method's next direction; it begins anew without one, or at another place."""
        pattern = self._known.patterns[here]
        if self._moves is not None and here == self._ahead:
            try:
                return self._moves.send(pattern)
            except StopIteration:
                pass
        self._moves = self._method.start(pattern, None, self._rng)
        return next(self._moves)


def _sensed(pattern: int, noise: Noise, rng: np.random.Generator) -> int:
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
    if rng.random() < slip:
        wrong = [None, *(d for d in DIRECTIONS if d != direction)][int(rng.integers(4))]
        if wrong is None:
            return here
        direction = wrong
    return int(known.landings[direction, here])
