"""Ways over known ROI cells: distances and shortest paths, from step to step of one cell."""

from __future__ import annotations

from missions.mapping.breadth_first import Known, neighbours_in, reached
from missions.mapping.tree import Tree
from missions.units import Cell


def distances(known: Known, start: Cell) -> dict[Cell, int]:
    """Steps from `start` to every cell that is reached over `known` cells, nearest first.

    >>> distances({Cell(0, 0), Cell(0, 1), Cell(1, 1)}, Cell(0, 0))[Cell(1, 1)]
    2
    """
    return reached(neighbours_in(known), start)


def step_towards(known: Known, start: Cell, goal: Cell) -> Cell:
    """The first cell on a shortest way from `start` to `goal`; of several the first in the order
    north, east, south, west.

    >>> step_towards({Cell(0, 0), Cell(0, 1), Cell(1, 1)}, Cell(0, 0), Cell(1, 1))
    Cell(east=0, north=1)
    """
    if start == goal:
        return start
    steps = reached(neighbours_in(known), goal, until=[start])
    return min((near for near in start.neighbours() if near in steps), key=lambda near: steps[near])


def step_home(tree: Tree, start: Cell) -> Cell | None:
    """The next cell on a shortest known way to the root, None at the root."""
    return None if start == tree.root else step_towards(tree, start, tree.root)
