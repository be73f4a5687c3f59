"""How far from the optimum the strategies stay: `python -m tests.benchmarks.planning.strategies
FILE...`.

The files hold ROIs as `{"rois": [{"start", "cells", "lower_bound"}]}`, the lower bound for each
number of robots. For every strategy and number of robots it prints the mean makespan over the mean
lower bound, and the time that a run took.

    --rois N      only the first N of each file
    --only NAMES  only these strategies, with commas between
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

from missions.lab.arena.arena_run import run
from missions.lab.strategies import EXPLORERS
from missions.units import Cell


def main() -> None:
    """Print a table for each file."""
    parser = argparse.ArgumentParser(description="mean makespan / mean lower bound by strategy")
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--rois", type=int)
    parser.add_argument("--only", default=",".join(EXPLORERS))
    options = parser.parse_args()
    for file in options.files:
        rois = json.loads(file.read_text("utf-8"))["rois"][: options.rois]
        teams = [int(robots) for robots in rois[0]["lower_bound"]]
        print(f"{file.stem}, {len(rois)} ROIs".ljust(24), *(f"R={r}".rjust(7) for r in teams))
        for name in options.only.split(","):
            began, ratios = time.perf_counter(), []
            for robots in teams:
                spans = [
                    run(
                        EXPLORERS[name],
                        {Cell(*cell) for cell in roi["cells"]},
                        Cell(*roi["start"]),
                        robots,
                    ).makespan
                    for roi in rois
                ]
                ratios.append(sum(spans) / sum(roi["lower_bound"][str(robots)] for roi in rois))
            took_s = (time.perf_counter() - began) / len(rois) / len(teams)
            print(name.ljust(24), *(f"{r:7.3f}" for r in ratios), f"  {took_s:.2f} s a run")


if __name__ == "__main__":
    main()
