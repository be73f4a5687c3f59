"""Plans that are searched for less long, for properties that hold of each, good or bad."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import replace

import pytest

from missions.flight.strategy import sweep_passes
from missions.planning.sweep.paths import Plan, Tuning
from missions.planning.sweep.plan_memo import PlanMemo

MOVES = 200
"""Of the planner, for each plan: by default it makes 700, and 20 where nothing is compiled."""


@contextlib.contextmanager
def quick_plans() -> Iterator[None]:
    """Within this block nobody plans longer: for what asks about troubles and places.

    Not where paths themselves are looked at: good plans bring vehicles closer to each other.
    """
    thorough = sweep_passes.plan_once

    def quick(plans: PlanMemo, tuning: Tuning, *how: object) -> Plan:
        return thorough(plans, replace(tuning, moves=MOVES), *how)  # type: ignore[arg-type]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sweep_passes, "plan_once", quick)
        yield
