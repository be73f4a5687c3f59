"""A first plan for much work: tours past places from which all of it is seen, for the whole team.

Annealing improves a plan step by step. From a bad one it does not find a good one within the
milliseconds of a decision. So every few seconds, and whenever there is much to do, tours are
planned anew. The better of the two plans continues. Vehicles that still fly lanes get tours
already, so that others leave them their work.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from missions.planning.kernels import tour_kernels as kernels
from missions.planning.sweep.chart import Chart
from missions.planning.sweep.paths import (
    CUT_M,
    MIN_TOUR_GAIN_S,
    MIN_WORK,
    Floats,
    Flyer,
    Ints,
    Tours,
    Valued,
    Waypoints,
)

MAX_PLACES: Final = 600
MOVES: Final = 30_000
HOT_S: Final = 2.0
COLD_S: Final = 0.05
LAST_SHARE: Final = 0.8
_SLOW_M_S: Final = 0.5


def lay_tours(
    chart: Chart,
    team: Sequence[Flyer],
    delays_s: Sequence[float],
    valued: Valued,
    begin_s: float,
    seed: int,
    before: Waypoints = (),
    least: int = MIN_WORK,
    keep_s: float = MIN_TOUR_GAIN_S,
) -> Tours | None:
    """Return tours for a team past all work; None if it is less than `least` cells.

    Each vehicle, of those that take part now or later, begins `delays_s` after `begin_s`, at the
    end of its path, if any. The tours `before` of the same team are kept unless others take less
    time by `keep_s`. The same arguments give the same tours.
    """
    _, _, cells, work = valued
    if work < least or not team:
        return None
    flags = np.zeros(chart.columns * chart.rows, np.uint8)
    flags[cells[:work]] = 1
    wide = min(_seen_cells(f.kinematics.half_east_m, chart.cell_m) for f in team)
    high = min(_seen_cells(f.kinematics.half_north_m, chart.cell_m) for f in team)
    places, of = kernels.look_from(flags, chart.columns, chart.rows, wide, high, MAX_PLACES)
    places, count = (places + np.array([chart.west, chart.south])) * chart.cell_m, len(places)
    crew = _crew(team, delays_s, begin_s)
    order = np.zeros((len(team), count + 1), np.int64)
    counts = np.zeros(len(team), np.int64)
    if any(before):
        _go_on(before, places, order, counts)
    else:
        kernels.begin_with(crew, places, count, order, counts)
    random = np.array([seed % 2147483646 + 1], np.int64)
    kept, kept_counts = order.copy(), counts.copy()
    kept_s = kernels.anneal(crew, places, kept, kept_counts, 0, HOT_S, COLD_S, LAST_SHARE, random)
    cost_s = kernels.anneal(crew, places, order, counts, MOVES, HOT_S, COLD_S, LAST_SHARE, random)
    if any(before) and cost_s > kept_s - keep_s:
        order, counts, cost_s = kept, kept_counts, kept_s
    who = np.full(count + 1, -1, np.int64)  # the last for cells of no place
    for k in range(len(team)):
        who[order[k, : counts[k]]] = k
    waypoints = tuple(
        tuple((float(x), float(y), CUT_M) for x, y in places[order[k, : counts[k]]])
        for k in range(len(team))
    )
    return Tours(waypoints, who[of], cost_s)


def _go_on(before: Waypoints, places: Floats, order: Ints, counts: Ints) -> None:
    """Order places as the tours before: each where the nearest of theirs was."""
    old = np.array([(x, y) for tour in before for x, y, _ in tour])
    turns = [(k, i) for k, tour in enumerate(before) for i in range(len(tour))]
    away = np.hypot(*(places[:, None, :] - old[None, :, :]).transpose(2, 0, 1))
    nearest = away.argmin(axis=1)
    counts[:] = 0
    for p in sorted(range(len(places)), key=lambda p: (turns[nearest[p]], p)):
        k = turns[nearest[p]][0]
        order[k, counts[k]] = p
        counts[k] += 1


def _seen_cells(half_m: float, cell_m: float) -> int:
    """Return the maximum number of cells in a row that are seen from one place."""
    return max(1, math.floor(2.0 * half_m / cell_m) + 1)


def _crew(team: Sequence[Flyer], delays_s: Sequence[float], begin_s: float) -> kernels.Crew:
    count = len(team)
    start, heading, end = np.zeros((count, 2)), np.zeros((count, 2)), np.zeros((count, 2))
    for k, (flyer, delay_s) in enumerate(zip(team, delays_s, strict=True)):
        start[k], end[k] = flyer.place, flyer.end
        if flyer.path is None:
            continue
        at, (drift_e, drift_n) = flyer.path.at(begin_s + delay_s), flyer.path.drift_m_s
        start[k] = (
            at.east_m - drift_e * (begin_s + delay_s),
            at.north_m - drift_n * (begin_s + delay_s),
        )
        moves = (at.v_east_m_s - drift_e, at.v_north_m_s - drift_n)
        speed = math.hypot(*moves)
        if speed > _SLOW_M_S:
            heading[k] = (moves[0] / speed, moves[1] / speed)
    return kernels.Crew(
        start,
        heading,
        end,
        np.array(delays_s, dtype=np.float64),
        np.array([flyer.blind_s for flyer in team]) + delays_s,
        np.array([flyer.kinematics.speed_m_s for flyer in team]),
        team[0].kinematics.accel_m_s2,
        CUT_M,
    )
