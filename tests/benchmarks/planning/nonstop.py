"""Time of flight without stopping on grown regions, and of its decisions.

    python -m tests.benchmarks.planning.nonstop
    python -m tests.benchmarks.planning.nonstop --count 5 --offline 3 --footprint 23
    python -m tests.benchmarks.planning.nonstop --case ragged:120:3 --planner-seeds 5
    python -m tests.benchmarks.planning.nonstop --decisions   large regions: ms of a plan

The first command prints the table of docs/explanation/paths.md.
"""

from __future__ import annotations

import math
import time
from statistics import fmean, stdev
from typing import Any

from missions.lab.arena.nonstop import Camera, Run, Team, fly_team
from missions.lab.arena.roi import Roi, grown
from missions.lab.arena.survey import surveyed
from missions.lab.arena.time_bounds import reference
from missions.planning.sweep.memo import warm_up
from missions.planning.sweep.paths import Plan, Tuning, Valued
from missions.planning.sweep.sweep_planner import Planner
from tests.benchmarks import frame
from tests.benchmarks.frame import options_of

FIRST_SEED = 910_000
"""First seed of the regions; the planner's weights were chosen on other regions."""
CASES = tuple(
    f"{kind}:{cells}:{robots}"
    for robots in (1, 3)
    for cells in (120, 400)
    for kind in ("eden", "ragged")
)
"""Cases: kind, cells, robots."""


def row(case: str, rois: list[Roi], team: Team, offline: int, planner_seeds: int) -> str:
    """Return a row with the means over planner seeds, two of which differ by some 10 %."""
    begin_s = time.perf_counter()
    seeds = range(1, planner_seeds + 1)
    found = [[fly_team(roi, team, seed=seed) for seed in seeds] for roi in rois]
    runs = [run for of_one in found for run in of_one]
    wall_s = (time.perf_counter() - begin_s) / len(runs)
    swath_s = [fmean(run.makespan_s for run in of_one) for of_one in found]
    error_s = stdev(swath_s) / math.sqrt(len(swath_s)) if len(swath_s) > 1 else 0.0
    survey_s = fmean(surveyed(roi, team).makespan_s for roi in rois)
    known = ("", "")
    if offline:
        known_s = [reference(roi, team).makespan_s for roi in rois[:offline]]
        known = (f"{fmean(known_s):.1f}", f"{sum(swath_s[:offline]) / sum(known_s):.2f}")
    swath = f"{fmean(swath_s):.1f} ({error_s:.1f})"
    missed = sum(run.missed for run in runs)
    return frame.row(case, swath, missed, f"{survey_s:.1f}", *known, f"{wall_s:.2f}")


class _Timed(Planner):
    """A planner that keeps the processor time of each of its plans, milliseconds."""

    def __init__(self, tuning: Tuning) -> None:
        super().__init__(tuning)
        self.took_ms: list[float] = []

    def worth(self, *given: Any) -> Valued:
        begin_s = time.process_time()
        valued = super().worth(*given)
        self.took_ms.append(1e3 * (time.process_time() - begin_s))
        return valued

    def plan(self, *given: Any) -> Plan:
        begin_s = time.process_time()
        plan = super().plan(*given)
        self.took_ms[-1] += 1e3 * (time.process_time() - begin_s)
        return plan


def decisions() -> None:
    """Explore large regions whole; return the durations of all plans."""
    warm_up()
    for cells, robots in ((2_000, 6), (20_000, 8)):
        planner, team = _Timed(Tuning()), Team(robots, Camera(15.0, 15.0))
        begin_s = time.process_time()
        run = Run(team.over(grown("eden", cells, FIRST_SEED)), robots, planner).fly()
        whole_s = time.process_time() - begin_s
        print(
            f"{cells} cells, {robots} vehicles: T {run.makespan_s:.0f} s, {run.missed} missed, "
            f"{run.decisions} plans, ms: {frame.spread(planner.took_ms)}; {whole_s:.0f} s of the "
            "processor in all",
            flush=True,
        )


def main() -> None:
    """Print the table, or the durations of plans."""
    options = options_of(
        __doc__, count=20, offline=0, footprint=15.0, first_seed=FIRST_SEED, planner_seeds=1,
        case=CASES, decisions=False,
    )  # fmt: skip
    if options.decisions:
        decisions()
        return
    camera = Camera(options.footprint, options.footprint)
    columns = ("swath (s.e.)", "missed", "survey", "offline", "swath/offline", "s a run")
    print(frame.head("case", *columns))
    for case in options.case:
        kind, cells, robots = case.split(":")
        rois = [grown(kind, int(cells), options.first_seed + i) for i in range(options.count)]
        team = Team(int(robots), camera)
        print(row(case, rois, team, options.offline, options.planner_seeds), flush=True)


if __name__ == "__main__":
    main()
