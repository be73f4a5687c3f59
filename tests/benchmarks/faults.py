"""Every fault of the simulator in every phase: `python -m tests.benchmarks.faults`.

    [--seeds 1] [--workers 2] [--vehicles 1 3] [--only gps motor ...]

A small mission is flown with one fault, which begins in the search, in the exploration or on the
way home, and stays or ends after a while. A table by fault is printed; the exit status is 1 when
something forbidden happened: an aircraft in the air at the end, a crash or a landing elsewhere of
which nothing was said, a false "complete", a traceback, no end, a reserve that was touched, or a
fence that was left without a cause that no rule can see.
"""

from __future__ import annotations

import argparse
import functools
import json
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from missions.events import Event, FrameSeen
from missions.flight.setting import Setting
from missions.flight.state import State
from missions.flight.step import step
from missions.orders import FlyTo
from tests.benchmarks.watched import EXPLAINED, Flown, flown, mission_text, table
from tests.support.plans import named_text, plan_of
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import JOURNAL, SIM_EPOCH_UTC_S
from uavmap.runner.flight import fly as fly_plan

MISSION = "tiny"
PHASES = ("search", "explore", "return")
FAULTS: dict[str, dict[str, Any]] = {
    "gps": {},
    "gps_glitch metres=50": {},
    "gps_drift m_s=2": {},
    "battery_sag volts=4": {},
    "battery_sag volts=12": {},
    "battery_cell": {"for_s": (None,)},
    "compass deg=20": {},
    "compass deg=90": {},
    "wind_gust m_s=12": {},
    "wind_gust m_s=25": {},
    "motor share=0.0": {"for_s": (None,)},
    "motor share=0.7": {},
    "camera_stall": {},
    "camera_black": {},
    "camera_corrupt": {},
    "rc": {},
    "reject command=192": {},
    "reject command=2000": {},
    "reject command=21": {},
    "reject command=176": {},
    "reject command=20": {},
    "link silent=true": {"for_s": (8.0, 100.0, None)},
    "companion_reboot": {"for_s": (20.0,)},
}
"""Kind and values, and how long it lasts (default: 30 s, and to the end)."""
FOR_S = (None, 30.0)
UNSEEN = ("gps", "compass deg=90", "wind_gust", "motor share=0.0")
"""Where a vehicle may leave its fence: GNSS that lies or is gone, a heading far off, more wind than
the airframe holds, no thrust."""
FORBIDDEN = frozenset({"air", "lie", "unrep", "end", "tb", "late", "far"})

Job = tuple[str, str, float | None, int, int]


@functools.cache
def begins(vehicles: int) -> dict[str, float]:
    """When each phase is in full swing for the vehicle with the fault, without any fault."""
    source = named_text(mission_path())
    plan = plan_of(
        source.source, source.text, None, vehicles, 1, (), None, SIM_EPOCH_UTC_S
    )  # fmt: skip
    setting = plan.setting(lambda text: None)
    with tempfile.TemporaryDirectory() as folder:
        fly_plan(plan, Path(folder))
        with Journal.open(Path(folder) / JOURNAL) as journal:
            return _phases(setting, list(journal.events()), vehicles)


def mission_path() -> str:
    return str(Path(__file__).parents[1] / "data" / f"{MISSION}.toml")


def _phases(setting: Setting, events: Sequence[Event], vehicles: int) -> dict[str, float]:
    state, number = State.initial(setting), min(vehicles, 2)
    found: dict[str, float] = {}
    for event in events:
        state, _ = step(setting, state, event)
        vehicle = state.vehicles[number]
        if isinstance(event, FrameSeen) and event.vehicle == number:
            found.setdefault("search", event.t_s + 1.0)
        if state.found_s is not None:
            found.setdefault("explore", state.found_s + 8.0)
        if vehicle.return_reason is not None and isinstance(vehicle.order, FlyTo):
            found.setdefault("return", event.t_s + 1.5)
    return found


def jobs(vehicles: Sequence[int], seeds: int, only: Sequence[str]) -> list[Job]:
    """All flights: fault, phase, how long, vehicles, seed."""
    return [
        (fault, phase, for_s, count, seed)
        for fault, how in FAULTS.items()
        if not only or any(fault.startswith(word) for word in only)
        for count in vehicles
        for phase in PHASES
        for for_s in how.get("for_s", FOR_S)
        for seed in range(1, seeds + 1)
    ]


def fly(job: Job) -> Flown:
    """One flight with one fault."""
    fault, phase, for_s, vehicles, seed = job
    kind, *values = fault.split()
    told: dict[str, Any] = {
        "kind": kind,
        "vehicle": min(vehicles, 2),
        "at_s": round(begins(vehicles)[phase], 1),
        **{key: json.loads(value) for key, value in (part.split("=") for part in values)},
    }
    if for_s is not None:
        told["for_s"] = for_s
    if kind == "wind_gust":
        told["from_deg"] = 45.0 + 120.0 * (seed + PHASES.index(phase))
    name = f"{fault} in {phase} for {for_s or 'ever'} vehicles {vehicles} seed {seed}"
    return flown(name, mission_text(MISSION, [told]), seed, "--vehicles", str(vehicles))


def forbidden(flight: Flown) -> frozenset[str]:
    """What must not be, of what came of it."""
    # no charge is left, or nobody can tell it to come home
    spent = flight.name.startswith(("battery_cell", "link silent")) and "ever" in flight.name
    more = set() if spent else {"res"}
    if not flight.name.startswith(UNSEEN):
        more |= {"breach"}
    # a slow, steady lie of position and speed alike looks like wind: the map is where GNSS says
    unseen = {"lie"} if flight.name.startswith("gps_drift") else set()
    return flight.columns & (FORBIDDEN | more) - unseen


def main(arguments: list[str] | None = None) -> int:
    """Fly and print."""
    parser = argparse.ArgumentParser(description="Every fault in every phase.")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--vehicles", type=int, nargs="+", default=[1, 3])
    parser.add_argument("--only", nargs="+", default=[])
    parser.add_argument("--verbose", action="store_true", help="a line for every flight")
    options = parser.parse_args(arguments)
    rows, bad = [], 0
    todo = jobs(options.vehicles, options.seeds, options.only)
    with ProcessPoolExecutor(options.workers) as pool:
        for (fault, *_), flight in zip(todo, pool.map(fly, todo), strict=True):
            rows.append((fault, flight))
            wrong = forbidden(flight)
            bad += bool(wrong)
            if wrong or options.verbose:
                print(*(["FORBIDDEN", *sorted(wrong)] if wrong else []), flight.line(), flush=True)
    print(table(rows), EXPLAINED, sep="\n\n")
    print(f"{bad} of {len(rows)} flights with something forbidden")
    return int(bool(bad))


if __name__ == "__main__":
    sys.exit(main())
