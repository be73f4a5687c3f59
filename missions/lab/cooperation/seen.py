"""What was seen of the ground, by the robots' places alone, whatever the map says."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.lab.cooperation.exploration import Exploration, Move
from missions.lab.cooperation.space import Point, between

_FEW: Final = 4
_SLACK: Final = 1e-9


def places_of(exploration: Exploration, spacing_m: float) -> NDArray[np.float64]:
    """Where robots were: the start, ends of legs, and between them at most `spacing_m` apart."""
    found = [exploration.start]
    for move in exploration.moves:
        found += [point for point, _ in along(move, spacing_m)]
    return np.unique(np.array(found), axis=0)


def along(move: Move, spacing_m: float) -> Iterator[tuple[Point, bool]]:
    """Points along a move, after its first, and whether each is the end of a leg."""
    for a, b in pairwise(move.path):
        parts = max(int(np.ceil(math.dist(a, b) / spacing_m)), 1)
        for part in range(1, parts + 1):
            yield (b if part == parts else between(a, b, part / parts)), part == parts


def unseen(
    exploration: Exploration, points: NDArray[np.float64], spacing_m: float
) -> NDArray[np.float64]:
    """Those of the points, of shape (n, 2), that were never within range and sight of any robot.

    Robots are looked at every `spacing_m` along their ways: a point may be missing from sight only
    in between, never the other way round.
    """
    left = points
    for spacing in (max(exploration.range_m, spacing_m), spacing_m):  # few need the many places
        if len(left):
            places = places_of(exploration, spacing)
            left = left[[not _is_seen(exploration, point, places) for point in left]]
    return left


def _is_seen(
    exploration: Exploration, point: NDArray[np.float64], places: NDArray[np.float64]
) -> bool:
    """Whether a point is in sight of one of the places within the range, the nearest first."""
    squares = ((places - point) ** 2).sum(axis=1)
    near = np.flatnonzero(squares <= exploration.range_m**2 * (1.0 + _SLACK))
    near = near[np.argsort(squares[near], kind="stable")]
    first, many = 0, _FEW
    while first < len(near):
        some = places[near[first : first + many]]
        if exploration.space.sees_all(np.broadcast_to(point, some.shape), some).any():
            return True
        first, many = first + many, many * 8
    return False
