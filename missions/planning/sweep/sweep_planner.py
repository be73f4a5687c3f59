"""The planner of flight without stopping: the next paths of a team, again and again.

A frame that a cell still needs has a worth in seconds (`missions.planning.kernels.worth.value`). It
is high for *work*, undecided cells next to the known region, and low for cells beyond that may
become work. A plan is a list of waypoints for each vehicle, from where it can leave its present
path to its home. Its cost is the time of the exact motion (mostly that of the last vehicle) less
the worth of the frames taken on the way. Annealing improves the plan of before whenever there are
new frames; the new plan is flown unless the present one is as good. Plans rest on provisional
majorities; a cell with too few votes for a verdict only becomes work.

Lengths are metres in the frame of the region.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from missions.planning.kernels import swath as kernels
from missions.planning.kernels import worth as worths
from missions.planning.sweep.chart import Chart, Flags
from missions.planning.sweep.kernel_paths import (
    ahead,
    geometry,
    path_of,
    row_of,
    segments_of,
    within,
)
from missions.planning.sweep.paths import Floats, Flyer, Plan, Route, Tuning, Valued
from missions.units import GridPoint

_TIMES: Final = 1.2
"""Duration of a detour beyond straight lines at full speed, as a factor: turns and acceleration."""
_TURN_S: Final = 5.0
"""Additional duration of a detour, s."""


def worth_of_detours(tuning: Tuning, chart: Chart, team: Sequence[Flyer], valued: Valued) -> Valued:
    """Return the worth of frames, with each work cell worth the way of the nearest vehicle.

    Nothing changes if the least detour takes less than (penalty_s - 5 s) / 1.2; `valued` is
    unchanged.
    """
    worth, need, cells, work = valued
    mine = cells[:work]
    x = (mine % chart.columns + chart.west) * chart.cell_m
    y = (mine // chart.columns + chart.south) * chart.cell_m
    least_s = np.full(work, np.inf)
    for flyer in team:
        (here_x, here_y), (end_x, end_y) = flyer.place, flyer.end
        way_m = np.hypot(x - here_x, y - here_y) + np.hypot(x - end_x, y - end_y)
        way_m -= math.hypot(end_x - here_x, end_y - here_y)
        np.minimum(least_s, way_m / flyer.kinematics.speed_m_s, out=least_s)
    worth = worth.copy()
    worth[mine] *= np.maximum(1.0, (_TIMES * least_s + _TURN_S) / tuning.penalty_s)
    return worth, need, cells, work


_MAX_LEAD: Final = 24  # pieces of a lead-in


@dataclass(slots=True)
class _Search:
    """The data of a search: a team, the beginnings of each vehicle, and the earlier waypoints."""

    team: kernels.Team
    ways: kernels.Ways
    cells: kernels.Cells

    @classmethod
    def create(cls, rows: Floats, chart: Chart, valued: Valued) -> _Search:
        """Create a search in which no vehicle has begun or has waypoints."""
        count, begins = len(rows), kernels.LEADS
        worth, need, _, _ = valued
        return cls(
            kernels.Team(
                rows,
                np.zeros((count, begins, 4)),
                np.zeros((count, begins, _MAX_LEAD, kernels.PIECE)),
                np.zeros((count, begins), np.int64),
                np.zeros(count),
            ),
            kernels.Ways(
                np.zeros((count, kernels.MAX_WAYPOINTS, 3)),
                np.ones(count, np.int64),
                np.full(count, begins - 1, np.int64),
                np.zeros(count),
            ),
            kernels.Cells(
                worth, need, np.zeros_like(need), chart.allowed, chart.fenced, chart.grid
            ),
        )


class Planner:
    """Planner for a team; it holds buffers and weights, nothing of its plans."""

    def __init__(self, tuning: Tuning) -> None:
        self.tuning = tuning
        self._room = kernels.new_room()

    def worth(
        self, chart: Chart, root: int, frames: int, majority: int, asked: Flags | None = None
    ) -> Valued:
        """Return the worth of a frame of each cell.

        It is for the region that is connected with `root`, or with -1 for all patches; and for all
        cells with a 1 in `asked`.
        """
        tuning = self.tuning
        return worths.value(
            chart.yes, chart.no, majority, frames, root, chart.columns, chart.rows,
            tuning.penalty_s, tuning.prize_s, tuning.rings, tuning.least_chance, chart.closed,
            np.zeros_like(chart.closed) if asked is None else asked,
        )  # fmt: skip

    def worth_of_all(self, chart: Chart, wanted: Flags, frames: int, majority: int) -> Valued:
        """Return the same if every cell with a 1 in `wanted` is work, whatever it may be."""
        against = frames - majority + 1
        need = np.minimum(majority - chart.yes, against - chart.no)
        need = np.where((wanted == 1) & (chart.closed == 0) & (need > 0), need, 0)
        worth = np.where(need > 0, self.tuning.penalty_s / np.maximum(need, 1), 0.0)
        cells = np.flatnonzero(need).astype(np.int64)
        return worth, need.astype(np.int64), cells, len(cells)

    def plan(
        self,
        chart: Chart,
        team: Sequence[Flyer],
        valued: Valued,
        begin_s: float,
        seed: int,
        next_frame_s: Sequence[float],
        tours: Sequence[Sequence[tuple[float, float, float]]] = (),
    ) -> Plan:
        """Return paths for a team that begin at `begin_s`, from the vehicles' places at that time.

        `tours` are waypoints for each vehicle, without the end, to begin another plan with; the
        better one is taken. The same arguments give the same plan.
        """
        tuning = self.tuning
        valued = worth_of_detours(tuning, chart, team, valued)
        rows = np.stack(
            [row_of(f.kinematics, tuning, s) for f, s in zip(team, next_frame_s, strict=True)]
        )
        search = _Search.create(rows, chart, valued)
        for k, flyer in enumerate(team):
            self._warm(flyer, search, k, begin_s)
        kept_s = self._cost_of_kept(team, search, begin_s)
        cost_s = self._improve(search, valued, seed, tuning.moves)
        if tours:
            other = _Search.create(rows, chart, valued)
            for k, (flyer, tour) in enumerate(zip(team, tours, strict=True)):
                self._warm(flyer, other, k, begin_s, tour)
            moves = tuning.tour_moves
            if len(team) == 1:
                moves = min(moves, max(tuning.moves, tuning.tour_moves_each * len(tours[0])))
            other_s = self._improve(other, valued, seed, moves)
            if other_s < cost_s:
                search, cost_s = other, other_s
        if cost_s > kept_s - tuning.keep_s:
            kept = tuple(flyer.route or Route(()) for flyer in team)
            return Plan((None,) * len(team), kept, valued[3], kept_s)
        flown = [path_of(search.team, search.ways, k, begin_s) for k in range(len(team))]
        return Plan(
            tuple(path for path, _ in flown), tuple(route for _, route in flown), valued[3], cost_s
        )

    def _improve(self, search: _Search, valued: Valued, seed: int, moves: int) -> float:
        tuning = self.tuning
        random = np.array([seed % 2147483646 + 1], np.int64)
        return kernels.improve(
            search.team, search.ways, search.cells, valued[2], moves, tuning.hot_s,
            tuning.cold_s, self._urgent, tuning.last_share, random,
        )  # fmt: skip

    @property
    def _urgent(self) -> float:
        """Worth of a frame from which on a cell is work, s."""
        return 0.1 * self.tuning.penalty_s

    def _cost_of_kept(self, team: Sequence[Flyer], search: _Search, begin_s: float) -> float:
        """Return the cost of the present paths; infinite if a vehicle has none."""
        seen_s, rest = 0.0, []
        cells = search.cells._replace(cover=search.cells.cover.copy())
        for k, flyer in enumerate(team):
            if flyer.path is None or flyer.route is None:
                return math.inf
            segments, path = segments_of(flyer.path), flyer.path
            rest.append(max(0.0, path.end_s - begin_s))
            seen_s += kernels.worth_of_rest(
                search.team.pars[k], segments, len(segments), path.end_s - path.begin_s,
                begin_s - path.begin_s, cells, self._urgent,
            )  # fmt: skip
        last = self.tuning.last_share
        return last * max(rest) + (1.0 - last) * sum(rest) / len(rest) - seen_s

    def _warm(
        self,
        flyer: Flyer,
        search: _Search,
        k: int,
        begin_s: float,
        tour: Sequence[tuple[float, float, float]] | None = None,
    ) -> None:
        """Fill in the beginnings of a vehicle, and its remaining waypoints, or those of a tour."""
        tuning, begin, ways = self.tuning, search.team, search.ways
        left: Sequence[tuple[float, float, float]] = ()
        path, route = flyer.path, flyer.route
        now = None if path is None else within(path, begin_s)
        if path is None or now is None or now.speed_m_s < kernels.SLOW:
            place = flyer.place if now is None else GridPoint(now.x_m, now.y_m)
            begin.starts[k, :, 0], begin.starts[k, :, 1] = place
            begin.n_leads[k, : kernels.LEADS - 1] = -1
            if route is not None and path is not None:
                along_m = path.length_m if now is None else now.along_m
                left = ahead(route, along_m + 0.5)
        else:
            speed = begin.v0[k] = now.speed_m_s
            pieces = geometry(path, flyer.kinematics.speed_m_s)
            slows = (speed, tuning.turn_wide_m_s, tuning.turn_m_s, 0.0)
            for choice, slow in enumerate(slows):
                begin.n_leads[k, choice] = kernels.lead_in(
                    begin.pars[k], pieces, len(pieces), now.piece, now.into_m, speed, slow,
                    begin.leads[k, choice], begin.starts[k, choice],
                )  # fmt: skip
            slow_lead = begin.leads[k, kernels.LEADS - 2, : begin.n_leads[k, kernels.LEADS - 2]]
            if route is not None:
                left = ahead(route, now.along_m + float(slow_lead[:, kernels.P_LENGTH].sum()))
        if tour is None:
            left = left[-(kernels.MAX_WAYPOINTS - 1) :]
        else:  # the rest comes with a later plan
            left = tour[: kernels.MAX_WAYPOINTS // 2]
        points = [*left, (*flyer.end, tuning.cut_m)]
        ways.points[k, : len(points)] = points
        ways.counts[k] = len(points)
        if begin.v0[k] > 0.0:
            ways.choices[k] = self._quickest_begin(search, k)

    def _quickest_begin(self, search: _Search, k: int) -> int:
        way, m = search.ways.points[k], search.ways.counts[k]
        seconds = [
            kernels.fly(search.team, k, choice, way, m, self._room)[2]
            for choice in range(kernels.LEADS)
        ]
        return seconds.index(min(seconds))
