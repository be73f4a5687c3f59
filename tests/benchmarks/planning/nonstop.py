"""How long flight without stopping takes on grown regions, and what a decision of it takes.

python -m tests.benchmarks.planning.nonstop                      # the table of docs/strategies.md
python -m tests.benchmarks.planning.nonstop --count 5 --offline 3 --footprint 23
python -m tests.benchmarks.planning.nonstop --case ragged:120:3 --planner-seeds 5
python -m tests.benchmarks.planning.nonstop --decisions      # large regions: milliseconds of a plan
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Sequence
from statistics import fmean, stdev

from missions.lab.arena.nonstop import Camera, Run, Team, flown
from missions.lab.arena.offline_reference import reference
from missions.lab.arena.roi import Roi, grown
from missions.lab.arena.survey import surveyed
from missions.planning.sweep.chart import Chart, Flags
from missions.planning.sweep.memo import warm_up
from missions.planning.sweep.paths import Ints
from missions.planning.sweep.planned_team import Flyer, Tuning, Valued
from missions.planning.sweep.sweep_planner import Plan, Planner

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


class _Timed(Planner):
    """A planner that keeps the processor time of each of its plans, milliseconds."""

    def __init__(self, tuning: Tuning) -> None:
        super().__init__(tuning)
        self.took_ms: list[float] = []

    def worth(
        self, chart: Chart, root: int, frames: int, majority: int, asked: Flags | None = None
    ) -> Valued:
        begin_s = time.process_time()
        valued = super().worth(chart, root, frames, majority, asked)
        self.took_ms.append(1e3 * (time.process_time() - begin_s))
        return valued

    def plan(
        self,
        chart: Chart,
        team: Sequence[Flyer],
        valued: Valued,
        begin_s: float,
        seed: int,
        next_frame_s: Sequence[float],
        coming: Ints | None = None,
    ) -> Plan:
        start_s = time.process_time()
        plan = super().plan(chart, team, valued, begin_s, seed, next_frame_s, coming)
        self.took_ms[-1] += 1e3 * (time.process_time() - start_s)
        return plan


def decisions() -> None:
    """Whole explorations of large regions, and how long each of their plans took."""
    warm_up()
    for cells, robots in ((2_000, 6), (20_000, 8)):
        planner, team = _Timed(Tuning()), Team(robots, Camera(15.0, 15.0))
        begin_s = time.process_time()
        run = Run(team.over(grown("eden", cells, FIRST_SEED)), robots, planner).fly()
        whole_s = time.process_time() - begin_s
        took_ms = sorted(planner.took_ms)
        print(
            f"{cells} cells, {robots} vehicles: T {run.makespan_s:.0f} s, {run.missed} missed, "
            f"{run.decisions} plans, median {took_ms[len(took_ms) // 2]:.0f} ms, "
            f"95 % {took_ms[len(took_ms) * 95 // 100]:.0f} ms, most {took_ms[-1]:.0f} ms; "
            f"{whole_s:.0f} s of the processor in all",
            flush=True,
        )


if __name__ == "__main__":
    main()
