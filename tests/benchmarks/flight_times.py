"""What a flight takes by strategy, beside the survey that would be flown without one.

    python -m tests.benchmarks.flight_times                 docs/studies/flights.md; hours
    python -m tests.benchmarks.flight_times --quick         one seed of `runway`, 1 and 3 vehicles
    python -m tests.benchmarks.flight_times --mission burn --vehicles 3 --strategy swath --seeds 2

Every flight is a whole one in the simulator: take-off, search, exploration, battery swaps, way
home. A survey flies over all of a box without stopping and judges its cells by the same votes; the
time of both is the makespan, from the first lift-off to the last touch-down. Nobody who surveys
knows the outline, so there are two boxes: one drawn two cells around the true region (`tight`), and
one of 2.5 times its extent (`wide`). The other strategies search the mission's own box.

Flights are told by the median over the seeds, cells by the mean. `ratio` is to the tight survey by
as many vehicles. A flight that was not complete is counted in the last column.
"""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean, median
from typing import Any

from shapely.geometry import MultiPoint, Point, Polygon, box

from missions.geo.grid import Grid
from missions.mission.schema import positions
from missions.units import GridPoint
from tests.support.plans import named_text, plan_of
from uavmap.journal.flight_plan import SIM_EPOCH_UTC_S
from uavmap.load.mission_source import load
from uavmap.runner.flight import fly

MISSIONS = ("runway", "burn", "spill")
TIGHT, WIDE = "survey, tight", "survey, wide"
STRATEGIES = ("swath", TIGHT, WIDE, "horizon", "rdfs")
TEAMS = (1, 3, 6)
TIGHT_CELLS = 2
WIDE_FACTOR = 2.5
ROOM_M = 25.0
"""Between the box of a survey and its fence."""


@dataclass(frozen=True, slots=True)
class Job:
    """One flight."""

    mission: str
    vehicles: int
    strategy: str
    seed: int


# --- the boxes of surveys ----------------------------------------------------------------------
def survey_text(text: str, mission: str, strategy: str) -> str:
    """A mission with the box of a survey, along the grid, and a fence that holds it."""
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
    """The summary of a flight."""
    source = named_text(job.mission)
    text, strategy = source.text, job.strategy
    if strategy in (TIGHT, WIDE):
        text, strategy = survey_text(text, job.mission, strategy), "survey"
    plan = plan_of(source.source, text, strategy, job.vehicles, job.seed, (), None, SIM_EPOCH_UTC_S)
    with tempfile.TemporaryDirectory() as folder:
        return fly(plan, Path(folder))


def row(name: str, found: Sequence[dict[str, Any]], base_s: float | None) -> str:
    """A row of the table."""
    flown_s = median(f["makespan_s"] for f in found)
    ratio = "" if base_s is None else f"{flown_s / base_s:.2f}"
    incomplete = sum(not f["completed"] for f in found)
    return " | ".join(
        (
            f"| {name}",
            f"{flown_s / 60.0:.1f}",
            ratio,
            f"{median(f['exploration_s'] for f in found):.0f}",
            f"{median(f['sorties'] for f in found):g}",
            f"{fmean(f['cells_missed'] for f in found):.2g}",
            f"{100.0 * fmean(f['iou_cells'] for f in found):.1f}",
            f"{fmean(f['false_positives'] for f in found):.2g}",
            f"{fmean(f['false_negatives'] for f in found):.2g}",
            f"{incomplete or ''} |",
        )
    )


HEAD = (
    "| strategy | min | ratio | exploration, s | sorties | cells missed | IoU, % | "
    "false positives | false negatives | incomplete |"
)


def tables(jobs: Sequence[Job], workers: int) -> Iterator[str]:
    """Lines of Markdown: a table for each mission and team."""
    flown: dict[tuple[str, int], dict[str, list[dict[str, Any]]]] = {}
    with ProcessPoolExecutor(workers) as pool:
        for job, found in zip(jobs, pool.map(flight, jobs), strict=True):
            rows = flown.setdefault((job.mission, job.vehicles), {})
            rows.setdefault(job.strategy, []).append(found)
            print(job, f"{found['makespan_s']:.0f} s", file=sys.stderr, flush=True)
    for (mission, vehicles), rows in flown.items():
        yield f"\n{mission}, {vehicles} vehicle{'s' * (vehicles > 1)}\n"
        yield HEAD
        yield "|---" * HEAD.count(" | ") + "|---|"
        base = rows.get(TIGHT)
        base_s = None if base is None else median(f["makespan_s"] for f in base)
        for strategy, found in rows.items():
            yield row(strategy, found, base_s)


def main(arguments: list[str] | None = None) -> int:
    """Fly and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mission", action="append", choices=MISSIONS)
    parser.add_argument("--strategy", action="append", choices=STRATEGIES)
    parser.add_argument("--vehicles", action="append", type=int)
    parser.add_argument("--seeds", type=int, default=10, help="as many flights of each kind")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("--quick", action="store_true", help="one seed of a small part")
    options = parser.parse_args(arguments)
    jobs = [
        Job(mission, vehicles, strategy, seed)
        for mission in options.mission or (MISSIONS[:1] if options.quick else MISSIONS)
        for vehicles in options.vehicles or (TEAMS[:2] if options.quick else TEAMS)
        for strategy in options.strategy or STRATEGIES
        for seed in range(1, 2 if options.quick else options.seeds + 1)
    ]
    for line in tables(jobs, options.workers):
        print(line, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
