"""Earlier plans of a flight: a journal that is folded again asks for the same ones.

A plan is a pure function of its arguments, and costs some ten milliseconds. The fold of a flight
needs hundreds, and several parts of the service fold the same journal. The memory belongs to the
flight. The planner loads its kernels, which takes a second with numba, at the first plan.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import astuple
from typing import TYPE_CHECKING, Final

from missions.planning.sweep.chart import Chart, KnownMap
from missions.planning.sweep.paths import (
    MIN_TOUR_GAIN_S,
    MIN_WORK,
    Flyer,
    Kinematics,
    Plan,
    Tours,
    Tuning,
    Valued,
    Waypoints,
)
from missions.planning.sweep.plan_memo import PlanMemo
from missions.units import Cell, GridPoint

if TYPE_CHECKING:
    from missions.planning.sweep.sweep_planner import Planner

UNCOMPILED_MOVES: Final = 20
"""Number of moves without numba: plain Python is a hundred times slower; plans are worse, but
safe."""


def valued(known: KnownMap, frames: int, majority: int, planner: Planner | None = None) -> Valued:
    """Return the worth of a frame of each cell: `frames` votes of a cell count, `majority` elect
    it."""
    planner = planner or _planner(Tuning())
    if known.wanted is None or known.patches:
        return planner.worth(known.chart, known.root, frames, majority, known.wanted)
    return planner.worth_of_all(known.chart, known.wanted, frames, majority)


def _planner(tuning: Tuning) -> Planner:
    from missions.planning.sweep import sweep_planner  # noqa: PLC0415 - see above

    return sweep_planner.Planner(tuning)


def plan_once(
    memo: PlanMemo,
    tuning: Tuning,
    known: KnownMap,
    team: Sequence[Flyer],
    frames: int,
    majority: int,
    begin_s: float,
    decision: int,
    tours: Waypoints = (),
) -> Plan:
    """Return the plan for a team from `begin_s` on; `decision` seeds the search.

    `tours` are other waypoints to begin with (`missions.planning.sweep.tours`).
    """

    def plan() -> Plan:
        from missions.planning.kernels.jit import COMPILED  # noqa: PLC0415 - see above

        few = UNCOMPILED_MOVES
        moves = tuning if COMPILED else Tuning(tuning.penalty_s, moves=few, tour_moves=few)
        planner = _planner(moves)
        worth = valued(known, frames, majority, planner)
        next_s = [max(flyer.kinematics.frame_s, flyer.blind_s) for flyer in team]
        return planner.plan(known.chart, team, worth, begin_s, decision, next_s, tours)

    asked = (astuple(tuning), frames, majority, begin_s, decision, tours)
    return memo.answer(_key("plan", known, team, *asked), plan)


def tours_once(
    memo: PlanMemo,
    known: KnownMap,
    team: Sequence[Flyer],
    delays_s: Sequence[float],
    frames: int,
    majority: int,
    begin_s: float,
    decision: int,
    before: Waypoints,
    least: int = MIN_WORK,
    keep_s: float = MIN_TOUR_GAIN_S,
) -> Tours | None:
    """Return tours of a team past all cells to see; None if they are fewer than `least`."""

    def tours() -> Tours | None:
        from missions.planning.sweep.tours import lay_tours  # noqa: PLC0415 - see above

        worth = valued(known, frames, majority)
        return lay_tours(
            known.chart, team, delays_s, worth, begin_s, decision, before, least, keep_s
        )

    asked = (tuple(delays_s), frames, majority, begin_s, decision, before, (least, keep_s))
    return memo.answer(_key("tours", known, team, *asked), tours)


def _key(kind: str, known: KnownMap, team: Sequence[Flyer], *others: object) -> bytes:
    made = hashlib.blake2b(digest_size=16)
    chart = known.chart
    if known.wanted is not None:
        made.update(known.wanted.tobytes())
    for array in (chart.yes, chart.no, chart.closed, chart.allowed):
        made.update(array.tobytes())
    made.update(repr((kind, *chart.grid, known.root, known.patches, *others)).encode())
    for flyer in team:
        made.update(repr((flyer.kinematics, flyer.place, flyer.end, flyer.path)).encode())
        made.update(repr((flyer.route, flyer.blind_s)).encode())
    return made.digest()


def warm_up() -> None:
    """Make two small plans, one from rest and one from a path under way, and drop them.

    It loads every kernel. The first time on a machine it compiles them, in some ten seconds on a
    fast one. Without numba it takes a fraction of a second.
    """
    from missions.planning.sweep.tours import lay_tours  # noqa: PLC0415 - see above

    planner = _planner(Tuning(moves=20))
    root = Cell(0, 0)
    chart = Chart.around([root], cell_m=4.0)
    chart.yes[chart.index(root)] = 3
    flown = Kinematics(6.0, 2.0, 0.2, 7.0, 5.0)
    valued = planner.worth(chart, chart.index(root), 5, 3)
    home = GridPoint(-20.0, -20.0)
    lay_tours(chart, [Flyer(flown, home, home)], [0.0], valued, 0.0, 1, least=1)
    first = planner.plan(chart, [Flyer(flown, home, home)], valued, 0.0, 1, [0.2])
    under_way = Flyer(flown, home, home, first.paths[0], first.routes[0])
    planner.plan(chart, [under_way], valued, 2.0, 2, [0.2])
