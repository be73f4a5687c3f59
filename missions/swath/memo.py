"""Plans that were made before: a journal that is folded again asks for the same ones.

A plan is a pure function of its arguments, and costs some ten milliseconds; the fold of a flight
needs hundreds, and several parts of the service fold the same journal.
"""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import astuple
from typing import Final

from missions.kernels.jit import COMPILED
from missions.swath.chart import Chart, Flags
from missions.swath.planner import Flyer, Plan, Planner, Tuning

REMEMBERED: Final = 4096
UNCOMPILED_MOVES: Final = 20
"""Plain Python is a hundred times slower: plans are worse, and as safe."""

_plans: OrderedDict[bytes, Plan] = OrderedDict()


def plan_once(
    tuning: Tuning,
    chart: Chart,
    team: Sequence[Flyer],
    root: int,
    frames: int,
    majority: int,
    begin_s: float,
    decision: int,
    wanted: Flags | None = None,
) -> Plan:
    """The plan for a team from `begin_s` on; `decision` seeds the search.

    What is worth a frame follows from the cell `root` where the region was first seen; or, with
    `wanted`, it is every cell with a 1 there, whatever it may be.
    """
    key = _key(tuning, chart, team, root, frames, majority, begin_s, decision, wanted)
    plan = _plans.get(key)
    if plan is None:
        if not COMPILED:
            tuning = Tuning(penalty_s=tuning.penalty_s, moves=UNCOMPILED_MOVES)
        planner = Planner(tuning)
        if wanted is None:
            valued = planner.worth(chart, root, frames, majority)
        else:
            valued = planner.worth_of_all(chart, wanted, frames, majority)
        next_s = [flyer.kinematics.frame_s for flyer in team]
        plan = planner.plan(chart, team, valued, begin_s, decision, next_s)
        _plans[key] = plan
        while len(_plans) > REMEMBERED:
            _plans.popitem(last=False)
    return plan


def _key(
    tuning: Tuning,
    chart: Chart,
    team: Sequence[Flyer],
    root: int,
    frames: int,
    majority: int,
    begin_s: float,
    decision: int,
    wanted: Flags | None,
) -> bytes:
    made = hashlib.blake2b(digest_size=16)
    if wanted is not None:
        made.update(wanted.tobytes())
    for array in (chart.yes, chart.no, chart.closed, chart.allowed):
        made.update(array.tobytes())
    where = (*chart.grid, root, frames, majority, begin_s, decision, astuple(tuning))
    made.update(repr(where).encode())
    for flyer in team:
        made.update(repr((flyer.kinematics, flyer.place, flyer.end, flyer.path)).encode())
        made.update(repr(flyer.route).encode())
    return made.digest()
