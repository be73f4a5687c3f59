"""Fleets with a service on each vehicle, to which things happen: `python -m
tests.benchmarks.fleet_faults`.

    [--seeds 50] [--first 1] [--say]

Two of three seeds fly a small field with one region, the third one searches another from 30 m and
changes layers in air that was asked for. Each has some of: a partition of 60 s, a program that
dies and starts again, a vehicle that falls, a member that starts 60 s late, a clock off by an
hour, messages that are lost, doubled, and overtake each other. A line a seed is printed, and what
was forbidden: vehicles too near to each other, cells nobody has decided, journals that differ, the
fence, the reserve, somebody in the air at the end. The exit status is 1 if anything was.
"""

from __future__ import annotations

import random
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from missions.partition import Partition
from tests.benchmarks.frame import asked
from tests.support.fleet_rig import Death, Mishaps, field_text, flown
from uavmap.fleet.simulated_radio import LinkModel

KINDS = ("parted", "dies", "falls", "late", "clock")
HOUR_S = 3_600.0


def scenario(seed: int) -> tuple[str, Mishaps]:
    """The mission and what happens, by seed: each kind is first alone, then with others."""
    rng = random.Random(seed)
    high = seed % 3 == 0
    kinds = {KINDS[seed % len(KINDS)]}
    if seed > 2 * len(KINDS):
        kinds |= {kind for kind in KINDS if rng.random() < 0.25}
    model = LinkModel(
        loss=rng.choice([0.0, 0.1, 0.3]),
        delay_s=0.1,
        jitter_s=rng.choice([0.0, 1.0, 4.0]),
        doubled=rng.choice([0.0, 0.3]),
        partitions=_partitions(rng) if "parted" in kinds else (),
    )
    one, other = rng.randint(1, 3), rng.randint(1, 3)
    deaths, lost, more = (), frozenset[int](), ""
    if "dies" in kinds:
        at_s, for_s = rng.uniform(3.0, 70.0), rng.choice([2.0, 15.0, 40.0])
        deaths = (Death(one, round(at_s, 1), for_s, rng.random() < 0.7),)
    if "falls" in kinds:
        number = other if not deaths or other != one else one % 3 + 1
        at_s = rng.uniform(12.0, 60.0)
        lost = frozenset({number})
        more = f'[[sim.faults]]\nvehicle = {number}\nat_s = {at_s:.1f}\nkind = "motor"\n'
    late = {rng.randint(1, 3): 60.0} if "late" in kinds else {}
    ahead = {rng.randint(1, 3): rng.choice([HOUR_S, -0.0, 7.0])} if "clock" in kinds else {}
    return field_text(high=high, more=more), Mishaps(model, late, ahead, deaths, lost)


def _partitions(rng: random.Random) -> tuple[Partition, ...]:
    alone = rng.randint(1, 3)
    rest = frozenset({1, 2, 3}) - {alone}
    groups = rng.choice([(frozenset({alone}), rest), ()])
    begin_s = rng.choice([0.0, rng.uniform(8.0, 60.0)])
    return (Partition(begin_s, begin_s + 60.0, groups),)


def main() -> int:
    """Fly all seeds."""
    options = asked(__doc__, seeds=50, first=1, say=False)
    counts: Counter[str] = Counter()
    for seed in range(options.first, options.first + options.seeds):
        text, mishaps = scenario(seed)
        begun_s = time.process_time()
        with tempfile.TemporaryDirectory() as folder:
            outcome = flown(text, mishaps, Path(folder), seed)
        took_s = time.process_time() - begun_s
        figures = outcome.figures
        print(
            f"{seed:3d} {'high' if seed % 3 == 0 else 'low ':4s} {took_s:4.1f} s  "
            f"{figures['makespan_s']:5.0f} s, {figures.get('min_separation_m') or 0.0:4.1f} m, "
            f"{figures['missed']} wrong  {mishaps}"
        )
        said = [f"    FORBIDDEN {text}" for text in outcome.forbidden]
        print(
            *(f"      {line}" for line in outcome.said if options.say), *said, sep="\n", flush=True
        )
        counts.update({text.split(":")[0] for text in outcome.forbidden})
        counts["flights with something forbidden"] += bool(outcome.forbidden)
    print(f"{options.seeds} flights; " + ", ".join(f"{k}: {v}" for k, v in sorted(counts.items())))
    return int(counts["flights with something forbidden"] > 0)


if __name__ == "__main__":
    sys.exit(main())
