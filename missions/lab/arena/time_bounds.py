"""Bounds in seconds of flight without stopping: a lower one, and the best way that was found.

*Lower bound*: the time that no team can beat, whatever it knows.

A vehicle is a point with |velocity| <= v and |acceleration| <= a (as vectors), at rest over the
start at first and at last. A frame shows a rectangle whose sides, F_x and F_y, lie along the grid.
A cell of edge w is seen when all of it is shown. Then the vehicle is within the cell's *view*, a
rectangle with the sides F_x - w and F_y - w around the cell's centre.

*Seconds of a way.* The speed changes by at most a. From rest to rest a way of length L takes at
least L / v + v / a. If L < v^2 / a, it takes at least 2 sqrt(L / a). `least_s` is this.

*Far.* Let d be the distance from the start to the view of a needed cell, and u the direction of
its nearest point. The view is convex, so all of it lies at least d along u. A vehicle that sees the
cell gets that far: at the farthest point along u its speed along u is 0. So the way there takes at
least `least_s`(d), and so does the way back: T >= 2 `least_s`(d).

*Area.* The cells that a vehicle sees on a stretch of its way lie wholly in the area that the
rectangle sweeps on it. Sweeping along a line in the direction (cos, sin) for dL adds at most
(F_y |cos| + F_x |sin|) dL <= D dL with D = sqrt(F_x^2 + F_y^2). So a stretch of length L sweeps at
most F_x F_y + D L. Cells do not overlap. Hence k cells need L >= (k w^2 - F_x F_y) / D. All begin
over the same cell, whose rectangle is counted once. So R vehicles that see N cells have together
N w^2 <= F_x F_y + D (L_1 + ... + L_R). The longest way is at least (N w^2 - F_x F_y) / (R D).

*Shells.* N_d cells have views at least d from the start. Some vehicle sees k >= ceil(N_d / R) of
them. It flies at least d before the first of them, and at least d after the last. The stretch
between has the length above: L >= 2 d + max(0, k w^2 - F_x F_y) / D.

The bound is the largest of these over all d. It ignores that a frame shows whole cells only at
certain places, and the number of frames that a cell needs. So it is far from tight for large cells.

*Reference*: the best found way of a team that knows the region. It anneals over the same paths and
frames as the planner in flight. All needed cells are work from the first moment, and it has several
starts and many more moves. It is no bound; its paths are flown and judged as those of every
other run.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.errors import StrategyError
from missions.geo.trajectory import Trajectory, least_s
from missions.lab.arena.nonstop import FlightResult, Ground, Team
from missions.lab.arena.roi import Roi
from missions.planning.kernels import swath as kernels
from missions.planning.sweep.kernel_paths import path_of, row_of
from missions.planning.sweep.paths import Kinematics, Tuning
from missions.units import Cell, GridPoint


def lower_bound_s(
    needed: Collection[Cell], start: Cell, robots: int, cell_m: float, kinematics: Kinematics
) -> float:
    """Return the minimum time of the last vehicle, s; the module has the proof.

    All cells of `needed` are seen whole, by 1 or more vehicles that begin and end over the centre
    of `start`. The camera does not tilt.
    """
    speed, accel = kinematics.speed_m_s, kinematics.accel_m_s2
    frame_x = 2.0 * kinematics.half_east_m + cell_m
    frame_y = 2.0 * kinematics.half_north_m + cell_m
    diagonal = math.hypot(frame_x, frame_y)

    def swept_m(cells: float) -> float:
        return max(0.0, cells * cell_m**2 - frame_x * frame_y) / diagonal

    views_m = view_distances_m(needed, start, cell_m, kinematics)
    if not views_m:
        return 0.0
    length_m = swept_m(len(views_m)) / robots
    for nearer, distance_m in enumerate(views_m):
        share = -(-(len(views_m) - nearer) // robots)
        length_m = max(length_m, 2.0 * distance_m + swept_m(share))
    return max(least_s(length_m, speed, accel), 2.0 * least_s(views_m[-1], speed, accel))


def view_distances_m(
    needed: Collection[Cell], start: Cell, cell_m: float, kinematics: Kinematics
) -> Sequence[float]:
    """Return the distances from the start to the view of each needed cell, m, ascending.

    >>> kinematics = Kinematics(6.0, 2.0, 0.2, half_east_m=5.0, half_north_m=5.0)
    >>> view_distances_m([Cell(0, 0), Cell(2, 0)], Cell(0, 0), 4.0, kinematics)
    [0.0, 3.0]
    """
    return sorted(
        math.hypot(
            max(0.0, abs(cell.east - start.east) * cell_m - kinematics.half_east_m),
            max(0.0, abs(cell.north - start.north) * cell_m - kinematics.half_north_m),
        )
        for cell in needed
    )


MOVES_A_CELL: Final = 300
"""Moves of the annealing per needed cell and start."""
_PENALTY_S: Final = 30.0
_HOT_S, _COLD_S = 4.0, 0.03
_LAST: Final = 0.9
"""Share of the last vehicle in the team's time."""
_MENDS: Final = 20
_MEND_MOVES, _MEND_S = 2000, 0.3
"""Moves and their temperature after a cell was missed."""


@dataclass(slots=True)
class _Search:
    """A team at rest over the start, and the frames that it needs."""

    ground: Ground
    robots: int
    seed: int
    team: kernels.Team = field(init=False)
    need: NDArray[np.int64] = field(init=False)
    random: NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        ground, count = self.ground, self.robots
        row = row_of(ground.kinematics, Tuning(), next_frame_s=0.0)
        row[kernels.FULL_RATE_S] = np.inf
        starts = np.zeros((count, kernels.LEADS, 4))
        starts[:, :, :2] = ground.home
        n_leads = np.full((count, kernels.LEADS), -1, np.int64)
        n_leads[:, kernels.LEADS - 1] = 0  # from rest
        leads = np.zeros((count, kernels.LEADS, 1, kernels.PIECE))
        self.team = kernels.Team(np.tile(row, (count, 1)), starts, leads, n_leads, np.zeros(count))
        self.need = np.zeros(ground.truth.size, np.int64)
        camera, needed = ground.camera, ground.needed()
        self.need[needed] = np.where(ground.truth[needed] == 1, camera.majority, camera.against)
        self.random = np.array([self.seed % 2147483646 + 1], np.int64)

    def improve(self, ways: kernels.Ways, moves: int, hot_s: float) -> None:
        """Improve waypoints in place."""
        chart, need = self.ground.chart, self.need
        worth = np.divide(_PENALTY_S, need, out=np.zeros(need.size), where=need > 0)
        cells = kernels.Cells(
            worth, need, np.zeros_like(need), chart.allowed, chart.fenced, chart.grid
        )
        candidates = np.flatnonzero(need)
        kernels.improve(
            self.team, ways, cells, candidates, moves, hot_s, _COLD_S, 0.0, _LAST, self.random
        )

    def paths(self, ways: kernels.Ways) -> list[Trajectory]:
        """Return the waypoints as paths."""
        return [path_of(self.team, ways, k, 0.0)[0] for k in range(self.robots)]


def reference(
    roi: Roi, team: Team, *, moves_a_cell: int = MOVES_A_CELL, seed: int = 1
) -> FlightResult:
    """Return the best run found for a team that knows the region; frames do not err or get lost.

    Raises `StrategyError` as `Team.kinematics`, and if none is found.
    """
    team = replace(team, camera=replace(team.camera, error_rate=0.0, loss_rate=0.0))
    best: FlightResult | None = None
    for start in range(3):
        search = _Search(team.over(roi), team.robots, seed=seed * 7919 + start * 104729)
        ways = _first(search.ground, team.robots, start)
        search.improve(ways, moves_a_cell * int((search.need > 0).sum()), _HOT_S)
        for _ in range(_MENDS):
            done = team.over(roi).along(search.paths(ways))
            if not done.missed:
                if best is None or done.makespan_s < best.makespan_s:
                    best = done
                break
            search.improve(ways, _MEND_MOVES, _MEND_S)
    if best is None:
        raise StrategyError(f"{roi.name}: no way was found that shows every needed cell")
    return best


def _first(ground: Ground, robots: int, start: int) -> kernels.Ways:
    """Return first waypoints: lanes along the east, along the north, or none."""
    ways = np.zeros((robots, kernels.MAX_WAYPOINTS, 3))
    counts = np.ones(robots, np.int64)
    lanes = list(_lanes(ground, along_north=start == 1)) if start < 2 else []
    share = -(-len(lanes) // robots)
    for k in range(robots):
        mine = lanes[k * share : (k + 1) * share]
        points: list[GridPoint] = []
        for index, (begin, end) in enumerate(mine):
            points += (end, begin) if index % 2 else (begin, end)
        points = [*points[: kernels.MAX_WAYPOINTS // 2], ground.home]
        counts[k] = len(points)
        ways[k, : len(points), :2] = points
        ways[k, : len(points), 2] = Tuning().cut_m
    return kernels.Ways(
        ways, counts, np.full(robots, kernels.LEADS - 1, np.int64), np.zeros(robots)
    )


def _lanes(ground: Ground, *, along_north: bool) -> Sequence[tuple[GridPoint, GridPoint]]:
    """Return lanes through the needed cells, as far apart as a frame shows rows."""
    cells = [ground.chart.cell(int(index)) for index in ground.needed()]
    half_m = ground.kinematics.half_east_m if along_north else ground.kinematics.half_north_m
    rows = int(2.0 * half_m / ground.cell_m + 1e-9) + 1
    spans: dict[int, list[int]] = {}
    low = min(c.east if along_north else c.north for c in cells)
    for cell in cells:
        across, along = (cell.east, cell.north) if along_north else (cell.north, cell.east)
        spans.setdefault((across - low) // rows, []).append(along)
    lanes = []
    for number in sorted(spans):
        across_m = (low + number * rows + 0.5 * (rows - 1)) * ground.cell_m
        ends_m = (min(spans[number]) * ground.cell_m, max(spans[number]) * ground.cell_m)
        pair = [(across_m, e) if along_north else (e, across_m) for e in ends_m]
        lanes.append((GridPoint(*pair[0]), GridPoint(*pair[1])))
    return lanes
