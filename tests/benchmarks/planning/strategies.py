"""Distance of the strategies from the optimum.

    python -m tests.benchmarks.planning.strategies --files FILE ...

The files hold ROIs as `{"rois": [{"start", "cells", "lower_bound"}]}`, with the lower bound for
each number of robots. For every strategy and number of robots it prints the mean makespan over the
mean lower bound, and the time of a run.

    --rois N        only the first N of each file
    --only NAME ... only these strategies
"""

from __future__ import annotations

import json
import time
from pathlib import Path

from missions.lab.arena.arena_run import run
from missions.lab.strategies import EXPLORERS
from missions.units import Cell
from tests.benchmarks.frame import head, options_of, row


def main() -> None:
    """Print a table for each file."""
    options = options_of(__doc__, files=(Path("rois.json"),), rois=int, only=tuple(EXPLORERS))
    for file in options.files:
        rois = json.loads(file.read_text("utf-8"))["rois"][: options.rois]
        regions = [({Cell(*c) for c in roi["cells"]}, Cell(*roi["start"])) for roi in rois]
        teams = [int(robots) for robots in rois[0]["lower_bound"]]
        print(head(f"{file.stem}, {len(rois)} ROIs", *(f"R={r}" for r in teams), "s a run"))
        for name in options.only:
            began, ratios = time.perf_counter(), []
            for robots in teams:
                spans = sum(run(EXPLORERS[name], *region, robots).makespan for region in regions)
                ratios.append(spans / sum(roi["lower_bound"][str(robots)] for roi in rois))
            took_s = (time.perf_counter() - began) / len(rois) / len(teams)
            print(row(name, *(f"{r:.3f}" for r in ratios), f"{took_s:.2f}"), flush=True)


if __name__ == "__main__":
    main()
