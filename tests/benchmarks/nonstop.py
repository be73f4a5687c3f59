"""How long flight without stopping takes on grown regions, and what a decision of it takes.

python -m tests.benchmarks.nonstop                      # the table of docs/strategies.md
python -m tests.benchmarks.nonstop --count 5 --offline 3 --footprint 23
python -m tests.benchmarks.nonstop --case ragged:120:3 --planner-seeds 5
python -m tests.benchmarks.nonstop --decisions          # milliseconds of a plan, many cells
"""

from __future__ import annotations

import argparse
import math
import time
from statistics import fmean, stdev

from missions.arena.nonstop import Camera, Ground, Team, flown
from missions.arena.offline_reference import reference
from missions.arena.roi import Roi, grown
from missions.arena.survey import surveyed
from missions.swath.planner import Flyer, Planner, Tuning

FIRST_SEED = 910_000
"""Regions from here on; what the planner weighs was found on others."""
CASES = (
    ("eden", 120, 1), ("ragged", 120, 1), ("eden", 400, 1), ("ragged", 400, 1),
    ("eden", 120, 3), ("ragged", 120, 3), ("eden", 400, 3), ("ragged", 400, 3),
)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--offline", type=int, default=0, help="of so many regions a reference")
    parser.add_argument("--footprint", type=float, default=15.0)
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    parser.add_argument("--planner-seeds", type=int, default=1, help="runs of each region")
    parser.add_argument("--case", action="append", help="such as eden:120:3")
    parser.add_argument("--decisions", action="store_true")
    options = parser.parse_args()
    if options.decisions:
        decisions()
        return
    cases = CASES
    if options.case:
        parts = [case.split(":") for case in options.case]
        cases = tuple((kind, int(cells), int(robots)) for kind, cells, robots in parts)
    camera = Camera(options.footprint, options.footprint)
    print("kind cells robots   swath (s.e.)  missed   survey   offline  swath/offline  s a run")
    for kind, cells, robots in cases:
        rois = [grown(kind, cells, options.first_seed + i) for i in range(options.count)]
        print(
            f"{kind:7}{cells:5}{robots:5}   "
            f"{row(rois, Team(robots, camera), options.offline, options.planner_seeds)}",
            flush=True,
        )


def row(rois: list[Roi], team: Team, offline: int, planner_seeds: int) -> str:
    """Of each region the mean over seeds of the planner: two of them differ by some 10 %."""
    begin_s = time.perf_counter()
    seeds = range(1, planner_seeds + 1)
    found = [[flown(roi, team, seed=seed) for seed in seeds] for roi in rois]
    runs = [run for of_one in found for run in of_one]
    wall_s = (time.perf_counter() - begin_s) / len(runs)
    swath_s = [fmean(run.makespan_s for run in of_one) for of_one in found]
    error_s = stdev(swath_s) / math.sqrt(len(swath_s)) if len(swath_s) > 1 else 0.0
    survey_s = fmean(surveyed(roi, team).makespan_s for roi in rois)
    known = ""
    if offline:
        known_s = [reference(roi, team).makespan_s for roi in rois[:offline]]
        ratio = sum(swath_s[:offline]) / sum(known_s)
        known = f"{fmean(known_s):8.1f} {ratio:10.2f}"
    missed = sum(run.missed for run in runs)
    return (
        f"{fmean(swath_s):7.1f} ({error_s:4.1f}) {missed:6} {survey_s:9.1f} {known} {wall_s:9.2f}"
    )


def decisions() -> None:
    """Plans for a region of which nine tenths are known, from scratch and from the last plan."""
    camera = Camera(15.0, 15.0)
    kinematics = camera.kinematics(6.0, 2.5, 4.0)
    for cells, robots in ((2_000, 6), (20_000, 8)):
        roi = grown("eden", cells, FIRST_SEED)
        ground, planner = Ground(roi, 4.0, kinematics, camera), Planner(Tuning())
        chart, start = ground.chart, roi.start
        near = sorted(
            roi.cells, key=lambda c: (math.hypot(c.east - start.east, c.north - start.north), c)
        )
        for cell in near[: cells * 9 // 10]:
            chart.yes[chart.index(cell)] = camera.majority
            for beside in cell.neighbours():
                if beside not in roi.cells:
                    chart.no[chart.index(beside)] = camera.majority
        team = [Flyer(kinematics, ground.home, ground.home) for _ in range(robots)]
        took = []
        for turn in range(6):
            begin_s = time.process_time()
            valued = planner.worth(chart, chart.index(start), camera.frames, camera.majority)
            plan = planner.plan(chart, team, valued, 0.4 * turn, turn, [0.2] * robots)
            took.append(1e3 * (time.process_time() - begin_s))
            team = [
                Flyer(kinematics, f.place, f.end, path or f.path, route)
                for f, path, route in zip(team, plan.paths, plan.routes, strict=True)
            ]
        print(f"{cells} cells, {robots} vehicles: {', '.join(f'{ms:.0f}' for ms in took[1:])} ms")


if __name__ == "__main__":
    main()
