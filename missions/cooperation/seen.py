"""What was seen of the ground, by the robots' places alone, whatever the map says."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.cooperation.exploration import Exploration, Move
from missions.cooperation.space import Point, between, distance

_AT_ONCE: Final = 200_000
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
        parts = max(int(np.ceil(distance(a, b) / spacing_m)), 1)
        for part in range(1, parts + 1):
            yield (b if part == parts else between(a, b, part / parts)), part == parts


def unseen(
    exploration: Exploration, points: NDArray[np.float64], spacing_m: float
) -> NDArray[np.float64]:
    """Those of the points, of shape (n, 2), that were never within range and sight of any robot.

    Robots are looked at every `spacing_m` along their ways: a point may be missing from sight only
    in between, never the other way round.
    """
    places = places_of(exploration, spacing_m)
    left = np.arange(len(points))
    # the nearest place that is in range sees most points; the rest of them few are left for
    squares = [((places - point) ** 2).sum(axis=1) for point in points]
    order = [np.argsort(square) for square in squares]
    most = exploration.range_m**2 * (1.0 + _SLACK)
    done, wide = 0, 1
    while len(left) and done < len(places):
        pairs = [
            (i, j) for i in left for j in order[i][done : done + wide] if squares[i][j] <= most
        ]
        if not pairs:
            break
        rows, columns = np.array(pairs).T
        seen = np.zeros(len(points), bool)
        for first in range(0, len(rows), _AT_ONCE):
            some = slice(first, first + _AT_ONCE)
            free = exploration.space.sees_all(points[rows[some]], places[columns[some]])
            seen[rows[some][free]] = True
        left = left[~seen[left]]
        done, wide = done + wide, wide * 4
    return np.asarray(points[left])


def unwatched(exploration: Exploration, spacing_m: float) -> list[tuple[Move, Point]]:
    """Where a robot was that moved, and no standing one had it within range and sight.

    Looked at every `spacing_m` along the ways, and at the ends of legs.
    """
    found = []
    most_m = exploration.range_m * (1.0 + _SLACK)
    for move, standing in exploration.standing():
        others = [place for robot, place in enumerate(standing) if robot != move.robot]
        for point, _ in along(move, spacing_m):
            near = sorted(others, key=lambda place: distance(place, point))
            if not any(
                distance(place, point) <= most_m and exploration.space.sees(place, point)
                for place in near
            ):
                found.append((move, point))
    return found
