"""Ways and their lengths, cell by cell or straight as in flight.

Lengths are in cells. If robots fly straight, a leg's length is the time that it adds to a closed
tour, times the speed. A leg that is not allowed is as long as the way over known cells.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from functools import cache

from missions.mapping.tree import Tree, neighbours_in, reached
from missions.planning.stepwise.interface import Metric
from missions.units import Cell


class Ways:
    """Ways over the known cells at one decision.

    >>> tree = Tree.rooted(Cell(0, 0)).with_observation(Cell(0, 0), [Cell(0, 1)])
    >>> tree = tree.with_observation(Cell(0, 1), [Cell(1, 1)])
    >>> Ways(tree, Metric()).lengths(Cell(0, 0), [Cell(1, 1)])
    {Cell(east=1, north=1): 2.0}
    >>> in_flight = Ways(tree, Metric(straight=True))
    >>> round(in_flight.lengths(Cell(0, 0), [Cell(1, 1)])[Cell(1, 1)], 3)
    1.414
    >>> in_flight.next_stop(Cell(0, 0), Cell(1, 1))
    Cell(east=1, north=1)
    """

    def __init__(self, tree: Tree, metric: Metric) -> None:
        self._metric = metric
        known = dict(tree.vertices.items())
        # most ways are short: the next cell should not cost the whole map
        self._near = cache(neighbours_in(known))
        self.unvisited = [cell for cell, vertex in known.items() if not vertex.observed]
        """Known cells that no robot has observed, in the order in which they were found."""

    def steps(self, start: Cell, until: Collection[Cell] = ()) -> dict[Cell, int]:
        """Return steps to every vertex, nearest first; with `until` up to the nearest of these."""
        return reached(self._near, start, until)

    def nearest(self, start: Cell, goals: Collection[Cell]) -> list[Cell]:
        """Return the nearest of some vertices: several if they are equally near."""
        wanted = frozenset(goals)
        if self._metric.straight:
            far = self.lengths(start, wanted)
            return [cell for cell in far if far[cell] == min(far.values())]
        steps = self.steps(start, wanted)
        last = next(reversed(steps.values()))
        return [cell for cell, count in steps.items() if count == last and cell in wanted]

    def nearest_free(self, start: Cell, others: Mapping[Cell, int]) -> list[Cell]:
        """Return the nearest of the unvisited vertices that the fewest others head for."""
        fewest = min(others.get(cell, 0) for cell in self.unvisited)
        return self.nearest(start, [c for c in self.unvisited if others.get(c, 0) == fewest])

    def lengths(self, start: Cell, goals: Collection[Cell]) -> dict[Cell, float]:
        """Return the length of the way to each of some vertices, nearest first."""
        wanted = frozenset(goals)
        found = {cell: float(n) for cell, n in self.steps(start).items() if cell in wanted}
        if not self._metric.straight:
            return found
        for cell in found:
            if self._is_straight(start, cell):
                found[cell] = self._metric.tour_leg(start, cell) * self._metric.speed
        return dict(sorted(found.items(), key=lambda item: item[1]))

    def next_stop(self, start: Cell, goal: Cell) -> Cell:
        """Return the next vertex on the way to another: the goal itself if robots fly straight."""
        if self._metric.straight and self._is_straight(start, goal):
            return goal
        steps = self.steps(goal, [start])
        return min((n for n in self._near(start) if n in steps), key=steps.__getitem__)

    def _is_straight(self, start: Cell, end: Cell) -> bool:
        passable = self._metric.passable
        return passable is None or passable(start, end)


def headed_for(robot: int, at: Mapping[int, Cell], goals: Mapping[int, Cell]) -> Counter[Cell]:
    """For each cell the number of other robots that are there or head for it."""
    return Counter(cell for r in at if r != robot for cell in {goals[r], at[r]})
