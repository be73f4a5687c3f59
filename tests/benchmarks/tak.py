"""Cost of a TAK link for the flight: time from a picture to the order, with the link and without.

    python -m tests.benchmarks.tak [--seeds 1 2 3 4]

`tiny` is flown in pairs as fast as possible, the first of a pair alternating. The link gets updates
twice a real second in any case. A listener accepts the events. Processor times are those of the
thread that flies; the load of another program increases them only by its use of the caches.
"""

from __future__ import annotations

import os
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tests.benchmarks.frame import flight_of, head, options_of, row, spread
from tests.benchmarks.mosaic import orders_timed
from tests.support.tak.tak_listener import Listener
from uavmap.journal.flight_plan import FlightPlan
from uavmap.runner.flight import fly
from uavmap.runner.operator.company import Company
from uavmap.ui.page.live_board import LiveBoard, Reader
from uavmap.ui.tak.tak_feed import UPDATE_S, open_tak_link

MISSION = "tests/data/tiny.toml"


def beside(url: str | None, plan: FlightPlan, folder: Path) -> dict[str, Any]:
    """Fly a plan, with a link beside it if there is a URL."""
    if url is None:
        return fly(plan, folder, Company())
    with open_tak_link(url, simulated=True) as feed:
        board = LiveBoard([Reader(feed, UPDATE_S, reports=True)], simulated=True)
        summary = fly(plan, folder, Company(onlookers=(board,)))
        board.close("the flight is over")
    return summary


def timed(url: str | None, seed: int) -> tuple[list[float], list[float]]:
    """Return the times from a picture to the order, ms: by the wall's clock, and of the processor.

    Those of the processor are of a second flight, which is the same.
    """
    found = []
    for clock in (time.perf_counter, time.thread_time):
        how: dict[str, Any] = {"strategy": "rdfs", "seed": seed}
        with orders_timed(clock) as orders, flight_of(MISSION, fly=partial(beside, url), **how):
            pass
        found.append(orders)
    return found[0], found[1]


def main() -> None:
    options = options_of(__doc__, seeds=(1, 2, 3, 4))
    pooled: dict[str, list[list[float]]] = {"without": [[], []], "with": [[], []]}
    ratios = []
    print(head("seed", "link", "picture to order, ms", "processor, ms", "orders", "load", "events"))
    with Listener() as listener:
        timed(None, options.seeds[0])  # compiles and imports
        for number, seed in enumerate(options.seeds):
            medians = {}
            for name in ("without", "with")[:: 1 if number % 2 else -1]:
                before = len(listener.events)
                both = timed(listener.url if name == "with" else None, seed)
                for all_of_them, orders in zip(pooled[name], both, strict=True):
                    all_of_them.extend(orders)
                medians[name] = np.array([np.median(orders) for orders in both])
                load, sent = f"{os.getloadavg()[0]:.1f}", len(listener.events) - before
                print(row(seed, name, *map(spread, both), len(both[0]), load, sent), flush=True)
            ratios.append(medians["with"] / medians["without"])
    for name, clocks in pooled.items():
        print(f"{name}: {spread(clocks[0])} ms; processor {spread(clocks[1])} ms; {len(clocks[0])}")
    for name, column in zip(("wall", "processor"), np.array(ratios).T, strict=True):
        print(
            f"{name}, with / without, medians of pairs: {np.median(column):.3f} ({spread(column)})"
        )


if __name__ == "__main__":
    main()
