"""Two vehicles without satellites, one tracks the other: the errors of their positions.

    python -m tests.benchmarks.planning.leapfrog          ten seeds, with the correction and without
    python -m tests.benchmarks.planning.leapfrog --seeds 3 --first 4 --only leapfrog

A box of 60 m x 40 m with the camera, the wind and the noise of the mission `runway`. Both vehicles
lose satellites for good 25 s after the start. `frames` is the error of the position with which a
picture of the mapper is judged. `reckoned` is the error of the position that its autopilot reports
on the same flight, by dead reckoning. Without the correction ("alone") the same mission is flown
and mapped by the autopilots' positions. `since` has both errors less the error of the satellites
when they were lost, which no measurement corrects. All figures are the simulator's truth.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import partial
from statistics import median
from typing import Any, Final, NamedTuple
from unittest import mock

import numpy as np
from numpy.typing import NDArray

from missions.flight.state import Setting
from missions.geo.grid import Grid
from missions.mission.schema import parse_fields
from missions.units import GridPoint
from sitl.vehicle import SimVehicle
from tests.benchmarks import frame
from tests.support.plans import named_text
from tests.support.small_missions import first_patch
from uavmap.aircraft.map_navigation import Navigation
from vision.projection import Frame

WAYS: Final = ("leapfrog", "alone")
MAPPER: Final = 1
ERRORS: Final = ("frames", "reckoned", "frames_since", "reckoned_since")
Ring = Sequence[tuple[float, float]]


class Job(NamedTuple):
    """One flight."""

    way: str
    seed: int


def text_of(lost_s: float, layer_m: float) -> str:
    """Return the mission file of the flights."""
    text = first_patch(named_text("runway").text)
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
    tables = f'[team]\nlayer_m = {layer_m}\n\n[navigation]\ngnss_loss = "leapfrog"\n\n{sim}'
    text = text.replace("[sim]\n", tables, 1)
    faults = "".join(
        f'\n[[sim.faults]]\nkind = "gps"\nat_s = {lost_s}\nvehicle = {n}\n' for n in (1, 2)
    )
    return text + faults


def fly_and_measure(job: Job, text: str) -> dict[str, Any]:
    """Return the summary of a flight, and the errors of the mapper's positions."""
    # time, east and north of the mapper, and of its pictures
    true: list[tuple[float, float, float]] = []
    frames: list[tuple[float, float, float]] = []
    reckoned: list[tuple[float, float, float]] = []
    placed = Navigation.add_frame

    def record(vehicles: Sequence[SimVehicle], setting: Setting) -> None:
        truth = vehicles[MAPPER - 1].truth
        true.append((truth.t_s, *setting.grid.fixed(truth.position)))

    def placing(self: Navigation, taken: Frame) -> Frame:
        found = placed(self, taken)
        if self.by_map and self._reporter.number == MAPPER:
            grid = self._reporter.grid
            frames.append((taken.t_s, *grid.fixed(found.pose.position)))
            reckoned.append((taken.t_s, *grid.fixed(taken.pose.position)))
        return found

    changes: dict[str, Any] = {"add_frame": placing}
    if job.way == "alone":
        changes["_correct"] = lambda self, off: None
    with frame.truth_shown(record), mock.patch.multiple(Navigation, **changes):
        found = frame.summary_of("box", text, seed=job.seed)
    off = {"frames": _off(frames, true), "reckoned": _off(reckoned, true)}
    for name, by in off.items():
        found[name] = np.hypot(*by.T)
        found[f"{name}_since"] = np.hypot(*(by - off["reckoned"][0]).T)
    return found


def _off(
    places: Sequence[tuple[float, float, float]], true: Sequence[tuple[float, float, float]]
) -> NDArray[np.float64]:
    """Return the errors of positions at their times, metres east and north."""
    at_s, *at = np.array(places).T
    t_s, *there = np.array(true).T
    return np.stack([a - np.interp(at_s, t_s, b) for a, b in zip(at, there, strict=True)], axis=1)


def line(job: Job, found: dict[str, Any]) -> str:
    """Return a line with the outcome of a flight."""
    errors = {name: frame.spread(found[name]) for name in ERRORS}
    return (
        f"{job.way} seed {job.seed}: complete {found['completed']}, {found['makespan_s']:.0f} s, "
        f"{errors}, IoU {found['iou_cells']:.3f}, missed {found['cells_missed']}, breaches "
        f"{found['fence_breaches']}, apart {found['min_separation_m']:.1f} m, "
        f"{found['navigation']} {found['notes']}"
    )


def together(way: str, rows: Sequence[dict[str, Any]]) -> str:
    """Return a line with the outcome of all flights of one kind."""
    values = {name: np.concatenate([r[name] for r in rows]) for name in ERRORS}
    errors = {
        name: f"{frame.spread(v)} rms {np.sqrt(np.mean(np.square(v))):.2f}"
        for name, v in values.items()
    }
    return (
        f"{way}: {len(rows)} flights, {sum(r['completed'] for r in rows)} complete, {errors}, IoU "
        f"{median(r['iou_cells'] for r in rows):.3f}, missed "
        f"{sum(r['cells_missed'] for r in rows)}, breaches "
        f"{sum(r['fence_breaches'] for r in rows)}, makespan "
        f"{median(r['makespan_s'] for r in rows):.0f} s"
    )


def main() -> None:
    """Fly and print."""
    options = frame.options_of(
        __doc__, seeds=10, first=1, only=WAYS, lost_s=25.0, layer_m=12.0, workers=2
    )
    seeds = range(options.first, options.first + options.seeds)
    jobs = [Job(way, seed) for way in options.only for seed in seeds]
    work = partial(fly_and_measure, text=text_of(options.lost_s, options.layer_m))
    ways: dict[str, list[dict[str, Any]]] = {}
    for job, found in frame.in_turn(work, jobs, options.workers):
        ways.setdefault(job.way, []).append(found)
        print(line(job, found), flush=True)
    for way, rows in ways.items():
        print(together(way, rows))


if __name__ == "__main__":
    main()
