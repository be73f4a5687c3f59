"""A noise-free arena for explorers: robots that move a cell a round, on a ROI that is known to us.

Everybody shares one tree. In a round every robot that is not done asks the explorer and moves one
edge; then the vertices that were reached are looked from. What is measured is what the bounds of
the paper speak of: rounds (the makespan in moves), the tree, and every move.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np

from missions.explorers import Explorer
from missions.tree import Tree
from missions.units import Cell


@dataclass(frozen=True, slots=True)
class Run:
    """What came out of a run: rounds with a move, the tree, and per round who moved where."""

    makespan: int
    tree: Tree
    moves: tuple[dict[int, Cell], ...]
    at: dict[int, Cell]


Team = Callable[[int, Tree], Collection[int]]
"""Who takes part in a round: from the number of the round and the tree so far."""


def look(tree: Tree, cell: Cell, roi: Collection[Cell]) -> Tree:
    """The tree after a noise-free look from a cell."""
    return tree.looked(cell, [c for c in cell.neighbours() if c in roi])


def run(
    explorer: Explorer,
    roi: Collection[Cell],
    start: Cell,
    robots: int,
    *,
    tree: Tree | None = None,
    team: Team | None = None,
    limit: int | None = None,
) -> Run:
    """Explore a ROI to the end.

    Args:
        explorer: the strategy.
        roi: the cells of the ROI; those that `start` does not reach stay unknown.
        start: where all robots are at first.
        robots: how many; they are named 0, 1, ...
        tree: what is known beforehand, by default nothing but the start.
        team: who takes part in a round, by default everybody. Who is left out stays where it is
            and is not told to the explorer, as a vehicle that failed; back again it goes on.
        limit: rounds after which the run is given up, by default plenty.

    Raises:
        AssertionError: for a move that is not along an edge of the tree, or too many rounds.
    """
    known = look(tree if tree is not None else Tree.rooted(start), start, roi)
    at = dict.fromkeys(range(robots), start)
    limit = limit if limit is not None else 50 * (len(roi) + 1)
    moves: list[dict[int, Cell]] = []
    rounds = 0
    while True:
        rounds += 1
        assert rounds < limit, "the explorer does not come to an end"
        present = set(range(robots) if team is None else team(rounds, known))
        asked = [r for r in sorted(present) if not _done(known, at[r])]
        if not asked and (team is None or all(_done(known, cell) for cell in at.values())):
            return Run(len(moves), known, tuple(moves), at)
        answer = explorer.moves(known, {r: at[r] for r in sorted(present)}, asked)
        moved = {r: cell for r, cell in answer.items() if cell is not None}
        for robot, cell in moved.items():
            near = (*known.children(at[robot]), known.parent(at[robot]))
            assert cell in near, f"robot {robot} jumps from {at[robot]} to {cell}"
            at[robot] = cell
        if moved:
            moves.append(moved)
        for cell in sorted(set(moved.values()), key=lambda c: (known.vertices[c].depth, c)):
            if not known.has_looked(cell):
                known = look(known, cell, roi)


def _done(tree: Tree, cell: Cell) -> bool:
    return cell == tree.root and tree.is_explored(tree.root)


def component(roi: Collection[Cell], start: Cell) -> set[Cell]:
    """The cells that are 4-connected to `start`, itself among them."""
    found, todo = {start}, [start]
    while todo:
        for cell in todo.pop().neighbours():
            if cell in roi and cell not in found:
                found.add(cell)
                todo.append(cell)
    return found


# --- random ROIs -----------------------------------------------------------------------------
def eden(cells: int, rng: np.random.Generator) -> set[Cell]:
    """A compact cluster: every next cell is drawn from the rim, each rim cell equally likely."""
    roi = {Cell(0, 0)}
    while len(roi) < cells:
        rim = sorted({n for c in roi for n in c.neighbours()} - roi)
        roi.add(rim[int(rng.integers(len(rim)))])
    return roi


def thin(cells: int, rng: np.random.Generator) -> set[Cell]:
    """A cluster without cycles: a cell is added only where it touches one other cell.

    A rim that closes up ends the growth early, so it may hold fewer cells than asked for.
    """
    roi = {Cell(0, 0)}
    while len(roi) < cells:
        rim = {n for c in roi for n in c.neighbours()} - roi
        free = sorted(c for c in rim if sum(n in roi for n in c.neighbours()) == 1)
        if not free:
            break
        roi.add(free[int(rng.integers(len(free)))])
    return roi


KINDS: dict[str, Callable[[int, np.random.Generator], set[Cell]]] = {"eden": eden, "thin": thin}
