"""Two vehicles without satellites, one tracks the other: how well they know where they are.

    python -m tests.benchmarks.planning.leapfrog          ten seeds, with the correction and without
    python -m tests.benchmarks.planning.leapfrog --seeds 3 --first 4 --only leapfrog

A box of 60 m x 40 m with the camera, the wind and the noise of the mission `runway`. Satellites are
lost for both 25 s after the start and do not come back. `frames` is how far the place that a
picture of the mapper is judged with is from the true one; `reckoned` the same of the place that its
autopilot tells on the same flight, by dead reckoning. Without the correction ("alone") the same
mission is flown and mapped by what the autopilots tell. `since` are both less what satellites erred
by when they were lost, which nothing corrects. All figures are the simulator's truth.
"""

from __future__ import annotations

import argparse
import re
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any, Final

import numpy as np
import pytest
from numpy.typing import NDArray

from missions.flight.setting import Setting
from missions.geo.grid import Grid
from missions.mission.schema import parse_fields
from missions.units import GridPoint
from sitl.vehicle import SimVehicle
from tests.support.plans import named_text, plan_of
from uavmap.aircraft.map_navigation import Navigation
from uavmap.journal.flight_plan import SIM_EPOCH_UTC_S
from uavmap.runner.flight import fly
from uavmap.runner.simulation import Truth
from vision.look import Frame

WAYS: Final = ("leapfrog", "alone")
MAPPER: Final = 1
Ring = Sequence[tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Job:
    """One flight."""

    way: str
    seed: int
    lost_s: float
    layer_m: float


@dataclass(slots=True)
class Seen:
    """What was watched: east, north and mission time of the mapper, and of its pictures."""

    true: list[tuple[float, float, float]] = field(default_factory=list)
    frames: list[tuple[float, float, float]] = field(default_factory=list)
    reckoned: list[tuple[float, float, float]] = field(default_factory=list)


def text_of(job: Job) -> str:
    """The mission file of a flight."""
    text = named_text("runway").text
    mission = parse_fields(text, "runway")
    grid = Grid.at(mission.home, mission.grid.cell_m)

    def ring(points: Ring) -> str:
        places = [grid.position(GridPoint(*point)) for point in points]
        return "[" + ", ".join(f"[{p.lat_deg:.7f}, {p.lon_deg:.7f}]" for p in places) + "]"

    box = ring([(10, 15), (70, 15), (70, 55), (10, 55)])
    fence = ring([(-15, -15), (90, -15), (90, 75), (-15, 75)])
    region = ring([(20, 22), (55, 27), (52, 45), (18, 40)])
    for pattern, shape in (
        (r"(box = )\[.*?\n\]", box),
        (r"(\[fence\].*?polygon = )\[.*?\n\]", fence),
        (r"(\[\[sim.roi\]\]\npolygon = )\[.*?\n\]", region),
    ):
        found = re.search(pattern, text, re.DOTALL)
        assert found is not None
        text = text[: found.start()] + found[1] + shape + text[found.end() :]
    text = text.replace('strategy = "swath"', 'strategy = "leapfrog"', 1)
    text = text.replace("capacity_wh = 60.0", "capacity_wh = 120.0", 1)
    text = text.replace("[[vehicles]]\n", "[[vehicles]]\n\n[[vehicles]]\n", 1)
    sim = "[sim]\noptical_flow = true\nodometry_drift = 0.02\n"
    tables = f'[team]\nlayer_m = {job.layer_m}\n\n[navigation]\ngnss_loss = "leapfrog"\n\n{sim}'
    text = text.replace("[sim]\n", tables, 1)
    faults = "".join(
        f'\n[[sim.faults]]\nkind = "gps"\nat_s = {job.lost_s}\nvehicle = {n}\n' for n in (1, 2)
    )
    return text + faults


def flown(job: Job) -> dict[str, Any]:
    """What came of a flight."""
    seen = Seen()
    watch, placed = Truth.watch, Navigation.placed

    def watching(self: Truth, vehicles: Sequence[SimVehicle], setting: Setting) -> None:
        truth = vehicles[MAPPER - 1].truth
        seen.true.append((truth.t_s, *setting.grid.fixed(truth.position)))
        watch(self, vehicles, setting)

    def placing(self: Navigation, frame: Frame) -> Frame:
        found = placed(self, frame)
        if self.by_map and self._reporter.number == MAPPER:
            grid = self._reporter.grid
            seen.frames.append((frame.t_s, *grid.fixed(found.pose.position)))
            seen.reckoned.append((frame.t_s, *grid.fixed(frame.pose.position)))
        return found

    plan = plan_of("box", text_of(job), None, None, job.seed, (), None, SIM_EPOCH_UTC_S)
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patched:
        patched.setattr(Truth, "watch", watching)
        patched.setattr(Navigation, "placed", placing)
        if job.way == "alone":
            patched.setattr(Navigation, "_correct", lambda self, off: None)
        summary = fly(plan, Path(folder))
    found = dict(summary)
    true = np.array(seen.true)
    reckoned, frames = (_off(np.array(p), true) for p in (seen.reckoned, seen.frames))
    for name, off in (("frames", frames), ("reckoned", reckoned)):
        found[name] = np.hypot(*off.T)
        found[f"{name}_since"] = np.hypot(*(off - reckoned[0]).T)
    return found


def _off(places: NDArray[np.float64], true: NDArray[np.float64]) -> NDArray[np.float64]:
    """By how much places are off at their times, metres east and north."""
    there = [np.interp(places[:, 0], true[:, 0], true[:, k]) for k in (1, 2)]
    return np.stack([places[:, 1] - there[0], places[:, 2] - there[1]], axis=1)


def lines(jobs: Sequence[Job], workers: int) -> Iterator[str]:
    """A line for every flight, and one for each way."""
    ways: dict[str, list[dict[str, Any]]] = {}
    with ProcessPoolExecutor(workers) as pool:
        for job, found in zip(jobs, pool.map(flown, jobs), strict=True):
            ways.setdefault(job.way, []).append(found)
            yield (
                f"{job.way} seed {job.seed}: complete {found['completed']}, "
                f"{found['makespan_s']:.0f} s, frames {_shares(found['frames'])}, reckoned "
                f"{_shares(found['reckoned'])}, since {_shares(found['frames_since'])} and "
                f"{_shares(found['reckoned_since'])}, IoU {found['iou_cells']:.3f}, missed "
                f"{found['cells_missed']}, breaches {found['fence_breaches']}, apart "
                f"{found['min_separation_m']:.1f} m, {found['navigation']} {found['notes']}"
            )
    for way, rows in ways.items():
        names = ("frames", "reckoned", "frames_since", "reckoned_since")
        frames, reckoned, since, drift = (np.concatenate([r[k] for r in rows]) for k in names)
        rms = [float(np.sqrt(np.mean(np.square(v)))) for v in (frames, reckoned, since, drift)]
        yield (
            f"{way}: {len(rows)} flights, {sum(r['completed'] for r in rows)} complete, frames "
            f"{_shares(frames)} rms {rms[0]:.2f}, reckoned {_shares(reckoned)} rms {rms[1]:.2f}, "
            f"since {_shares(since)} rms {rms[2]:.2f} and {_shares(drift)} rms {rms[3]:.2f}, "
            f"IoU {median(r['iou_cells'] for r in rows):.3f}, missed "
            f"{sum(r['cells_missed'] for r in rows)}, breaches "
            f"{sum(r['fence_breaches'] for r in rows)}, makespan "
            f"{median(r['makespan_s'] for r in rows):.0f} s"
        )


def _shares(values: NDArray[np.float64]) -> str:
    p50, p95, largest = np.percentile(values, [50, 95, 100])
    return f"p50 {p50:.2f} p95 {p95:.2f} max {largest:.2f} m"


def main() -> None:
    """Fly and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--only", choices=WAYS, action="append")
    parser.add_argument("--lost-s", type=float, default=25.0)
    parser.add_argument("--layer-m", type=float, default=12.0)
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    jobs = [
        Job(way, seed, given.lost_s, given.layer_m)
        for way in given.only or WAYS
        for seed in range(given.first, given.first + given.seeds)
    ]
    for line in lines(jobs, given.workers):
        print(line, flush=True)


if __name__ == "__main__":
    main()
