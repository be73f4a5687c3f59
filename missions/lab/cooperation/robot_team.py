"""Robots of which one moves at a time: the moves that all explorations are made of."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from missions.lab.cooperation.exploration import Exploration, Move, Piece, Why
from missions.lab.cooperation.space import Point, Space, between


class Team:
    """Where the robots stand, and what they did so far."""

    def __init__(self, space: Space, start: Point, robots: int, range_m: float) -> None:
        self.range_m = range_m
        self.places = [start] * robots
        self.log = Exploration(space, range_m, start, robots)
        self._last = 0

    def move(self, robot: int, way: Sequence[Point], why: Why) -> None:
        """Let a robot go along a way; nothing happens where it stands there already."""
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

    def mapped(self, outline: Sequence[Point]) -> None:
        """Add a piece to the map."""
        self.log.pieces.append(Piece(tuple(outline), len(self.log.moves)))

    def in_turn(self) -> list[int]:
        """All robots, who moved last first: so that going on is no exchange."""
        return sorted(range(len(self.places)), key=lambda robot: robot != self._last)

    def gather(self, place: Point) -> None:
        """Bring all, who stand on a line, to the one of them that stands at `place`.

        The farthest comes first: those between see it pass.
        """
        far = sorted(
            self.in_turn(), key=lambda robot: -round(math.dist(self.places[robot], place), 9)
        )
        for robot in far:
            self.move(robot, [place], Why.WAY)

    def spread(self, rows: Sequence[Point]) -> list[int]:
        """From one place onto a line through it, a robot on each row; returns who stands on which.

        Each row is taken before those behind it: who stands there sees the next one pass.
        """
        here = self.places[0]
        order = sorted(range(len(rows)), key=lambda row: math.dist(rows[row], here))
        if math.dist(rows[order[0]], here) == 0.0:  # who stays is there from the beginning
            order = [*order[1:], order[0]]
        standing = [0] * len(rows)
        for row, robot in zip(order, self.in_turn(), strict=True):
            self.move(robot, [rows[row]], Why.WAY)
            standing[row] = robot
        return standing

    def travel(self, way: Sequence[Point]) -> None:
        """All from the first point of a way along the others, each leg of which is free.

        On legs longer than the range they stop: nobody is farther from a standing robot than that.
        """
        for a, b in pairwise(way):
            legs = max(math.ceil(math.dist(a, b) / self.range_m - 1e-9), 1)
            for leg in range(1, legs + 1):
                stop = b if leg == legs else between(a, b, leg / legs)
                for robot in self.in_turn():
                    self.move(robot, [stop], Why.WAY)
