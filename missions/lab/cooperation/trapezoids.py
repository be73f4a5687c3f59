"""Exploration in stripes: the trapezoid decomposition, found during the sweep.

Robots stand on rows between the floor and the ceiling of a stripe, and pass each other in turns:
those of every other row wait and observe, the others move on as far as they are seen. With two
robots on two rows each move covers a triangle, or a diamond; more robots are a column. The stripes
are explored depth first.

The explorer uses only ground in sight of a waiting robot. It knows floor and ceiling within the
range of the observer, and doors on the line along which a robot went. A stripe is read only when
robots are in it. Its ends count when they are within the range, its doors when it is swept.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import count
from typing import Final

from missions.errors import StrategyError
from missions.lab.cooperation.exploration import Exploration, Team, Why
from missions.lab.cooperation.space import Point, Space
from missions.lab.cooperation.stripes import Door, Stripe, stripes_of

MAX_MOVES: Final = 100_000
"""Maximum number of moves, by a rough estimate from area and range."""
_SAME_M: Final = 1e-9
_STEPS: Final = 60


class Cover(StrEnum):
    """The area that a move of one of two robots covers."""

    TRIANGLES = "triangles"
    DIAMONDS = "diamonds"


@dataclass(frozen=True, slots=True)
class Pattern:
    """The pattern of sweeping stripes.

    `theta_rad`, between 0 and pi, both excluded, is the angle of a move in the observer's view. A
    larger one makes fewer moves and lower stripes.

    >>> round(Pattern(10.0, math.radians(60.0)).height_m, 3)
    8.66
    """

    range_m: float
    theta_rad: float
    robots: int = 2
    cover: Cover = Cover.TRIANGLES

    @property
    def row_m(self) -> float:
        """Distance between two rows at the full height of the stripe, m."""
        return self.range_m * math.cos(self.theta_rad / 2.0)

    @property
    def move_m(self) -> float:
        """Distance that a robot gets ahead of its observer at the full height of the stripe, m."""
        return self.range_m * math.sin(self.theta_rad / 2.0)

    @property
    def height_m(self) -> float:
        """Height of a stripe, m."""
        return self.range_m if self.cover is Cover.DIAMONDS else (self.robots - 1) * self.row_m

    def rows(self, stripe: Stripe, x: float) -> list[Point]:
        """Return the places of robots in a stripe, from south to north."""
        low, high = stripe.span(x)
        if self.cover is Cover.DIAMONDS:
            # the tips of a stripe lie between the rows of the next
            margin = (self.range_m - self.row_m) / 2.0
            south = min(max(low, stripe.bottom + margin), high)
            north = max(min(high, stripe.top - margin), low)
            return [(x, south), (x, max(south, north))]
        last = self.robots - 1
        return [(x, low + (high - low) * row / last) for row in range(self.robots)]


def explore(space: Space, start: Point, pattern: Pattern) -> Exploration:
    """Explore a ground from a place in it; ends when every stripe is swept.

    Raises `StrategyError` where the range is so short that more than `MAX_MOVES` would be needed.
    """
    south, north = space.edges[:, 1].min(), space.edges[:, 1].max()
    layers = (north - south) / pattern.height_m
    moves = space.area_m2 / (pattern.range_m * pattern.move_m)
    if max(layers, moves) > MAX_MOVES:
        raise StrategyError(
            f"a range of {pattern.range_m:g} m takes more than {MAX_MOVES} moves in this area; "
            "give a longer one, or a larger theta"
        )
    return _Explorer(space, start, pattern).explored()


class _Explorer:
    def __init__(self, space: Space, start: Point, pattern: Pattern) -> None:
        self._pattern = pattern
        self._space = space
        self._stripes = stripes_of(space, start[1], pattern.height_m)
        self._team = Team(space, start, pattern.robots, pattern.range_m)
        self._swept: set[int] = set()

    def explored(self) -> Exploration:
        """Explore depth first: from the last swept stripe on, while it has a door to new ground."""
        start = self._team.places[0]
        here = max(
            (stripe for stripe in self._stripes if stripe.holds(start)),
            key=lambda stripe: (stripe.bottom, -stripe.number),
        )
        self._sweep(here, start)
        branch = [here]
        while branch:
            new = [door for door in branch[-1].doors if door.other not in self._swept]
            if not new:
                branch.pop()
                continue
            way, behind = min(
                (self._way(here, place, branch[-1], door), door.other)
                for door in new
                for place in self._team.places
            )
            self._team.gather(way[1][0])
            self._team.travel(way[1])
            here = self._stripes[behind]
            self._sweep(here, way[1][-1])
            branch.append(here)
        return self._team.log

    def _way(
        self, here: Stripe, place: Point, last: Stripe, door: Door
    ) -> tuple[float, tuple[Point, ...]]:
        """Return the shortest way through swept stripes to a door of one of them, and its
        length."""
        if here is last:
            point = _nearest(door, place)
            return math.dist(place, point), (place, point)
        order = count()
        queue: list[tuple[float, int, int, tuple[Point, ...]]] = [
            (0.0, next(order), here.number, (place,))
        ]
        done: set[tuple[int, Point]] = set()
        while queue:
            length, _, number, way = heapq.heappop(queue)
            if number < 0:
                return length, way
            if (number, way[-1]) in done:
                continue
            done.add((number, way[-1]))
            stripe = self._stripes[number]
            if stripe is last:
                point = _nearest(door, way[-1])
                total = length + math.dist(way[-1], point)
                heapq.heappush(queue, (total, next(order), -1, (*way, point)))
            for through in stripe.doors:
                if through.other in self._swept:
                    for point in (through.a, through.b):
                        total = length + math.dist(way[-1], point)
                        heapq.heappush(queue, (total, next(order), through.other, (*way, point)))
        raise AssertionError("swept stripes hang together")

    def _sweep(self, stripe: Stripe, entry: Point) -> None:
        """Sweep a stripe from a place in it, where all robots are, to both ends."""
        ends = [x for x in (stripe.x0, stripe.x1) if abs(x - entry[0]) > _SAME_M]
        # an end that is in sight comes first where it is the nearer one
        seen = [x for x in ends if abs(x - entry[0]) <= self._pattern.range_m]
        ends.sort(key=lambda x: (abs(x - entry[0]) if x in seen else math.inf, x))
        for number, end in enumerate(ends):
            if number:
                back = min(self._team.places, key=lambda place: math.dist(place, entry))
                self._team.gather(back)
                self._team.travel([back, entry])
            self._go(stripe, entry[0], end)
        self._swept.add(stripe.number)
        self._team.add_piece(stripe.outline())

    def _go(self, stripe: Stripe, x: float, end: float) -> None:
        standing = self._team.spread(self._pattern.rows(stripe, x))
        stops = [end]
        if self._pattern.robots > 2:  # rows are to be straight between two stops
            between = [b for b in stripe.bends() if min(x, end) < b < max(x, end)]
            stops = [*(between if end > x else between[::-1]), end]
        for stop in stops:
            self._pass(stripe, standing, x, stop)
            x = stop

    def _pass(self, stripe: Stripe, standing: Sequence[int], x: float, stop: float) -> None:
        """Move every other row while the rows between observe, in turns, until all are at
        `stop`."""
        at = [x, x]
        moving = standing.index(self._team.in_turn()[0]) % 2
        while at != [stop, stop]:
            target = self._reach(stripe, at[1 - moving], stop, moving)
            rows = self._pattern.rows(stripe, target)
            for row in range(moving, len(rows), 2):
                self._team.move(
                    standing[row], self._leg(stripe, standing, row, rows[row]), Why.SWEEP
                )
            at[moving] = target
            moving = 1 - moving

    def _reach(self, stripe: Stripe, x: float, stop: float, moving: int) -> float:
        """Return the reach of the moving rows, up to `stop`, in sight of those at x."""
        watching = self._pattern.rows(stripe, x)

        def too_far(target: float) -> float:
            """Return the excess over the range, m."""
            rows = self._pattern.rows(stripe, target)
            return max(
                math.dist(watching[row], rows[beside]) - self._pattern.range_m
                for row in range(1 - moving, len(rows), 2)
                for beside in range(max(row - 1, 0), min(row + 2, len(rows)))
            )

        # no robot is seen farther ahead than the range
        far = (
            stop
            if abs(stop - x) < self._pattern.range_m
            else (x + math.copysign(self._pattern.range_m, stop - x))
        )
        beyond = too_far(far)
        if beyond <= 0.0:
            return far
        near, within, last = x, too_far(x), 0.0
        # regula falsi, after Illinois: an end that stays twice counts half
        for _ in range(_STEPS):
            middle = (near * beyond - far * within) / (beyond - within)
            found = too_far(middle)
            if -_SAME_M < found <= 0.0:
                return middle
            again = found * last > 0.0
            if found > 0.0:
                far, beyond = middle, found
                within /= 2.0 if again else 1.0
            else:
                near, within = middle, found
                beyond /= 2.0 if again else 1.0
            last = found
        return near

    def _leg(
        self, stripe: Stripe, standing: Sequence[int], row: int, target: Point
    ) -> tuple[Point, ...]:
        here = self._team.places[standing[row]]
        if self._pattern.cover is Cover.TRIANGLES:
            return (target,)
        watch = self._team.places[standing[1 - row]]
        if not min(here[0], target[0]) + _SAME_M < watch[0] < max(here[0], target[0]) - _SAME_M:
            return (target,)
        tip = (watch[0], watch[1] + self._pattern.range_m * (1.0 if row else -1.0))
        free = all(self._space.is_free((watch, tip, side)) for side in (here, target))
        return (tip if free else (watch[0], stripe.span(watch[0])[row]), target)


def _nearest(door: Door, place: Point) -> Point:
    (ax, ay), (bx, by) = door.a, door.b
    along = (place[0] - ax) * (bx - ax) + (place[1] - ay) * (by - ay)
    share = min(max(along / ((bx - ax) ** 2 + (by - ay) ** 2), 0.0), 1.0)
    if share == 1.0:
        return door.b
    return (ax + share * (bx - ax), ay + share * (by - ay))


@dataclass(frozen=True, slots=True)
class Reckoned:
    """A column of the table."""

    path_m: float
    steps: float
    turns: float
    """Turns as printed."""
    turns_corrected: float
    """Turns with those inside stripes in every stripe; the print has those of one."""


def reckoned(cover: Cover, x_m: float, y_m: float, range_m: float, theta_rad: float) -> Reckoned:
    """Return the formulas, simplified: 1 + cos(a) is 2 cos(a/2)^2, and 1 - cos(a) is 2
    sin(a/2)^2."""
    if cover is Cover.TRIANGLES:
        rows_m = range_m * math.cos(theta_rad / 2.0)
        turns = 2.0 * y_m / rows_m
        steps = 2.0 * x_m * y_m / (range_m**2 * math.sin(theta_rad))
        return Reckoned(2.0 * y_m + 2.0 * x_m * y_m / rows_m, steps, turns, turns)
    inside = 4.0 * x_m / (range_m * math.sqrt(2.0 - 2.0 * math.cos(theta_rad)))
    between = 2.0 * y_m / range_m
    return Reckoned(
        path_m=2.0 * y_m + 2.0 * x_m * y_m / (range_m * math.cos(theta_rad / 4.0)),
        steps=x_m * y_m / (range_m**2 * math.sin(theta_rad / 2.0)),
        turns=between + inside,
        turns_corrected=between + inside * y_m / range_m,
    )
