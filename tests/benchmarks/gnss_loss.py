"""Flights whose satellites are lost, drift or leap: the errors of their positions.

    python -m tests.benchmarks.gnss_loss                   all cases, ten seeds each; an hour
    python -m tests.benchmarks.gnss_loss --case lost --seeds 20
    python -m tests.benchmarks.gnss_loss --case drift --mission burn --gnss-loss rtl

Simulated flights of a shipped mission, with its camera, wind and noise. `off` is the error of the
position that the service uses; `reckoned` is that of the position that the autopilot reports. All
figures are the simulator's truth.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from missions.events import Navigated, Tracked
from missions.flight.state import Setting
from sitl.vehicle import SimVehicle
from tests.benchmarks import frame
from tests.support.plans import named_text
from tests.support.small_missions import first_patch

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


class Job(NamedTuple):
    case: str
    seed: int
    at_s: float


def text_of(job: Job, mission: str, gnss_loss: str, autopilot: str) -> str:
    more, fault = CASES[job.case]
    fault = fault.format(at_s=job.at_s, deg=(job.seed * 77) % 360)
    if autopilot == "px4":
        more = f'autopilot = "px4"\n{more}parameters = {{ COM_POS_FS_EPH = -1 }}\n'
    text = first_patch(named_text(mission).text).replace("[sim]\n", f"[sim]\n{more}", 1)
    watch = "watch = false\n" if job.case == "reckoned" else ""
    return f'{text}\n[navigation]\ngnss_loss = "{gnss_loss}"\n{watch}{fault}'


def fly_and_measure(job: Job, mission: str, gnss_loss: str, autopilot: str) -> dict[str, Any]:
    """Return the summary of a flight, and the errors of its positions."""
    course: list[tuple[float, float, float]] = []
    pad_m = math.nan

    def record(vehicles: Sequence[SimVehicle], setting: Setting) -> None:
        nonlocal pad_m
        truth = vehicles[0].truth
        course.append((truth.t_s, *setting.grid.fixed(truth.position)))
        if truth.landed:
            pad_m = math.hypot(*course[-1][1:])

    text = text_of(job, mission, gnss_loss, autopilot)
    with (
        frame.truth_shown(record),
        frame.flight_of(mission, text, seed=job.seed) as (summary, folder),
    ):
        events = frame.events_of(folder)
    noticed = next((e for e in events if isinstance(e, Navigated) and e.gnss != "good"), None)
    tracked = [e for e in events if isinstance(e, Tracked) and e.t_s > job.at_s]
    t_s, east, north = np.array(course).T
    off_m = {
        e.t_s: math.hypot(
            e.position.east_m - np.interp(e.t_s, t_s, east),
            e.position.north_m - np.interp(e.t_s, t_s, north),
        )
        for e in tracked
    }
    before = [] if noticed is None else [m for at_s, m in off_m.items() if at_s <= noticed.t_s]
    return summary | {
        "noticed_s": None if noticed is None else noticed.t_s,
        "gnss": None if noticed is None else noticed.gnss,
        "off_m": [off_m[e.t_s] for e in tracked if e.height_m > 3.0],
        "noticed_off_m": round(before[-1], 1) if before else None,
        "pad_m": pad_m,
    }


def line(job: Job, found: dict[str, Any]) -> str:
    noticed = found["noticed_s"]
    after = "-" if noticed is None else f"{noticed - job.at_s:.0f}"
    return (
        f"{job.case} seed {job.seed} at {job.at_s:.0f}: complete {found['completed']}, "
        f"{found['makespan_s']:.0f} s, noticed {found['gnss']} after {after} s at "
        f"{found['noticed_off_m']} m, off {frame.spread(found['off_m'])}, pad "
        f"{found['pad_m']:.2f} m, breaches {found['fence_breaches']}, missed "
        f"{found['cells_missed']}, IoU {found['iou_cells']:.3f}, {found['navigation']} "
        f"{found['notes']}"
    )


def together(case: str, rows: Sequence[dict[str, Any]]) -> str:
    pads_m = [r["pad_m"] for r in rows]
    return (
        f"{case}: {len(rows)} flights, {sum(r['completed'] for r in rows)} complete, pad median "
        f"{median(pads_m):.2f} max {max(pads_m):.2f} m, breaches "
        f"{sum(r['fence_breaches'] for r in rows)}, IoU "
        f"{median(r['iou_cells'] for r in rows):.3f}, noticed "
        f"{sum(r['noticed_s'] is not None for r in rows)}"
    )


def main() -> None:
    options = frame.options_of(
        __doc__, mission="runway", case=tuple(CASES), gnss_loss="map", seeds=10, first=1,
        at_s=float, autopilot="ardupilot", workers=2,
    )  # fmt: skip
    jobs = [
        Job(case, seed, options.at_s or 100.0 + (seed * 37) % 60)
        for case in options.case
        for seed in range(options.first, options.first + options.seeds)
    ]
    work = partial(
        fly_and_measure,
        mission=options.mission,
        gnss_loss=options.gnss_loss,
        autopilot=options.autopilot,
    )
    cases: dict[str, list[dict[str, Any]]] = {}
    for job, found in frame.in_turn(work, jobs, options.workers):
        cases.setdefault(job.case, []).append(found)
        print(line(job, found), flush=True)
    for case, rows in cases.items():
        print(together(case, rows))


if __name__ == "__main__":
    main()
