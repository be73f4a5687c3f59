"""ROIs to explore without flying: sets of cells with a start."""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np

from missions.units import Cell


def component(roi: Collection[Cell], start: Cell) -> set[Cell]:
    """The cells that are 4-connected to `start`, itself among them."""
    found, todo = {start}, [start]
    while todo:
        for cell in todo.pop().neighbours():
            if cell in roi and cell not in found:
                found.add(cell)
                todo.append(cell)
    return found


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
