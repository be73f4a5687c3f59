"""A reference that knows the region: the best found way that shows every needed cell often enough.

It anneals over the same paths and frames as the planner in flight, with all needed cells as work
from the first moment, from several starts and with many more moves. It is no bound; its paths are
flown and judged as those of every other run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.errors import StrategyError
from missions.geo.trajectory import Trajectory
from missions.lab.arena.nonstop import Flown, Ground, Team
from missions.lab.arena.roi import Roi
from missions.planning.kernels import swath as kernels
from missions.planning.sweep.paths import path_of
from missions.planning.sweep.planned_team import Tuning
from missions.units import GridPoint

MOVES_A_CELL: Final = 300
"""Moves of the annealing per needed cell and start."""
_PENALTY_S: Final = 30.0
_HOT_S, _COLD_S = 4.0, 0.03
_LAST: Final = 0.9
"""Share of the last vehicle in the team's time."""
_MENDS: Final = 20
_MEND_MOVES, _MEND_S = 2000, 0.3
"""Moves and their temperature where a cell was missed."""


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
        row = ground.kinematics.row(Tuning(), next_frame_s=0.0)
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
        """The waypoints as paths."""
        return [path_of(self.team, ways, k, 0.0)[0] for k in range(self.robots)]


def reference(roi: Roi, team: Team, *, moves_a_cell: int = MOVES_A_CELL, seed: int = 1) -> Flown:
    """The best run found for a team that knows the region; frames do not err or get lost.

    Raises `StrategyError` as `Team.kinematics`, and where nothing is found.
    """
    team = replace(team, camera=replace(team.camera, error_rate=0.0, loss_rate=0.0))
    best: Flown | None = None
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
    """First waypoints: lanes along the east, along the north, or none."""
    ways = np.zeros((robots, kernels.MOST_WAYPOINTS, 3))
    counts = np.ones(robots, np.int64)
    lanes = list(_lanes(ground, along_north=start == 1)) if start < 2 else []
    share = -(-len(lanes) // robots)
    for k in range(robots):
        mine = lanes[k * share : (k + 1) * share]
        points: list[GridPoint] = []
        for index, (begin, end) in enumerate(mine):
            points += (end, begin) if index % 2 else (begin, end)
        points = [*points[: kernels.MOST_WAYPOINTS // 2], ground.home]
        counts[k] = len(points)
        ways[k, : len(points), :2] = points
        ways[k, : len(points), 2] = Tuning().cut_m
    return kernels.Ways(
        ways, counts, np.full(robots, kernels.LEADS - 1, np.int64), np.zeros(robots)
    )


def _lanes(ground: Ground, *, along_north: bool) -> Sequence[tuple[GridPoint, GridPoint]]:
    """Lanes through the needed cells, as far apart as a frame shows rows."""
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
