"""How fast robots explore in simulation; prints two tables.

    python tests/benchmarks/planning/explorers.py             both, about two minutes
    python tests/benchmarks/planning/explorers.py --compiled  moves a second of compiled `rdfs`
    python tests/benchmarks/planning/explorers.py --growth how every strategy grows with cells and
    robots
    python tests/benchmarks/planning/explorers.py --budget 5  stop a strategy's column after so many
    seconds

Compiled `rdfs` runs on squares of which every fifth cell is missing, with arrays as input; its time
is the whole call, after compilation. The strategies run in the arena on compact ROIs; a column ends
where a run took longer than the budget.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from missions.lab.arena.arena_run import run
from missions.lab.arena.fast import Lattice, Summary, run_rdfs
from missions.lab.arena.roi import grown
from missions.lab.strategies import EXPLORERS
from missions.planning.stepwise.metric import Metric
from missions.units import Cell

SIZES = (1_000, 10_000, 100_000, 1_000_000)
ROBOTS = (1, 4, 20)
GROWTH_SIZES = (30, 60, 120, 250, 500, 1_000, 2_000)
GROWTH_ROBOTS = (1, 8)
BUDGET_S = 3.0
DENSITY = 0.8


def holed_square(cells: int) -> tuple[Lattice, Cell]:
    """A square with holes, of about so many cells, and a cell in its middle."""
    side = round((cells / DENSITY) ** 0.5)
    lattice = Lattice.of(np.argwhere(np.random.default_rng(1).random((side, side)) < DENSITY))
    east, north = lattice.cells[len(lattice.cells) // 2].tolist()
    return lattice, Cell(east, north)


def timed(lattice: Lattice, start: Cell, robots: int, metric: Metric) -> tuple[Summary, float]:
    """A run of compiled `rdfs` and its seconds."""
    begin_s = time.perf_counter()
    summary = run_rdfs(lattice, start, robots, metric)
    return summary, time.perf_counter() - begin_s


def compiled() -> None:
    """Moves a second."""
    metrics = {"resting": Metric(), "drifting": Metric(speed=2.5, drift_east=1.0)}
    run_rdfs([Cell(0, 0)], Cell(0, 0), 1)
    print(f"{'ROI':10}{'cells':>9}{'robots':>8}{'moves':>11}{'wall s':>9}{'million moves/s':>18}")
    for cells in SIZES:
        lattice, start = holed_square(cells)
        for robots in ROBOTS:
            for name, metric in metrics.items():
                summary, wall_s = timed(lattice, start, robots, metric)
                print(
                    f"{name:10}{summary.cells:9}{robots:8}{summary.moves:11}{wall_s:9.3f}"
                    f"{summary.moves / wall_s / 1e6:18.2f}"
                )


def growth(budget_s: float) -> None:
    """Seconds of a run by strategy, cells and robots."""
    heading = "".join(f"{cells:>9}" for cells in GROWTH_SIZES)
    print(f"{'strategy':14}{'robots':>7}{heading}  cells; seconds a run")
    for name, explorer in EXPLORERS.items():
        for robots in GROWTH_ROBOTS:
            warm = grown("eden", 30, 2)
            run(explorer, warm.cells, warm.start, robots)
            print(f"{name:14}{robots:7}", end="", flush=True)
            for cells in GROWTH_SIZES:
                roi = grown("eden", cells, 1)
                begin_s = time.perf_counter()
                run(explorer, roi.cells, roi.start, robots)
                took_s = time.perf_counter() - begin_s
                print(f"{took_s:9.3f}", end="", flush=True)
                if took_s > budget_s:
                    break
            print()


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--compiled", action="store_true")
    parser.add_argument("--growth", action="store_true")
    parser.add_argument("--budget", type=float, default=BUDGET_S)
    options = parser.parse_args()
    if options.compiled or not options.growth:
        compiled()
    if options.growth or not options.compiled:
        growth(options.budget)


if __name__ == "__main__":
    main()
