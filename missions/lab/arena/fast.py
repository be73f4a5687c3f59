"""The figures of `rdfs` in the arena, compiled, for studies on regions of 100,000 cells.

It is for shared communication and a team that stays; all else needs `missions.lab.arena.arena_run`.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from missions.errors import RoiError
from missions.planning.stepwise.interface import Metric
from missions.units import Cell

_NONE = -1
_MAX_KEYS = 2**62
_STEPS = Cell(0, 0).neighbours()


@dataclass(frozen=True, slots=True)
class Lattice:
    """A ROI as arrays: cells in ascending order, and their neighbours."""

    cells: NDArray[np.int64]
    """East and north of every cell; shape (C, 2)."""
    near: NDArray[np.int32]
    """The neighbours north, east, south and west of every cell, -1 if there is none; (C, 4)."""

    @classmethod
    def from_cells(cls, roi: Collection[Cell] | NDArray[np.int64]) -> Lattice:
        """Return the lattice of cells, or of an array (C, 2) of east and north.

        Raises `RoiError` without cells, or if they are too far apart to be numbered.

        >>> Lattice.from_cells([Cell(0, 0), Cell(1, 0)]).near.tolist()
        [[-1, 1, -1, -1], [-1, -1, -1, 0]]
        """
        if isinstance(roi, np.ndarray):
            cells = roi.astype(np.int64).reshape(-1, 2)
        else:
            cells = np.fromiter(chain.from_iterable(roi), np.int64, 2 * len(roi)).reshape(-1, 2)
        if not len(cells):
            raise RoiError("a ROI without cells")
        low, high = cells.min(axis=0), cells.max(axis=0)
        wide, tall = (int(b) - int(a) + 3 for a, b in zip(low, high, strict=True))
        if wide * tall > _MAX_KEYS:
            raise RoiError(f"cells that lie {max(wide, tall) - 3} apart are not one ROI")
        low -= 1  # a free row below and above: no step leads round
        keys = np.unique((cells - low) @ np.array([tall, 1]))
        near = np.full((len(keys), 4), _NONE, np.int32)
        for d, step in enumerate(_STEPS):
            wanted = keys + step.east * tall + step.north
            place = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
            near[:, d] = np.where(keys[place] == wanted, place, _NONE)
        return cls(np.stack(np.divmod(keys, tall), axis=1) + low, near)

    def index(self, cell: Cell) -> int:
        """Return the number of a cell. Raises `RoiError` for a foreign one."""
        found = np.flatnonzero((self.cells[:, 0] == cell.east) & (self.cells[:, 1] == cell.north))
        if not len(found):
            raise RoiError(f"the start {tuple(cell)} is not a cell of the ROI")
        return int(found[0])


@dataclass(frozen=True, slots=True)
class Summary:
    """The figures of a run: moves of all robots, cells and depth of the final tree."""

    makespan: float
    moves: int
    cells: int
    depth: int


def run_rdfs(
    roi: Collection[Cell] | Lattice,
    start: Cell,
    robots: int,
    metric: Metric | None = None,
    *,
    plain: bool = False,
) -> Summary:
    """Return the figures of `run(EXPLORERS["rdfs"], roi, start, robots, metric=metric)`.

    With `plain`, Algorithm 1 has only the child rule: the first of equal children in the order
    north, east, south, west instead of the outermost. Observations at one depth are in the order of
    the cells. The return path is up the tree, not the shortest. Raises `RoiError` for a start
    outside the ROI.
    """
    from missions.lab.kernels import rdfs_kernels as rdfs  # noqa: PLC0415 - as above
    from missions.planning.kernels import ground  # noqa: PLC0415 - importing numba takes a second

    lattice = roi if isinstance(roi, Lattice) else Lattice.from_cells(roi)
    root = lattice.index(start)
    metric = metric if metric is not None else Metric()
    cost = np.array([metric.leg(Cell(0, 0), step) for step in _STEPS])
    away = ((lattice.cells - lattice.cells[root]) ** 2).sum(axis=1)
    steps = ground.spread(lattice.near, np.array([root], np.int32))[0]
    if plain:
        away[:] = 0  # no cell is farther out than another
        steps = steps[:0]
    makespan, moves, rows = rdfs.play(lattice.near, away, root, robots, cost, metric.look, steps)
    reached = int(np.count_nonzero(rows[:, rdfs.PARENT] != _NONE))
    return Summary(float(makespan), int(moves), reached, int(rows[:, rdfs.DEPTH].max()))
