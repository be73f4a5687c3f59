"""A planner with a map: the moves after which the fewest candidates are left, as soon as possible.

All candidates sense the same, so a sequence of moves is possible in all of them or in none. They
*split* when they sense different things. The planner searches the nearest splits, breadth first
over the places that all candidates reach alike, and the expected moves to certainty after each. For
a few candidates (`EXACT`) it finds the least of all plans. For more it looks ahead to some depth
(`LOOK_AHEAD`), beyond which it assumes a number of moves for each halving. It plans anew after each
split.

Every set of candidates splits somewhere. Two that never do would make the grid equal to itself
moved by their distance, which no finite grid is.

**The guarantee.** On a map of n cells the Homing Robot needs at most h = (n - b) + 3/2 c moves from
any cell (Lemma 1). There are b boundary cells, c moves around all obstacles, and h <= 4 n (Lemma
5). The planner continues while its moves, those to the next split, and h are at most 4 n together.
Then the Homing Robot takes over. So it never takes more than 4 n moves.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from missions.lab.localization.grid_map import (
    Candidates,
    GridMap,
    candidates_after,
    first_candidates,
    split,
)
from missions.lab.localization.homing import Moves, homing

EXACT: Final = 2
"""Maximum number of candidates for the best of all plans; more take too long on large maps."""
LOOK_AHEAD: Final = ((300, 3), (1500, 2))
"""Pairs of a maximum number of candidates, and of splits to look ahead; one split beyond."""
BREADTH: Final = 4
"""Maximum number of splits at one distance that are considered for more candidates."""
MOVES_A_HALVING: Final = 0.7
"""Assumed moves beyond: found on grown regions of 120 and 500 cells."""
MAX_KEPT: Final = 200_000
"""Maximum number of remembered values."""

Way = tuple[int, ...]
"""Directions, one after the other."""


def homing_bound(known: GridMap) -> int:
    """Return the most moves of the Homing Robot from any cell (Lemma 1); never above 4 n."""
    return known.labels[0] + 3 * known.circumnavigation // 2


class Planner:
    """Plans for one map, remembered for many robots.

    For up to `exact` candidates it finds the best of all plans; beyond some hundred cells that
    takes too long for all.
    """

    def __init__(self, known: GridMap, exact: int = EXACT) -> None:
        self.known = known
        self._exact = exact
        self.homing_bound = homing_bound(known)
        self._values: dict[tuple[Candidates, int], tuple[float, Way]] = {}

    def way(self, candidates: Candidates) -> Way:
        """Return the moves to the split that is best for candidates of which there are several."""
        return self._best(candidates, _depth(candidates))[1]

    def expected_moves(self) -> float:
        """Estimated mean of the moves to certainty over all starts.

        It is exact if at most `exact` cells look alike.
        """
        alike = self.known.alike.values()
        return sum(self._best(c, _depth(c))[0] for c in alike) / self.known.size

    def _best(self, candidates: Candidates, depth: int) -> tuple[float, Way]:
        """Return moves to certainty, summed over the candidates, and the first of them.

        Up to `exact` candidates it is the least of all plans, at any depth.
        """
        size = len(candidates)
        if size == 1:
            return 0.0, ()
        if size <= self._exact:
            depth = 1
        elif depth == 0:
            return _reckoned(candidates), ()
        kept = self._values.get((candidates, depth))
        if kept is None:
            kept = self._searched(candidates, depth)
            if len(self._values) < MAX_KEPT:
                self._values[candidates, depth] = kept
        return kept

    def _searched(self, candidates: Candidates, depth: int) -> tuple[float, Way]:
        """Search by branch and bound: candidates that are not alone need one more move at least."""
        size = len(candidates)
        best: tuple[float, Way] = (math.inf, ())
        met = {candidates}
        rim: list[tuple[Candidates, Way]] = [(candidates, ())]
        length = 1
        while rim and length * size < best[0]:
            splits, rim = self._moved_on(rim, met)
            splits.sort(key=lambda s: s[0])
            for _, way, groups in splits if size <= self._exact else splits[:BREADTH]:
                best = min(best, (self._sum(groups, size * length, best[0], depth - 1), way))
            length += 1
        return best

    def _sum(self, groups: list[Candidates], moves: float, limit: float, depth: int) -> float:
        """Return moves so far plus those of all groups after them; infinite from the limit on."""
        open_groups = sorted((group for group in groups if len(group) > 1), key=len)
        least = sum(map(len, open_groups))
        for group in open_groups:
            if moves + least >= limit:
                return math.inf
            least -= len(group)
            moves += self._best(group, depth)[0]
        return moves

    def _moved_on(
        self, rim: list[tuple[Candidates, Way]], met: set[Candidates]
    ) -> tuple[list[tuple[float, Way, list[Candidates]]], list[tuple[Candidates, Way]]]:
        """Move on from the rim; return the splits, with their estimated rests, and the new rim."""
        splits: list[tuple[float, Way, list[Candidates]]] = []
        outer: list[tuple[Candidates, Way]] = []
        for here, way in rim:
            for d, step in enumerate(self.known.steps):
                if step[here[0]] < 0:
                    continue
                groups = split(self.known, here, d)
                if len(groups) > 1:
                    splits.append((sum(map(_reckoned, groups)), (*way, d), groups))
                elif groups[0] not in met:
                    met.add(groups[0])
                    outer.append((groups[0], (*way, d)))
        return splits, outer


def _depth(candidates: Candidates) -> int:
    return next((depth for most, depth in LOOK_AHEAD if len(candidates) <= most), 1)


def _reckoned(candidates: Candidates) -> float:
    """Return estimated moves to certainty, summed over the candidates."""
    return MOVES_A_HALVING * len(candidates) * math.log2(len(candidates))


def plan(pattern: int, planner: Planner, notify: Callable[[], None] | None = None) -> Moves:
    """Move as planned; as the Homing Robot once no more than its bound is left of 4 n moves.

    `pattern` is sensed at first; `notify` is called when the Homing Robot takes over.
    """
    known = planner.known
    candidates = first_candidates(known, pattern)
    spare = 4 * known.size - planner.homing_bound
    while len(candidates) > 1:
        way = planner.way(candidates)
        if len(way) > spare:
            if notify is not None:
                notify()
            yield from homing(pattern)
        spare -= len(way)
        for direction in way:
            pattern = yield direction
            candidates = candidates_after(known, candidates, direction, pattern)
