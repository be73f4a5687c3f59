"""The grids of the paper's proofs, and random ones."""

from __future__ import annotations

import numpy as np

from missions.mapping.breadth_first import patches
from missions.units import Cell


def chevrons(k: int, m: int) -> tuple[set[Cell], Cell]:
    """G_{k,m} of Figure 6 and the cell A where the Homing Robot starts: the worst that is known.

    m obstacles of 2 k + 1 cells point west. Rows -(k + 1) to k + 1 are each moved east by their
    distance from the middle; all but the outermost are (free, free, obstructed) m times, then free,
    free.
    """
    width = 3 * m + 2
    cells = {
        Cell(abs(row) + column, row)
        for row in range(-k, k + 1)
        for column in range(width)
        if column % 3 != 2
    }
    for row in (-k - 1, k + 1):
        cells |= {Cell(k + 1 + column, row) for column in range(width - 1)}
    return cells, Cell(width - 1, 0)


def studded(k: int) -> set[Cell]:
    """G_k of Lemma 8: a square of 2 k + 1 with k^2 obstacles of one cell."""
    side = range(2 * k + 1)
    return {Cell(east, north) for east in side for north in side if not east % 2 * (north % 2)}


def corridor(cells: int) -> set[Cell]:
    """A row of cells, on which any deterministic method needs n - 3 moves at worst (Theorem 3)."""
    return {Cell(east, 0) for east in range(cells)}


def cluttered(width: int, height: int, share: float, rng: np.random.Generator) -> set[Cell]:
    """A room in which a share of the cells is obstructed, at random: the largest part of it."""
    free = rng.random((width, height)) >= share
    left = {Cell(int(e), int(n)) for e, n in np.argwhere(free)} or {Cell(0, 0)}
    return set(patches(left)[0])
