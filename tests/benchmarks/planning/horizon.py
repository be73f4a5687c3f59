"""How good and how fast the rolling horizon is; prints tables.

    python tests/benchmarks/planning/horizon.py ../shared/data/roi   every ROI file, several minutes
    python tests/benchmarks/planning/horizon.py ../shared/data/roi --quick ten ROIs of 120 cells
    each

T / LB is the ratio of the mean makespan to the mean lower bound that the file states. Times are
those of this process on one core, after compilation; a run includes the arena.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np

from missions.lab.arena.arena_run import run
from missions.lab.arena.minds import look
from missions.mapping.tree import Tree
from missions.planning.stepwise import Situation
from missions.planning.stepwise.horizon import Horizon
from missions.units import Cell

TEAMS = (1, 2, 4, 8, 20)
STEP_CELLS, STEP_ROBOTS = 2000, 8


def ratios(path: Path, count: int | None) -> None:
    """A line for each size of team."""
    rois = json.loads(path.read_text())["rois"][:count]
    for robots in TEAMS:
        makespan = bound = 0.0
        began = time.process_time()
        for roi in rois:
            cells = {Cell(*cell) for cell in roi["cells"]}
            makespan += run(Horizon(), cells, Cell(*roi["start"]), robots).makespan
            bound += roi["lower_bound"][str(robots)]
        each_s = (time.process_time() - began) / len(rois)
        print(
            f"{path.stem:14} {robots:3} {makespan / bound:6.3f} {each_s:8.3f} s a run", flush=True
        )


def step() -> None:
    """The time that one decision takes when 2000 cells are known and eight robots decide."""
    start = Cell(0, 0)
    span = range(-30, 31)
    roi = {Cell(east, north) for east in span for north in span if east**2 + north**2 <= 900}
    tree, todo = Tree.rooted(start), [start]
    while len(tree) < STEP_CELLS:
        cell = todo.pop(0)
        before = len(tree)
        tree = look(tree, cell, roi)
        todo += list(tree.vertices)[before:]
    at = dict(
        zip(range(STEP_ROBOTS), (c for c in tree.vertices if tree.has_looked(c)), strict=False)
    )
    memory, times = None, []
    for _ in range(20):
        began = time.process_time()
        memory = Horizon().decide(Situation(tree, at, tuple(at), memory)).memory
        times.append(1000.0 * (time.process_time() - began))
    print(f"a step, {len(tree)} known cells, {STEP_ROBOTS} robots: {np.median(times):.1f} ms")


def main() -> None:
    """Everything, or a little."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="where the ROI files are")
    parser.add_argument("--quick", action="store_true", help="ten ROIs of 120 cells of each kind")
    options = parser.parse_args()
    run(Horizon(), {Cell(0, 0), Cell(0, 1), Cell(1, 0)}, Cell(0, 0), 2)  # compile
    step()
    for path in sorted(options.folder.glob("*-120.json" if options.quick else "*.json")):
        ratios(path, 10 if options.quick else None)


if __name__ == "__main__":
    main()
