"""Exploration of ground that the range covers: one of two robots follows the walls.

They stand at the ends of an edge and see the unknown ground on one side of it. One of them goes to
a corner that both see: the triangle is mapped. If the next corner along a wall is in sight it is
that one. Edges of triangles with unknown ground behind them are explored depth first. On the way to
one the robots step from triangle to triangle, so that the waiting robot sees the moving one.

The explorer uses only the corners that both see, and the emptiness of the triangle, which they see
as well.
"""

from __future__ import annotations

import heapq
import math
from itertools import count, pairwise

import numpy as np
from numpy.typing import NDArray

from missions.errors import StrategyError
from missions.lab.cooperation.exploration import Exploration, Team, Why
from missions.lab.cooperation.space import GRID_M, Point, Space

Corner = tuple[int, int]
"""Corner in units of `GRID_M`: whole numbers, so that computations are exact."""
Edge = tuple[Corner, Corner]


def explore(space: Space, start: Point, range_m: float) -> Exploration:
    """Explore a ground with two robots; ends when every triangle is mapped.

    Raises `StrategyError` where the range is shorter than the ground is wide.
    """
    if range_m < space.diameter_m:
        raise StrategyError(
            f"triangulation is for areas that the range covers: this one is "
            f"{space.diameter_m:.1f} m wide, the range is {range_m:g} m; use trapezoid, or "
            "a longer range"
        )
    return _Explorer(space, start, range_m).explored()


class _Explorer:
    def __init__(self, space: Space, start: Point, range_m: float) -> None:
        self._space = space
        self._team = Team(space, start, 2, range_m)
        rings = [[_corner(point) for point in ring] for ring in space.rings]
        self._walls = {edge for ring in rings for edge in pairwise([*ring, ring[0]])}
        self._corners = np.array(sorted({c for ring in rings for c in ring}), np.int64)
        self._fronts: list[Edge] = []
        """Edges with unknown ground on their left; the last is explored next."""
        self._known: dict[frozenset[Corner], list[Corner]] = {}
        """Corners opposite an edge in the triangles that have it."""
        self._at: list[Corner] = []

    def explored(self) -> Exploration:
        first = self._first_edge()
        for robot, corner in enumerate(first):
            self._team.move(robot, [_point(corner)], Why.WAY)
        self._at = list(first)
        self._known[frozenset(first)] = []
        self._fronts = [first] if first in self._walls else [(first[1], first[0]), first]
        while self._fronts:
            edge = self._fronts.pop()
            self._go_to(edge)
            self._map(edge, self._apex(edge))
        return self._team.log

    def _first_edge(self) -> Edge:
        """Return a wall that both reach by straight lines and see whole; else a line across the
        ground."""
        start = self._team.places[0]
        every = [(int(x), int(y)) for x, y in self._corners]
        corners = [corner for corner in every if self._space.sees(start, _point(corner))]
        walls = [edge for edge in self._walls if edge[0] in corners and edge[1] in corners]
        lines = [(a, b) for a in corners for b in corners if a < b]
        for edges in (walls, lines):
            edges.sort(key=lambda e: (sum(math.dist(start, _point(c)) for c in e), e))
            for a, b in edges:
                through = _in_triangle(self._corners, a, b, _corner(start))
                if self._space.is_free((start, _point(a), _point(b))) and not through.any():
                    return a, b
        raise AssertionError("from every place some edge is seen")

    def _go_to(self, edge: Edge) -> None:
        """Step from triangle to triangle until the robots stand at the ends of an edge."""
        goal, order = frozenset(edge), count()
        queue: list[tuple[float, int, Edge, tuple[tuple[int, Corner], ...]]] = [
            (0.0, next(order), (self._at[0], self._at[1]), ())
        ]
        done: set[Edge] = set()
        while queue:
            length, _, at, steps = heapq.heappop(queue)
            if frozenset(at) == goal:
                for robot, corner in steps:
                    self._team.move(robot, [_point(corner)], Why.WAY)
                self._at = list(at)
                return
            if at in done:
                continue
            done.add(at)
            for corner in self._known[frozenset(at)]:
                for robot in (0, 1):
                    after = (corner, at[1]) if robot == 0 else (at[0], corner)
                    total = length + math.dist(_point(at[robot]), _point(corner))
                    heapq.heappush(queue, (total, next(order), after, (*steps, (robot, corner))))
        raise AssertionError("triangles hang together")

    def _apex(self, edge: Edge) -> Corner:
        """Return the corner with which an edge makes the next triangle, to its left."""
        a, b = edge
        sides = _cross(a, b, self._corners)
        left = [(int(x), int(y)) for x, y in self._corners[sides > 0]]
        along = [c for c in left if (b, c) in self._walls or (c, a) in self._walls]
        # corners that see the edge under a large angle make triangles that are no slivers
        left.sort(key=lambda c: (_cosine(a, b, c), c))
        along.sort(key=lambda c: (min(_length(b, c), _length(c, a)), c))
        borders = np.array([(*p, *q) for p, q in (*self._walls, *self._fronts)], np.int64)
        for corner in (*along, *left):
            if self._is_new(a, b, corner, borders):
                return corner
        raise AssertionError("unknown ground beside an edge has a triangle there")

    def _is_new(self, a: Corner, b: Corner, c: Corner, borders: NDArray[np.int64]) -> bool:
        """Return True if a triangle is free and unknown: no corner, wall or front is in it."""
        if _in_triangle(self._corners, a, b, c).any():
            return False
        return not (_crossed(a, c, borders).any() or _crossed(b, c, borders).any())

    def _map(self, edge: Edge, c: Corner) -> None:
        """Let one of the two go to the third corner, and take the triangle into the map."""
        a, b = edge
        new = [side for side in ((c, b), (a, c)) if self._is_front(side)]
        # the robot that leaves should not be on the new edge
        if len(new) == 1:
            leaving = a if new[0] == (c, b) else b
        else:
            leaving = a if _length(a, c) <= _length(b, c) else b
            new.sort(key=lambda side: leaving not in side)
        robot = self._at.index(leaving)
        self._team.move(robot, [_point(c)], Why.SWEEP)
        self._at[robot] = c
        for side, opposite in (((a, b), c), ((b, c), a), ((c, a), b)):
            self._known.setdefault(frozenset(side), []).append(opposite)
        self._fronts += new
        self._team.add_piece([_point(corner) for corner in (a, b, c)])

    def _is_front(self, side: Edge) -> bool:
        """Return whether unknown ground lies to the left of a new side; end a front that it
        meets."""
        back = (side[1], side[0])
        if back in self._walls:
            return False
        if back in self._fronts:
            self._fronts.remove(back)
            return False
        return True


def _corner(point: Point) -> Corner:
    return round(point[0] / GRID_M), round(point[1] / GRID_M)


def _point(corner: Corner) -> Point:
    return corner[0] * GRID_M, corner[1] * GRID_M


def _length(a: Corner, b: Corner) -> float:
    return math.dist(_point(a), _point(b))


def _cosine(a: Corner, b: Corner, c: Corner) -> float:
    ax, ay, bx, by = a[0] - c[0], a[1] - c[1], b[0] - c[0], b[1] - c[1]
    return float((ax * bx + ay * by) / (_length(a, c) * _length(b, c)))


def _cross(a: Corner, b: Corner, points: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return positive numbers for points to the left of the line from a to b."""
    return np.asarray(
        (b[0] - a[0]) * (points[:, 1] - a[1]) - (b[1] - a[1]) * (points[:, 0] - a[0]), np.int64
    )


def _in_triangle(points: NDArray[np.int64], a: Corner, b: Corner, c: Corner) -> NDArray[np.bool_]:
    """Return which points lie in a triangle, its sides included and its corners not, in any
    direction."""
    sides = np.stack([_cross(a, b, points), _cross(b, c, points), _cross(c, a, points)])
    inside = (sides >= 0).all(axis=0) | (sides <= 0).all(axis=0)
    corners = np.array([a, b, c])  # one without area holds only the points between its ends
    inside &= ((points >= corners.min(axis=0)) & (points <= corners.max(axis=0))).all(axis=1)
    own = np.zeros(len(points), bool)
    for corner in (a, b, c):
        own |= (points == np.array(corner)).all(axis=1)
    return np.asarray(inside & ~own)


def _crossed(a: Corner, b: Corner, borders: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which borders cross the segment from a to b, beyond touching."""
    p, q = borders[:, :2], borders[:, 2:]
    beside = np.sign(_cross(a, b, p)) * np.sign(_cross(a, b, q)) < 0
    across = q - p
    side_a = across[:, 0] * (a[1] - p[:, 1]) - across[:, 1] * (a[0] - p[:, 0])
    side_b = across[:, 0] * (b[1] - p[:, 1]) - across[:, 1] * (b[0] - p[:, 0])
    return np.asarray(beside & (np.sign(side_a) * np.sign(side_b) < 0))
