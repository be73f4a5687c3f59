"""Breadth-first search over cells: what is reached, in how many steps, and by which way."""

from __future__ import annotations

from collections.abc import Callable, Collection, Container, Iterable

from missions.mapping.tree import Tree
from missions.units import Cell


def reached(
    near: Callable[[Cell], Iterable[Cell]], start: Cell, until: Collection[Cell] = ()
) -> dict[Cell, int]:
    """Steps from `start` to every cell that is reached, nearest first, by the neighbours that
    `near` tells; with `until` no farther than to the nearest of these.

    >>> reached(lambda cell: [Cell(cell.east + 1, 0)], Cell(0, 0), until=[Cell(2, 0)])[Cell(2, 0)]
    2
    """
    steps, count = {start: 0}, 0
    ring = [start]
    while ring and not (until and any(cell in until for cell in ring)):
        count += 1
        outer = []
        for cell in ring:
            for other in near(cell):
                if other not in steps:
                    steps[other] = count
                    outer.append(other)
        ring = outer
    return steps


def neighbours_in(known: Container[Cell]) -> Callable[[Cell], list[Cell]]:
    """The rule to be handed to `reached` that keeps to `known` cells."""
    return lambda cell: [near for near in cell.neighbours() if near in known]


def distances(known: Container[Cell], start: Cell) -> dict[Cell, int]:
    """Steps from `start` to every cell that is reached over `known` cells, nearest first."""
    return reached(neighbours_in(known), start)


def step_towards(known: Container[Cell], start: Cell, goal: Cell) -> Cell:
    """The first cell on a shortest way from `start` to `goal`; of several the first in the order
    north, east, south, west.
    """
    if start == goal:
        return start
    steps = reached(neighbours_in(known), goal, until=[start])
    return min((near for near in start.neighbours() if near in steps), key=lambda near: steps[near])


def step_home(tree: Tree, start: Cell) -> Cell | None:
    """The next cell on a shortest known way to the root, None at the root."""
    return None if start == tree.root else step_towards(tree, start, tree.root)


def patches(cells: Collection[Cell]) -> tuple[frozenset[Cell], ...]:
    """The patches of some cells, the largest first; of equal ones that with the lowest cell.

    >>> found = patches([Cell(0, 0), Cell(5, 5), Cell(5, 6), Cell(1, 1)])
    >>> [sorted(patch)[0] for patch in found]
    [Cell(east=5, north=5), Cell(east=0, north=0), Cell(east=1, north=1)]
    """
    left = set(cells)
    found: list[frozenset[Cell]] = []
    while left:
        patch, asked = set(), [left.pop()]
        while asked:
            cell = asked.pop()
            patch.add(cell)
            near = [n for n in cell.neighbours() if n in left]
            left.difference_update(near)
            asked.extend(near)
        found.append(frozenset(patch))
    return tuple(sorted(found, key=lambda patch: (-len(patch), min(patch))))
