"""ROIs to explore without flying: sets of cells with a start.

Growths return random cells around (0, 0), which is one of them. `grown` makes a `Roi` of one, with
a random cell of its boundary as the start.
"""

from __future__ import annotations

import heapq
import math
from bisect import bisect_left, insort
from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np

from missions.errors import RoiError
from missions.mapping.tree import neighbours_in, reached
from missions.units import Cell

MAX_CELLS = 1_000_000
"""Maximum number of cells of a ROI: a mistyped number should not fill the memory."""


@dataclass(frozen=True, slots=True)
class Roi:
    """Connected cells, and the start of all robots.

    >>> Roi.around("pair", Cell(0, 0), {Cell(0, 0), Cell(0, 1), Cell(7, 7)}).cells == {
    ...     Cell(0, 0), Cell(0, 1)}
    True
    """

    name: str
    start: Cell
    cells: frozenset[Cell]

    @classmethod
    def around(cls, name: str, start: Cell, cells: Collection[Cell]) -> Roi:
        """Return the part of `cells` that is connected with `start`."""
        return cls(name, start, frozenset(component(cells, start)))


def component(roi: Collection[Cell], start: Cell) -> set[Cell]:
    """Return the cells that are 4-connected to `start`, itself among them."""
    return set(reached(neighbours_in(roi), start))


def boundary(roi: Collection[Cell]) -> list[Cell]:
    """Return the cells of a ROI that have a neighbour outside, ascending."""
    return sorted(cell for cell in roi if any(near not in roi for near in cell.neighbours()))


def eden(cells: int, rng: np.random.Generator) -> set[Cell]:
    """Return a compact cluster: each next cell is drawn from the rim with equal probability."""
    return _cluster(cells, rng, most_contacts=4)


def thin(cells: int, rng: np.random.Generator) -> set[Cell]:
    """Return a cluster without cycles: a cell is added only where it touches one other cell.

    A rim that closes up ends the growth early, so it may hold fewer cells than requested.
    """
    return _cluster(cells, rng, most_contacts=1)


def _cluster(cells: int, rng: np.random.Generator, most_contacts: int) -> set[Cell]:
    """Grow by cells that touch at least one and at most `most_contacts` of the cluster."""
    roi: set[Cell] = set()
    contacts: dict[Cell, int] = {}
    rim = [Cell(0, 0)]  # ascending, so that the draw does not depend on the order of a set
    while rim and len(roi) < cells:
        cell = rim.pop(int(rng.integers(len(rim))) if roi else 0)
        roi.add(cell)
        for near in cell.neighbours():
            if near in roi:
                continue
            contacts[near] = contacts.get(near, 0) + 1
            if contacts[near] == 1:
                insort(rim, near)
            elif contacts[near] == most_contacts + 1:
                del rim[bisect_left(rim, near)]
    return roi


def ragged(cells: int, rng: np.random.Generator) -> set[Cell]:
    """Return a cluster with bays and holes: invasion percolation.

    Every cell of the plane has a random strength; the weakest of the rim is taken next.
    """
    roi: set[Cell] = set()
    rim = [(0.0, Cell(0, 0))]
    met = {Cell(0, 0)}
    while len(roi) < cells:
        _, cell = heapq.heappop(rim)
        roi.add(cell)
        for near in cell.neighbours():
            if near not in met:
                met.add(near)
                heapq.heappush(rim, (float(rng.random()), near))
    return roi


def rectangle(cells: int, rng: np.random.Generator) -> set[Cell]:
    """Return a rectangle of a random shape, at most 4 to 1; the last row may be short."""
    aspect = 4.0 ** float(rng.uniform(-1.0, 1.0))
    width = min(max(round(math.sqrt(cells * aspect)), 1), cells)
    return {Cell(i % width, i // width) for i in range(cells)}


KINDS: dict[str, Callable[[int, np.random.Generator], set[Cell]]] = {
    "eden": eden,
    "ragged": ragged,
    "rectangle": rectangle,
    "thin": thin,
}


def grown(kind: str, cells: int, seed: int) -> Roi:
    """Return a ROI by its kind, size and seed: the same for the same three.

    Raises `RoiError` for an unknown kind, or a number of cells outside 1 to `MAX_CELLS`.
    """
    if kind not in KINDS:
        raise RoiError(f"{kind!r} is not a kind of ROI; choose one of {', '.join(KINDS)}")
    if not 1 <= cells <= MAX_CELLS:
        raise RoiError(f"a ROI of {cells} cells cannot be grown; choose 1 to {MAX_CELLS}")
    rng = np.random.default_rng(seed)
    roi = KINDS[kind](cells, rng)
    rim = boundary(roi)
    return Roi(f"{kind}:{cells}:{seed}", rim[int(rng.integers(len(rim)))], frozenset(roi))
