"""Every fault of the simulator in every phase: `python -m tests.benchmarks.faults`.

    [--seeds 1] [--workers 2] [--vehicles 1 3] [--only gps motor ...]

A small mission is flown with one fault, which begins in the search, in the exploration or on the
way home, and stays or ends after a while. A table by fault is printed; the exit status is 1 when
something forbidden happened: an aircraft in the air at the end, a crash or a landing elsewhere of
which nothing was said, a false "complete", a traceback, no end, a reserve that was touched, or a
fence that was left without a cause that no rule can see.
"""

from __future__ import annotations

import functools
import json
import sys
from collections.abc import Sequence
from typing import Any

from missions.events import Event, FrameSeen
from missions.flight.setting import Setting
from missions.flight.state import State
from missions.flight.step import step
from missions.orders import FlyTo
from tests.benchmarks import frame
from tests.benchmarks.watched import Flown, flown, mission_text, report
from tests.e2e.rig import mission
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import JOURNAL, FlightPlan

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
    source = mission(MISSION)
    with frame.flown(source, vehicles=vehicles) as (_, folder):
        with Journal.open(folder / JOURNAL) as journal:
            setting = FlightPlan.read(journal).known_setting()
        return _phases(setting, frame.events_of(folder), vehicles)


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
        if fault.startswith(tuple(only))
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


def main() -> int:
    """Fly and print."""
    options = frame.asked(__doc__, seeds=1, workers=2, vehicles=(1, 3), only=("",), verbose=False)
    todo = jobs(options.vehicles, options.seeds, options.only)
    found = frame.in_turn(fly, todo, options.workers)
    flights = ((fault, flight) for (fault, *_), flight in found)
    return int(report(flights, forbidden, verbose=options.verbose) > 0)


if __name__ == "__main__":
    sys.exit(main())
