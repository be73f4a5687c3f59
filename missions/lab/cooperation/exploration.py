"""The record of an exploration: the moves of its team, the map, the observations, and the views."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.lab.cooperation.space import Point, Space, between

_STILL_M: Final = 1e-9
_FEW: Final = 4
_SLACK: Final = 1e-9
_STRAIGHT_RAD: Final = 1e-6


class Why(StrEnum):
    """The purpose of a move."""

    SWEEP = "sweep"
    """It maps new ground."""
    WAY = "way"
    """It leads through known ground, to where the next sweep begins."""


@dataclass(frozen=True, slots=True)
class Move:
    """A robot's way along straight lines, while all others stand still."""

    robot: int
    path: tuple[Point, ...]
    """Points from its first place to its last, in metres; at least two."""
    why: Why

    @property
    def length_m(self) -> float:
        """Length of the path, m."""
        return sum(math.dist(a, b) for a, b in pairwise(self.path))


@dataclass(frozen=True, slots=True)
class Piece:
    """A convex piece of the map, and the move with which it was complete."""

    outline: tuple[Point, ...]
    moves: int


@dataclass(frozen=True, slots=True)
class Figures:
    """An exploration in numbers."""

    path_m: float
    """Path of all robots together, m."""
    known_path_m: float
    """The part of it that leads through known ground."""
    steps: int
    """Moves; one ends where another robot begins. With two robots, exchanges of roles."""
    turns: int
    """Changes of course while sweeping, as the paper counts; entering another stripe is one."""
    corners: int
    """Every change of course of every robot."""
    pieces: int
    """Stripes or triangles of the map."""
    mapped_m2: float
    missed_m2: float


@dataclass(slots=True)
class Exploration:
    """An exploration that is over."""

    space: Space
    range_m: float
    start: Point
    robots: int
    moves: list[Move] = field(default_factory=list)
    pieces: list[Piece] = field(default_factory=list)

    def figures(self) -> Figures:
        """Return path, steps, turns and the map in numbers."""
        mapped = sum(_area(piece.outline) for piece in self.pieces)
        return Figures(
            path_m=sum(move.length_m for move in self.moves),
            known_path_m=sum(m.length_m for m in self.moves if m.why is Why.WAY),
            steps=sum(
                i == 0 or move.robot != self.moves[i - 1].robot for i, move in enumerate(self.moves)
            ),
            turns=sum(_turns(self._moves_of(robot)) for robot in range(self.robots)),
            corners=sum(_corners(self._moves_of(robot)) for robot in range(self.robots)),
            pieces=len(self.pieces),
            mapped_m2=mapped,
            missed_m2=max(self.space.area_m2 - mapped, 0.0),
        )

    def standing(self) -> Iterable[tuple[Move, list[Point]]]:
        """Yield each move, with the place of every robot at its beginning."""
        places = [self.start] * self.robots
        for move in self.moves:
            yield move, list(places)
            places[move.robot] = move.path[-1]

    def _moves_of(self, robot: int) -> list[Move]:
        return [move for move in self.moves if move.robot == robot]


def _area(ring: Sequence[Point]) -> float:
    following = (*ring[1:], ring[0])
    return sum(a[0] * b[1] - b[0] * a[1] for a, b in zip(ring, following, strict=True)) / 2.0


def _courses(moves: Sequence[Move]) -> list[tuple[float, Why]]:
    """Return the bearing of each leg with a length, and its purpose."""
    return [
        (math.atan2(b[1] - a[1], b[0] - a[0]), move.why)
        for move in moves
        for a, b in pairwise(move.path)
        if math.dist(a, b) > _STILL_M
    ]


def turned(one: float, other: float) -> float:
    """Return the angle from one bearing to another, -pi to pi, in radians."""
    return math.remainder(other - one, math.tau)


def _corners(moves: Sequence[Move]) -> int:
    courses = _courses(moves)
    return sum(abs(turned(a, b)) > _STRAIGHT_RAD for (a, _), (b, _) in pairwise(courses))


def _turns(moves: Sequence[Move]) -> int:
    """Return changes of course from sweep to sweep; the way between two sweeps is one turn."""
    turns, last, moved_on = 0, None, False
    for course, why in _courses(moves):
        if why is Why.WAY:
            moved_on = True
            continue
        turns += last is not None and (moved_on or abs(turned(last, course)) > _STRAIGHT_RAD)
        last, moved_on = course, False
    return turns


# --- the ground in sight, from the robots' places alone, whatever the map shows -------------------
def places_of(exploration: Exploration, spacing_m: float) -> NDArray[np.float64]:
    """Return robots' places: the start, ends of legs, and between them at most `spacing_m`
    apart."""
    found = [exploration.start]
    for move in exploration.moves:
        found += [point for point, _ in along(move, spacing_m)]
    return np.unique(np.array(found), axis=0)


def along(move: Move, spacing_m: float) -> Iterator[tuple[Point, bool]]:
    """Yield points along a move, after its first, and True for each end of a leg."""
    for a, b in pairwise(move.path):
        parts = max(int(np.ceil(math.dist(a, b) / spacing_m)), 1)
        for part in range(1, parts + 1):
            yield (b if part == parts else between(a, b, part / parts)), part == parts


def unseen(
    exploration: Exploration, points: NDArray[np.float64], spacing_m: float
) -> NDArray[np.float64]:
    """Return those of the points, shape (n, 2), that were never in range and sight of any robot.

    Robots are checked every `spacing_m` along their ways. So a point may be missed in between, but
    never counted wrongly as seen.
    """
    left = points
    # few points need the many places
    for spacing in (max(exploration.range_m, spacing_m), spacing_m):
        if len(left):
            places = places_of(exploration, spacing)
            left = left[[not _is_seen(exploration, point, places) for point in left]]
    return left


def _is_seen(
    exploration: Exploration, point: NDArray[np.float64], places: NDArray[np.float64]
) -> bool:
    """Return True if a point is in range and sight of one of the places, nearest first."""
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


class Team:
    """The places of the robots, and their actions so far."""

    def __init__(self, space: Space, start: Point, robots: int, range_m: float) -> None:
        self.range_m = range_m
        self.places = [start] * robots
        self.log = Exploration(space, range_m, start, robots)
        self._last = 0

    def move(self, robot: int, way: Sequence[Point], why: Why) -> None:
        """Move a robot along a way; do nothing if it is there already."""
        path = [self.places[robot]]
        for point in way:
            if math.dist(path[-1], point) > 0.0:
                path.append(point)
        if len(path) == 1:
            return
        self.places[robot], self._last = path[-1], robot
        moves = self.log.moves
        if moves and moves[-1].robot == robot and moves[-1].why is why:
            moves[-1] = Move(robot, (*moves[-1].path, *path[1:]), why)
        else:
            moves.append(Move(robot, tuple(path), why))

    def add_piece(self, outline: Sequence[Point]) -> None:
        """Add a piece to the map."""
        self.log.pieces.append(Piece(tuple(outline), len(self.log.moves)))

    def in_turn(self) -> list[int]:
        """Return all robots, the last moved one first: so that continuing is no exchange."""
        return sorted(range(len(self.places)), key=lambda robot: robot != self._last)

    def gather(self, place: Point) -> None:
        """Bring all robots on a line to the one of them that is at `place`.

        The farthest comes first: those between see it pass.
        """
        far = sorted(
            self.in_turn(), key=lambda robot: -round(math.dist(self.places[robot], place), 9)
        )
        for robot in far:
            self.move(robot, [place], Why.WAY)

    def spread(self, rows: Sequence[Point]) -> list[int]:
        """Spread from one place onto a line through it, a robot on each row; return their rows.

        Each row is taken before those behind it: its robot sees the next one pass.
        """
        here = self.places[0]
        order = sorted(range(len(rows)), key=lambda row: math.dist(rows[row], here))
        # the robot that stays is there from the beginning
        if math.dist(rows[order[0]], here) == 0.0:
            order = [*order[1:], order[0]]
        standing = [0] * len(rows)
        for row, robot in zip(order, self.in_turn(), strict=True):
            self.move(robot, [rows[row]], Why.WAY)
            standing[row] = robot
        return standing

    def travel(self, way: Sequence[Point]) -> None:
        """Move all from the first point of a way along the others; each leg is free.

        On legs longer than the range they stop: none is farther from a waiting robot than that.
        """
        for a, b in pairwise(way):
            legs = max(math.ceil(math.dist(a, b) / self.range_m - 1e-9), 1)
            for leg in range(1, legs + 1):
                stop = b if leg == legs else between(a, b, leg / legs)
                for robot in self.in_turn():
                    self.move(robot, [stop], Why.WAY)
