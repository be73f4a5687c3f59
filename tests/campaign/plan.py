"""Troubles of each flight: each kind in each phase alone, then in pairs.

A seed draws from the list of kinds: another list draws other flights. Tests that keep a seed state
its troubles as well.
"""

from __future__ import annotations

import random
from dataclasses import dataclass

SINGLES = 0.6
"""The share of flights with a single trouble."""


@dataclass(frozen=True, slots=True)
class Plan:
    """One flight of a campaign: everything else follows from its seed."""

    seed: int
    kinds: tuple[str, ...]
    phases: tuple[str, ...]

    @property
    def label(self) -> str:
        return self.kinds[0] if len(self.kinds) == 1 else "pairs"

    def __str__(self) -> str:
        parts = " + ".join(f"{k} ({p})" for k, p in zip(self.kinds, self.phases, strict=True))
        return f"--seed {self.seed}: {parts}"


def plan(seed: int, kinds: tuple[str, ...], phases: tuple[str, ...]) -> Plan:
    """Return the flight of a seed: kind and phase follow from the number, each equally often.

    >>> plan(0, ("a", "b"), ("x", "y")).kinds
    ('a',)
    """
    rng = random.Random(seed)
    single = (seed % 10) < 10 * SINGLES
    if single:
        k = (seed // 10) * int(10 * SINGLES) + seed % 10
        return Plan(seed, (kinds[k % len(kinds)],), (phases[(k // len(kinds)) % len(phases)],))
    return Plan(
        seed,
        (rng.choice(kinds), rng.choice(kinds)),
        (rng.choice(phases), rng.choice(phases)),
    )
