"""Fly a campaign: `python -m tests.campaign --flights 1000 --seed 0 --workers 2`.

A failure is flown again by `--seed X --flights 1 --verbose`. Exit 1 if there was one.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

from . import reducer, simulated
from .outcome import EXPLAINED, Outcome, table

WORLDS: dict[str, Callable[..., Outcome]] = {"reducer": reducer.fly, "sitl": simulated.fly}
FAILURES_FILE = Path("campaign-failures.txt")


def main() -> int:
    options = _options()
    fly, begin_s = WORLDS[options.world], time.monotonic()
    outcomes = []
    fly = partial(fly, strategy=options.strategy, verbose=options.verbose)
    if options.world == "reducer":
        fly = partial(fly, find=options.find, receiver_sigma_m=options.receivers)
    else:
        quirks = dict(text.split("=", 1) for text in options.quirk)
        fly = partial(fly, pilots=options.pilots, quirks=quirks)
    for outcome in _flown(fly, options):
        outcomes.append(outcome)
        if outcome.found and len(outcomes) < 100000:
            print(f"{outcome.plan}: {'; '.join(f'{k}: {t}' for k, t in outcome.found)}", flush=True)
    print(table(outcomes), EXPLAINED, sep="\n\n")
    print(f"\n{len(outcomes)} flights in {time.monotonic() - begin_s:.0f} s")
    failed = [outcome for outcome in outcomes if outcome.found]
    if not failed:
        return 0
    lines = [f"{o.plan}: {'; '.join(f'{k}: {t}' for k, t in o.found)}\n" for o in failed]
    options.failures.write_text("".join(lines), encoding="utf-8")
    print(f"{len(failed)} flights with a forbidden outcome, kept in {options.failures}")
    return 1


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.campaign", description=__doc__)
    parser.add_argument("--flights", type=int, default=100, help="how many (default 100)")
    parser.add_argument("--seed", type=int, default=0, help="of the first flight (default 0)")
    parser.add_argument("--world", choices=sorted(WORLDS), default="reducer")
    parser.add_argument("--strategy", help="of all flights (default: drawn)")
    parser.add_argument(
        "--find", choices=("first", "all", "all, from on high"), default="first",
        help="every flight looks for all patches of the region, by swath (world reducer)",
    )  # fmt: skip
    parser.add_argument(
        "--pilots", action="store_true",
        help="in every flight a pilot turns a mode switch at a random moment (world sitl)",
    )  # fmt: skip
    parser.add_argument(
        "--quirk", action="append", default=[], metavar="KEY=VALUE",
        help="a habit of all aircraft, as in [sim.quirks]: landed_state=false (world sitl)",
    )  # fmt: skip
    parser.add_argument(
        "--receivers", type=float, default=3.0,
        help="standard deviation of receivers' heights above the sea, m (world reducer)",
    )  # fmt: skip
    parser.add_argument("--workers", type=int, default=1, help="processes (default 1)")
    parser.add_argument("--verbose", action="store_true", help="tell every event and order")
    parser.add_argument("--failures", type=Path, default=FAILURES_FILE, help="the file of failures")
    return parser.parse_args()


def _flown(fly: Callable[[int], Outcome], options: argparse.Namespace) -> Iterator[Outcome]:
    seeds = range(options.seed, options.seed + options.flights)
    if options.workers == 1:
        yield from map(fly, seeds)
        return
    with ProcessPoolExecutor(options.workers) as workers:
        yield from workers.map(fly, seeds, chunksize=8)


if __name__ == "__main__":
    sys.exit(main())
