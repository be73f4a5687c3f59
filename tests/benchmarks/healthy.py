"""Flights in which nothing goes wrong: `python -m tests.benchmarks.healthy [--seeds 5]`.

The shipped missions and those of the tests, without any fault, on both autopilots where they are
small. Whatever a guardian does there is a false alarm, and so is an order that fails; the exit
status is 1 when there was one, or a flight was not complete.
"""

from __future__ import annotations

import sys

from tests.benchmarks.frame import asked, in_turn
from tests.benchmarks.watched import Flown, flown, report
from tests.e2e.rig import MISSIONS as DATA
from tests.support.plans import named_text

MISSIONS = ("runway", "runway-field", "spill", "tiny", "speck", "pair", "drift", "burn", "astray")
ON_PX4 = ("tiny", "speck", "pair", "drift")
ALARMS = ("order_failed", "guarded", "crashed", "overridden", "link_lost", "given_up")


def fly(job: tuple[str, str, int]) -> Flown:
    """One flight."""
    mission, autopilot, seed = job
    path = DATA / f"{mission}.toml"
    text = named_text(str(path) if path.exists() else mission).text
    if autopilot != "ardupilot":
        text = text.replace("[sim]\n", f'[sim]\nautopilot = "{autopilot}"\n')
    return flown(f"{mission} {autopilot} seed {seed}", text, seed)


def alarms(flight: Flown) -> list[str]:
    """What a flight without a fault should not have."""
    found = [f"{flight.kinds[kind]} {kind}" for kind in ALARMS if flight.kinds[kind]]
    return found or ["not complete"] * (flight.code != 0)


def main() -> int:
    """Fly and print."""
    options = asked(__doc__, seeds=5, workers=2, missions=MISSIONS)
    jobs = [
        (mission, autopilot, seed)
        for mission in options.missions
        for autopilot in ("ardupilot", *(("px4",) if mission in ON_PX4 else ()))
        for seed in range(1, options.seeds + 1)
    ]
    found = in_turn(fly, jobs, options.workers)
    return int(report(((job[0], flight) for job, flight in found), alarms, verbose=True) > 0)


if __name__ == "__main__":
    sys.exit(main())
