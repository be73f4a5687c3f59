"""Plans with a shorter search, for properties that hold of each plan, good or bad."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import replace

import pytest

from missions.flight.strategy import sweep_paths
from missions.planning.sweep.paths import Plan, Tuning
from missions.planning.sweep.plan_memo import PlanMemo

MOVES = 200
"""Trials of the planner for each plan: by default 700, and 20 without compiled code."""


@contextlib.contextmanager
def quick_plans() -> Iterator[None]:
    """Limit the search of each plan within this block, for tests of troubles and places.

    Do not use it where paths themselves are tested: good plans bring vehicles closer together.
    """
    thorough = sweep_paths.plan_once

    def quick(plans: PlanMemo, tuning: Tuning, *how: object) -> Plan:
        return thorough(plans, replace(tuning, moves=MOVES), *how)  # type: ignore[arg-type]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sweep_paths, "plan_once", quick)
        yield
