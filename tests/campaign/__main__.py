"""Fly a campaign: `python -m tests.campaign --flights 1000 --seed 0 --workers 2`.

`--seed X --flights 1 --verbose` repeats a failed flight. The exit code is 1 if there was a failure.
The file `--failures` keeps all failures. `--record` adds the campaign to `flights.json`, from
which `python -m tests.reliability` makes `docs/reliability.md`.

`--world reducer` flies a fleet of points. Missions of seeds that end in 1, 3 or 5 press on energy
and air: batteries just suffice, and pads lie below the paths of others. `--find` ("first", "all" or
"all, from on high") chooses the patches of the region. `--receivers` is the standard deviation of
heights above the sea, m. Pads differ by up to `--pads` metres in height. `--teams` leaves out seeds
of a single vehicle.
`--world sitl` flies the bundled simulator. With `--pilots` a pilot turns a mode switch at a random
moment of every flight. `--quirk` KEY=VALUE ... are quirks of all aircraft, as in [sim.quirks].
`--world fleet` flies the simulator with a service on each of four vehicles.
`--strategy` is that of all flights; by default it is drawn.
"""

from __future__ import annotations

import sys
import time
from argparse import Namespace
from collections.abc import Callable
from functools import partial
from itertools import count, islice
from pathlib import Path
from typing import Any, Final

from tests.benchmarks.frame import in_turn, options_of

from . import fleets, record, reducer, simulated
from .outcome import EXPLAINED, Outcome, forgiven_line, table

SHAPES: Final[dict[str, Any]] = {
    "strategy": str, "find": "first", "receivers": 3.0, "pads": 0.0, "teams": False,
    "pilots": False, "quirk": ("landed_state=true",),
}  # fmt: skip
"""The options that change what is flown, with their defaults."""


def _chosen(options: Namespace) -> str:
    """Return the options that change what is flown, as the command takes them."""
    words = list[str]()
    for name, default in SHAPES.items():
        value = getattr(options, name)
        values = value if isinstance(value, list) else [value]
        if value is None or default in (value, tuple(values)):
            continue
        words += [f"--{name}", *(str(each) for each in values if each is not True)]
    return " ".join(words)


def main() -> int:
    options = options_of(
        __doc__, flights=100, seed=0, world="reducer", **SHAPES, workers=1, verbose=False,
        failures=Path("campaign-failures.txt"), record=False,
    )  # fmt: skip
    if options.world not in (known := ("reducer", "sitl", "fleet")):
        print(f"--world {options.world}: there is {', '.join(known)}")
        return 2
    worlds: dict[str, Callable[[int], Outcome]] = {
        "reducer": partial(
            reducer.fly,
            find=options.find,
            receiver_sigma_m=options.receivers,
            pads_m=options.pads,
        ),
        "sitl": partial(
            simulated.fly,
            pilots=options.pilots,
            quirks=dict(text.split("=", 1) for text in options.quirk),
        ),
        "fleet": fleets.fly,
    }
    commit = record.commit_of_program()  # before, since the clone may change during the flights
    fly = partial(worlds[options.world], strategy=options.strategy, verbose=options.verbose)
    begin_s, outcomes, failed = time.monotonic(), [], []
    chosen = filter(reducer.has_team, count(options.seed)) if options.teams else count(options.seed)
    for _, outcome in in_turn(fly, list(islice(chosen, options.flights)), options.workers):
        outcomes.append(outcome)
        if outcome.found:
            failed.append(f"{outcome.plan}: {'; '.join(f'{k}: {t}' for k, t in outcome.found)}")
            print(failed[-1], flush=True)
    print(table(outcomes), forgiven_line(outcomes), EXPLAINED, sep="\n\n")
    if options.record:
        record.keep(record.run_of(commit, options.world, _chosen(options), options.seed, outcomes))
    print(f"\n{len(outcomes)} flights in {time.monotonic() - begin_s:.0f} s")
    if not failed:
        return 0
    options.failures.write_text("\n".join([*failed, ""]), encoding="utf-8")
    print(f"{len(failed)} flights with a forbidden outcome, kept in {options.failures}")
    return 1


if __name__ == "__main__":
    sys.exit(main())
