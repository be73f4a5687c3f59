"""Plans that are searched for less long, for properties that hold of each, good or bad."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import replace

import pytest

MOVES = 200
"""Of the planner, for each plan: by default it makes 700, and 20 where nothing is compiled."""


@contextlib.contextmanager
def quick_plans() -> Iterator[None]:
    """Within this block nobody plans longer: for what asks about troubles and places.

    Not where paths themselves are looked at: good plans bring vehicles closer to each other.
    """
    from missions.planning.sweep import memo  # noqa: PLC0415 - numba takes a second to load
    from missions.planning.sweep.paths import Tuning  # noqa: PLC0415, as above
    from missions.planning.sweep.plan_memo import PlanMemo  # noqa: PLC0415, as above
    from missions.planning.sweep.sweep_planner import Plan  # noqa: PLC0415, as above

    thorough = memo.plan_once

    def quick(plans: PlanMemo, tuning: Tuning, *how: object) -> Plan:
        return thorough(plans, replace(tuning, moves=MOVES), *how)  # type: ignore[arg-type]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(memo, "plan_once", quick)
        yield
