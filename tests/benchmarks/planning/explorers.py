"""Speed of exploration by robots in simulation; prints two tables.

    python -m tests.benchmarks.planning.explorers             both, about two minutes
    python -m tests.benchmarks.planning.explorers --compiled  moves a second of compiled `rdfs`
    python -m tests.benchmarks.planning.explorers --growth    how every strategy grows
    python -m tests.benchmarks.planning.explorers --budget 5  a column ends after so many seconds

Compiled `rdfs` runs on squares of which every fifth cell is missing, with arrays as input; its time
is the whole call, after compilation. The strategies run in the arena on compact ROIs; a column ends
after a run that took longer than the budget.
"""

from __future__ import annotations

import itertools
import time

import numpy as np

from missions.lab.arena.arena_run import run
from missions.lab.arena.fast import Lattice, run_rdfs
from missions.lab.arena.roi import grown
from missions.lab.strategies import EXPLORERS
from missions.planning.stepwise.interface import Metric
from missions.units import Cell
from tests.benchmarks.frame import head, options_of, row

SIZES = (1_000, 10_000, 100_000, 1_000_000)
ROBOTS = (1, 4, 20)
GROWTH_SIZES = (30, 60, 120, 250, 500, 1_000, 2_000)
GROWTH_ROBOTS = (1, 8)
BUDGET_S = 3.0
DENSITY = 0.8


def holed_square(cells: int) -> tuple[Lattice, Cell]:
    """Return a square with holes, of about a number of cells, and a cell in its middle."""
    side = round((cells / DENSITY) ** 0.5)
    lattice = Lattice.from_cells(
        np.argwhere(np.random.default_rng(1).random((side, side)) < DENSITY)
    )
    east, north = lattice.cells[len(lattice.cells) // 2].tolist()
    return lattice, Cell(east, north)


def compiled() -> None:
    """Print moves per second."""
    metrics = {"resting": Metric(), "drifting": Metric(speed=2.5, drift_east=1.0)}
    run_rdfs([Cell(0, 0)], Cell(0, 0), 1)
    print(head("ROI", "cells", "robots", "moves", "wall s", "million moves/s"))
    for cells in SIZES:
        lattice, start = holed_square(cells)
        for robots, (name, metric) in itertools.product(ROBOTS, metrics.items()):
            begin_s = time.perf_counter()
            found = run_rdfs(lattice, start, robots, metric)
            wall_s = time.perf_counter() - begin_s
            rate = found.moves / wall_s / 1e6
            figures = (found.cells, robots, found.moves, f"{wall_s:.3f}", f"{rate:.2f}")
            print(row(name, *figures), flush=True)


def growth(budget_s: float) -> None:
    """Print seconds of a run by strategy, cells and robots."""
    print(head("strategy", "robots", *(f"{cells} cells" for cells in GROWTH_SIZES)))
    for (name, explorer), robots in itertools.product(EXPLORERS.items(), GROWTH_ROBOTS):
        warm = grown("eden", 30, 2)
        run(explorer, warm.cells, warm.start, robots)
        took_s: list[float] = []
        for cells in GROWTH_SIZES:
            if not took_s or took_s[-1] <= budget_s:
                roi = grown("eden", cells, 1)
                begin_s = time.perf_counter()
                run(explorer, roi.cells, roi.start, robots)
                took_s.append(time.perf_counter() - begin_s)
        print(row(name, robots, *(f"{seconds:.3f}" for seconds in took_s)), flush=True)


def main() -> None:
    """Print the tables."""
    options = options_of(__doc__, compiled=False, growth=False, budget=BUDGET_S)
    if options.compiled or not options.growth:
        compiled()
    if options.growth or not options.compiled:
        growth(options.budget)


if __name__ == "__main__":
    main()
