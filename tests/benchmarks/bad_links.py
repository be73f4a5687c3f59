"""Flights over bad links, the camera on the same link: `python -m tests.benchmarks.bad_links`.

    [--seeds 20] [--workers 2] [--mission tiny] [--links loss=0.2 delay_s=0.6,jitter_s=0.3 ...]

Loss, duplicates, disorder, delay and damage hold for the whole flight, in both directions, and for
every frame. A table is printed; the exit status is 1 when an aircraft was left in the air, a flight
had no end, or a traceback was shown.
"""

from __future__ import annotations

import argparse
import statistics
import sys
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from functools import partial

from tests.benchmarks.watched import EXPLAINED, Flown, flown, mission_text, table

LINKS = (
    "loss=0.1", "loss=0.2", "loss=0.3", "loss=0.4", "loss=0.5", "loss=0.6",
    "duplicate=0.5", "reorder=0.5", "delay_s=0.6", "delay_s=2.0", "jitter_s=3.0",
    "corrupt=0.1", "corrupt=0.4",
    "delay_s=0.3,jitter_s=0.5,reorder=0.3,duplicate=0.3,loss=0.2,corrupt=0.1",
)  # fmt: skip
FORBIDDEN = frozenset({"air", "lie", "unrep", "end", "tb", "res", "breach"})


def fly(job: tuple[str, int], mission: str = "tiny") -> Flown:
    """One flight over a link."""
    link, seed = job
    quality = {key: float(value) for key, value in (part.split("=") for part in link.split(","))}
    fault = {"kind": "link", "at_s": 0.0, **quality}
    return flown(f"{link} seed {seed}", mission_text(mission, [fault]), seed)


def flights(
    links: Iterable[str], seeds: int, workers: int, mission: str = "tiny"
) -> list[tuple[str, Flown]]:
    """All flights, with what each shows of interest said at once."""
    jobs = [(link, seed) for link in links for seed in range(1, seeds + 1)]
    rows = []
    with ProcessPoolExecutor(workers) as pool:
        flown_in_turn = pool.map(partial(fly, mission=mission), jobs)
        for (link, _), flight in zip(jobs, flown_in_turn, strict=True):
            rows.append((link, flight))
            if flight.code != 0 or flight.columns & FORBIDDEN:
                last = flight.said.strip().splitlines()[-1:]
                print(flight.line(), *last, flush=True)
    return rows


def main(arguments: list[str] | None = None) -> int:
    """Fly and print."""
    parser = argparse.ArgumentParser(description="Flights over bad links.")
    parser.add_argument("--seeds", type=int, default=20, help="flights a link (default 20)")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--links", nargs="+", default=LINKS, help="such as loss=0.2,jitter_s=1")
    parser.add_argument("--mission", default="tiny", help="of the tests, or the path of a file")
    options = parser.parse_args(arguments)
    rows = flights(options.links, options.seeds, options.workers, options.mission)
    print(table(rows), EXPLAINED, sep="\n\n")
    for link in options.links:
        took = [f.summary["flight_time_s"] for name, f in rows if name == link and f.code == 0]
        if took:
            print(f"{link}: complete in {statistics.median(took):.0f} s of flight (median)")
    return int(any(flight.columns & FORBIDDEN for _, flight in rows))


if __name__ == "__main__":
    sys.exit(main())
