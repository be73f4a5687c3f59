"""The methods of localization, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np

from missions.lab.localization.homing import Moves, blum_kozen, depth_first, homing, random_walk
from missions.lab.localization.localization_planner import Planner, plan

Start = Callable[[int, Planner | None, np.random.Generator], Moves]


@dataclass(frozen=True, slots=True)
class Method:
    """How a robot moves until it knows where it is."""

    name: str
    start: Start
    """Begins, from the first pattern; the planner is that of the map, if there is a map."""
    bound: Callable[[int], int] | None
    """Moves that it takes at most without errors, from n; None where that holds in the mean
    only."""
    promise: str
    """The bound in words."""
    needs_map: bool = False


def _planned(pattern: int, planner: Planner | None, rng: np.random.Generator) -> Moves:
    if planner is None:
        raise ValueError("plan needs a map")
    return plan(pattern, planner)


_ALL = (
    Method("homing", lambda pattern, *_: homing(pattern), lambda n: 4 * n, "4 n"),
    Method("depth-first", lambda pattern, *_: depth_first(pattern), lambda n: 2 * n - 2, "2 n - 2"),
    Method(
        "blum-kozen",
        lambda pattern, *_: blum_kozen(pattern),
        lambda n: 16 * n * n // 3 + 6 * n,
        "16/3 n^2 + 6 n",
    ),
    Method("random", lambda pattern, _, rng: random_walk(pattern, rng), None, "O(n^2) in the mean"),
    Method("plan", _planned, lambda n: 4 * n, "4 n", needs_map=True),
)

METHODS: Final[Mapping[str, Method]] = MappingProxyType({m.name: m for m in _ALL})
