"""Duration of a flight by strategy, beside a survey of the same region.

    python -m tests.benchmarks.flight_times                 docs/studies/flights.md; hours
    python -m tests.benchmarks.flight_times --quick         one seed of `runway`, 1 and 3 vehicles
    python -m tests.benchmarks.flight_times --mission burn --vehicles 3 --strategy swath --seeds 2

Every flight is a whole one in the simulator: take-off, search, exploration, battery swaps and
return. A survey flies over all of a box without stopping and judges its cells by the same votes.
The time of both is the makespan, from the first lift-off to the last touch-down. A survey does not
know the outline, so there are two boxes. `tight` is drawn two cells around the true region; `wide`
has 2.5 times its extent. The other strategies search the mission's own box.

Times are medians over the seeds, cells are means. `ratio` is to the tight survey by as many
vehicles. A flight that was not complete is counted in the last column.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from statistics import fmean, median
from typing import Any, NamedTuple

from shapely.geometry import MultiPoint, Point, Polygon, box

from missions.geo.grid import Grid
from missions.mission.schema import positions
from missions.units import GridPoint
from tests.benchmarks import frame
from tests.support.plans import named_text
from tests.support.small_missions import first_patch
from uavmap.load.mission_source import load

MISSIONS = ("runway", "burn", "spill")
TIGHT, WIDE = "survey, tight", "survey, wide"
STRATEGIES = ("swath", TIGHT, WIDE, "horizon", "rdfs")
TEAMS = (1, 3, 6)
TIGHT_CELLS = 2
WIDE_FACTOR = 2.5
ROOM_M = 25.0
"""Distance between the box of a survey and its fence, m."""


class Job(NamedTuple):
    mission: str
    vehicles: int
    strategy: str
    seed: int


# --- the boxes of surveys ----------------------------------------------------------------------
def survey_text(text: str, mission: str, strategy: str) -> str:
    """Return a mission with the box of a survey, along the grid, and a fence around it."""
    made = load(mission)
    grid = Grid.at(made.home, made.grid.cell_m)
    region = MultiPoint([grid.fixed(p) for roi in made.sim.roi for p in positions(roi.polygon)])
    west, south, east, north = region.bounds
    if strategy == TIGHT:
        more_e = more_n = TIGHT_CELLS * made.grid.cell_m
    else:
        more_e = (WIDE_FACTOR - 1.0) / 2.0 * (east - west)
        more_n = (WIDE_FACTOR - 1.0) / 2.0 * (north - south)
    searched = box(west - more_e, south - more_n, east + more_e, north + more_n)
    fence = Polygon([grid.fixed(p) for p in positions(made.fence.polygon)])
    home = Point(grid.fixed(made.home))
    wide = fence.union(searched.buffer(ROOM_M)).union(home.buffer(ROOM_M)).convex_hull
    text = re.sub(r"(?ms)^box = \[.*?^\]", "box = " + _ring(grid, searched), text, count=1)
    return re.sub(r"(?ms)^polygon = \[.*?^\]", "polygon = " + _ring(grid, wide), text, count=1)


def _ring(grid: Grid, polygon: Polygon) -> str:
    places = [grid.position(GridPoint(*p)) for p in list(polygon.exterior.coords)[:-1]]
    return "[" + ", ".join(f"[{p.lat_deg:.8f}, {p.lon_deg:.8f}]" for p in places) + "]"


# --- flights -----------------------------------------------------------------------------------
def flight(job: Job) -> dict[str, Any]:
    text, strategy = first_patch(named_text(job.mission).text), job.strategy
    if strategy in (TIGHT, WIDE):
        text, strategy = survey_text(text, job.mission, strategy), "survey"
    return frame.summary_of(
        job.mission, text, strategy=strategy, vehicles=job.vehicles, seed=job.seed
    )


HEAD = frame.head(
    "strategy", "min", "ratio", "exploration, s", "sorties", "cells missed", "IoU, %",
    "false positives", "false negatives", "incomplete",
)  # fmt: skip


def row(name: str, found: Sequence[dict[str, Any]], base_s: float | None) -> str:
    values = {key: [f[key] for f in found] for key in found[0]}
    flown_s = median(values["makespan_s"])
    return frame.row(
        name,
        f"{flown_s / 60.0:.1f}",
        "" if base_s is None else f"{flown_s / base_s:.2f}",
        f"{median(values['exploration_s']):.0f}",
        f"{median(values['sorties']):g}",
        f"{fmean(values['cells_missed']):.2g}",
        f"{100.0 * fmean(values['iou_cells']):.1f}",
        f"{fmean(values['false_positives']):.2g}",
        f"{fmean(values['false_negatives']):.2g}",
        values["completed"].count(False) or "",
    )


def main() -> None:
    options = frame.options_of(
        __doc__, mission=MISSIONS, strategy=STRATEGIES, vehicles=TEAMS, seeds=10, workers=1,
        quick=False,
    )  # fmt: skip
    if options.quick:
        options.mission, options.vehicles, options.seeds = MISSIONS[:1], TEAMS[:2], 1
    jobs = [
        Job(mission, vehicles, strategy, seed)
        for mission in options.mission
        for vehicles in options.vehicles
        for strategy in options.strategy
        for seed in range(1, options.seeds + 1)
    ]
    flown: dict[tuple[str, int], dict[str, list[dict[str, Any]]]] = {}
    for job, found in frame.in_turn(flight, jobs, options.workers):
        rows = flown.setdefault((job.mission, job.vehicles), {})
        rows.setdefault(job.strategy, []).append(found)
        print(job, f"{found['makespan_s']:.0f} s", file=sys.stderr, flush=True)
    for (mission, vehicles), rows in flown.items():
        print(f"\n{mission}, {vehicles} vehicle{'s' * (vehicles > 1)}\n\n{HEAD}")
        base_s = median(f["makespan_s"] for f in rows[TIGHT]) if TIGHT in rows else None
        for strategy, several in rows.items():
            print(row(strategy, several, base_s))


if __name__ == "__main__":
    main()
