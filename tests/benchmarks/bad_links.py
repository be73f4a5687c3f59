"""Flights over bad links, the camera on the same link: `python -m tests.benchmarks.bad_links`.

    [--seeds 20] [--workers 2] [--mission tiny] [--links loss=0.2 delay_s=0.6,jitter_s=0.3 ...]

Loss, duplicates, disorder, delay and damage hold for the whole flight, in both directions, and for
every frame. A table is printed; the exit status is 1 when an aircraft was left in the air, a flight
had no end, or a traceback was shown.
"""

from __future__ import annotations

import sys
from functools import partial

from tests.benchmarks.frame import asked, in_turn
from tests.benchmarks.watched import Flown, flown, mission_text, report

LINKS = (
    "loss=0.1", "loss=0.2", "loss=0.3", "loss=0.4", "loss=0.5", "loss=0.6",
    "duplicate=0.5", "reorder=0.5", "delay_s=0.6", "delay_s=2.0", "jitter_s=3.0",
    "corrupt=0.1", "corrupt=0.4",
    "delay_s=0.3,jitter_s=0.5,reorder=0.3,duplicate=0.3,loss=0.2,corrupt=0.1",
)  # fmt: skip
FORBIDDEN = frozenset({"air", "lie", "unrep", "end", "tb", "res", "breach"})


def fly(job: tuple[str, int], mission: str = "tiny") -> Flown:
    link, seed = job
    quality = {key: float(value) for key, value in (part.split("=") for part in link.split(","))}
    fault = {"kind": "link", "at_s": 0.0, **quality}
    return flown(f"{link} seed {seed}", mission_text(mission, [fault]), seed)


def main() -> int:
    options = asked(__doc__, seeds=20, workers=2, links=LINKS, mission="tiny")
    jobs = [(link, seed) for link in options.links for seed in range(1, options.seeds + 1)]
    found = in_turn(partial(fly, mission=options.mission), jobs, options.workers)
    flights = ((link, flight) for (link, _), flight in found)
    return int(report(flights, lambda flight: flight.columns & FORBIDDEN) > 0)


if __name__ == "__main__":
    sys.exit(main())
