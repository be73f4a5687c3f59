"""Flights whose satellites are lost, drift or leap: how well they know where they are.

    python -m tests.benchmarks.gnss_loss                   all cases, ten seeds each; an hour
    python -m tests.benchmarks.gnss_loss --case lost --seeds 20
    python -m tests.benchmarks.gnss_loss --case drift --mission burn --gnss-loss rtl

Simulated flights of a shipped mission, with the camera, the wind and the noise that it ships with.
`off` is how far the place that the service reckons with is from the true one; `reckoned` the same
of the place that the autopilot tells. All figures are the simulator's truth.
"""

from __future__ import annotations

import argparse
import bisect
import math
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

import pytest

from missions.events import Navigated, Tracked
from missions.flight.setting import Setting
from missions.units import GridPoint
from sitl.vehicle import SimVehicle
from tests.support.plans import named_text, plan_of
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import JOURNAL, SIM_EPOCH_UTC_S
from uavmap.runner.flight import fly
from uavmap.runner.simulation import Truth

FLOW = "optical_flow = true\nodometry_drift = 0.02\n"
DRIFT = '[[sim.faults]]\nkind = "gps_drift"\nm_s = 0.1\nat_s = {at_s}\ntoward_deg = {deg}\n'
LEAP = '[[sim.faults]]\nkind = "gps_glitch"\nmetres = {metres}\nat_s = {at_s}\ntoward_deg = {deg}\n'
CASES = {
    "none": ("", ""),
    "none15": ("gps_sigma_m = 1.5\n", ""),
    "reckoned": (FLOW, '[[sim.faults]]\nkind = "gps"\nat_s = {at_s}\n'),
    "lost": (FLOW, '[[sim.faults]]\nkind = "gps"\nat_s = {at_s}\n'),
    "outage": (FLOW, '[[sim.faults]]\nkind = "gps"\nat_s = {at_s}\nfor_s = 40\n'),
    "drift": ("", DRIFT),
    "drift15": ("gps_sigma_m = 1.5\n", DRIFT),
    "leap": ("", LEAP.format(metres=4, at_s="{at_s}", deg="{deg}")),
    "leap20": ("", LEAP.format(metres=20, at_s="{at_s}", deg="{deg}")),
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Job:
    """One flight."""

    mission: str
    case: str
    gnss_loss: str
    seed: int
    at_s: float
    autopilot: str = "ardupilot"


@dataclass(slots=True)
class Course:
    """Where vehicles truly were, by mission time."""

    true: list[tuple[float, GridPoint, bool]] = field(default_factory=list)


def text_of(job: Job) -> str:
    """The mission file of a flight."""
    text = named_text(job.mission).text
    more, fault = CASES[job.case]
    fault = fault.format(at_s=job.at_s, deg=(job.seed * 77) % 360)
    if job.autopilot == "px4":
        more = f'autopilot = "px4"\n{more}parameters = {{ COM_POS_FS_EPH = -1 }}\n'
    text = text.replace("[sim]\n", f"[sim]\n{more}", 1)
    watch = "watch = false\n" if job.case == "reckoned" else ""
    return f'{text}\n[navigation]\ngnss_loss = "{job.gnss_loss}"\n{watch}{fault}'


def flown(job: Job) -> dict[str, Any]:
    """What came of a flight."""
    course = Course()
    watch = Truth.watch

    def watching(self: Truth, vehicles: Sequence[SimVehicle], setting: Setting) -> None:
        truth = vehicles[0].truth
        course.true.append((truth.t_s, setting.grid.fixed(truth.position), truth.landed))
        watch(self, vehicles, setting)

    plan = plan_of(
        job.mission, text_of(job), None, None, job.seed, (), None, SIM_EPOCH_UTC_S
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patched:
        patched.setattr(Truth, "watch", watching)
        summary = fly(plan, Path(folder))
        with Journal.open(Path(folder) / JOURNAL) as journal:
            events = list(journal.events())
    found = dict(summary)
    noticed = next((e for e in events if isinstance(e, Navigated) and e.gnss != "good"), None)
    found["noticed_s"] = None if noticed is None else noticed.t_s
    found["gnss"] = None if noticed is None else noticed.gnss
    off_m = [
        e.position.distance_to(_true(course, e.t_s))
        for e in events
        if isinstance(e, Tracked) and e.t_s > job.at_s and e.height_m > 3.0
    ]
    before = [
        e.position.distance_to(_true(course, e.t_s))
        for e in events
        if isinstance(e, Tracked) and noticed is not None and job.at_s < e.t_s <= noticed.t_s
    ]
    found["off_m"] = off_m
    found["noticed_off_m"] = before[-1] if before else None
    last = next(place for _, place, landed in reversed(course.true) if landed)
    found["pad_m"] = math.hypot(*last)
    return found


def _true(course: Course, t_s: float) -> GridPoint:
    """Where the vehicle truly was; between two looks on the straight line."""
    times = [at_s for at_s, _, _ in course.true]

    k = min(max(bisect.bisect_left(times, t_s), 1), len(times) - 1)
    (a_s, a, _), (b_s, b, _) = course.true[k - 1], course.true[k]
    share = min(max((t_s - a_s) / max(b_s - a_s, 1e-9), 0.0), 1.0)
    return GridPoint(
        a.east_m + share * (b.east_m - a.east_m), a.north_m + share * (b.north_m - a.north_m)
    )


def lines(jobs: Sequence[Job], workers: int) -> Iterator[str]:
    """A line for every flight, and one for each case."""
    with ProcessPoolExecutor(workers) as pool:
        cases: dict[tuple[str, str], list[dict[str, Any]]] = {}
        for job, found in zip(jobs, pool.map(flown, jobs), strict=True):
            cases.setdefault((job.case, job.gnss_loss), []).append(found)
            noticed = found["noticed_s"]
            after = "-" if noticed is None else f"{noticed - job.at_s:.0f}"
            off = found["noticed_off_m"]
            yield (
                f"{job.case} {job.gnss_loss} seed {job.seed} at {job.at_s:.0f}: "
                f"complete {found['completed']}, {found['makespan_s']:.0f} s, "
                f"noticed {found['gnss']} after {after} s"
                f" at {off if off is None else round(off, 1)} m, off p50 "
                f"{_share(found['off_m'], 0.5):.2f} p95 {_share(found['off_m'], 0.95):.2f} max "
                f"{max(found['off_m'], default=0.0):.2f}, pad {found['pad_m']:.2f} m, breaches "
                f"{found['fence_breaches']}, missed {found['cells_missed']}, IoU "
                f"{found['iou_cells']:.3f}, {found['navigation']} {found['notes']}"
            )
        for (case, gnss_loss), rows in cases.items():
            yield (
                f"{case} {gnss_loss}: {len(rows)} flights, {sum(r['completed'] for r in rows)} "
                f"complete, pad median {median(r['pad_m'] for r in rows):.2f} max "
                f"{max(r['pad_m'] for r in rows):.2f} m, breaches "
                f"{sum(r['fence_breaches'] for r in rows)}, IoU "
                f"{median(r['iou_cells'] for r in rows):.3f}, "
                f"noticed {sum(r['noticed_s'] is not None for r in rows)}"
            )


def _share(values: Sequence[float], share: float) -> float:
    return sorted(values)[min(int(share * len(values)), len(values) - 1)] if values else 0.0


def main() -> None:
    """Fly and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--mission", default="runway")
    parser.add_argument("--case", choices=CASES, action="append")
    parser.add_argument("--gnss-loss", default="map")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--at-s", type=float, default=None)
    parser.add_argument("--autopilot", default="ardupilot", choices=("ardupilot", "px4"))
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.seeds)
    jobs = [
        Job(
            given.mission,
            case,
            given.gnss_loss,
            seed,
            given.at_s or 100.0 + (seed * 37) % 60,
            given.autopilot,
        )
        for case in given.case or CASES
        for seed in seeds
    ]
    for line in lines(jobs, given.workers):
        print(line, flush=True)


if __name__ == "__main__":
    main()
