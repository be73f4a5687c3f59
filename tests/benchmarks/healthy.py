"""Flights in which nothing goes wrong: `python -m tests.benchmarks.healthy [--seeds 5]`.

The shipped missions and those of the tests, without any fault, on both autopilots where they are
small. Whatever a guardian does there is a false alarm, and so is an order that fails; the exit
status is 1 when there was one, or a flight was not complete.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from tests.benchmarks.watched import Flown, flown
from tests.support.plans import named_text

MISSIONS = ("runway", "runway-field", "spill", "tiny", "speck", "pair", "drift", "burn", "astray")
ON_PX4 = ("tiny", "speck", "pair", "drift")
ALARMS = ("order_failed", "guarded", "crashed", "overridden", "link_lost", "given_up")
DATA = Path(__file__).parents[1] / "data"


def fly(job: tuple[str, str, int]) -> Flown:
    """One flight."""
    mission, autopilot, seed = job
    path = DATA / f"{mission}.toml"
    text = named_text(str(path) if path.exists() else mission).text
    if autopilot != "ardupilot":
        text = text.replace("[sim]\n", f'[sim]\nautopilot = "{autopilot}"\n')
    return flown(f"{mission} {autopilot} seed {seed}", text, seed)


def main(arguments: list[str] | None = None) -> int:
    """Fly and print."""
    parser = argparse.ArgumentParser(description="Flights in which nothing goes wrong.")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--missions", nargs="+", choices=MISSIONS, default=MISSIONS)
    options = parser.parse_args(arguments)
    jobs = [
        (mission, autopilot, seed)
        for mission in options.missions
        for autopilot in ("ardupilot", *(("px4",) if mission in ON_PX4 else ()))
        for seed in range(1, options.seeds + 1)
    ]
    alarmed = 0
    with ProcessPoolExecutor(options.workers) as pool:
        for flight in pool.map(fly, jobs):
            alarms = [f"{flight.kinds[kind]} {kind}" for kind in ALARMS if flight.kinds[kind]]
            bad = bool(alarms) or flight.code != 0
            alarmed += bad
            print("ALARM" if bad else "fine ", *alarms, flight.line(), flush=True)
    print(f"{alarmed} of {len(jobs)} flights with an alarm")
    return int(alarmed > 0)


if __name__ == "__main__":
    sys.exit(main())
