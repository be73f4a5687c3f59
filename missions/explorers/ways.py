"""Ways over known ROI cells: distances and shortest paths, from step to step of one cell."""

from __future__ import annotations

from typing import Protocol

from missions.tree import Tree
from missions.units import Cell


class Known(Protocol):
    """A tree, or a set of cells."""

    def __contains__(self, cell: Cell, /) -> bool:
        """Whether a cell is known to be ROI."""
        ...


def distances(known: Known, start: Cell) -> dict[Cell, int]:
    """Steps from `start` to every cell that is reached over `known` cells, nearest first.

    >>> distances({Cell(0, 0), Cell(0, 1), Cell(1, 1)}, Cell(0, 0))[Cell(1, 1)]
    2
    """
    steps = {start: 0}
    ring = [start]
    while ring:
        outer = []
        for cell in ring:
            for near in cell.neighbours():
                if near in known and near not in steps:
                    steps[near] = steps[cell] + 1
                    outer.append(near)
        ring = outer
    return steps


def step_towards(known: Known, start: Cell, goal: Cell) -> Cell:
    """The first cell on a shortest way from `start` to `goal`; of several the first in the order
    north, east, south, west.

    >>> step_towards({Cell(0, 0), Cell(0, 1), Cell(1, 1)}, Cell(0, 0), Cell(1, 1))
    Cell(east=0, north=1)
    """
    if start == goal:
        return start
    steps = distances(known, goal)
    return min((near for near in start.neighbours() if near in steps), key=lambda near: steps[near])


def step_home(tree: Tree, start: Cell) -> Cell | None:
    """The next cell on a shortest known way to the root, None at the root."""
    return None if start == tree.root else step_towards(tree, start, tree.root)
