"""Flight without stopping over a region that only the arena knows: no take-off, no search.

All vehicles begin over the start cell at one height. Frames are taken at even intervals and judged
at once; a cell that a frame shows whole gets a vote. The run ends when every cell of the region and
its neighbours is decided and all vehicles rest over the start.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.errors import StrategyError
from missions.geo.trajectory import Trajectory
from missions.lab.arena.roi import Roi
from missions.planning.kernels import worth as kernels
from missions.planning.sweep.chart import PAD_CELLS, Chart
from missions.planning.sweep.paths import Flyer, Kinematics, Plan, Route, Tuning
from missions.planning.sweep.sweep_planner import Planner
from missions.units import Cell, GridPoint

FRUITLESS_PLANS: Final = 30
"""Number of plans without news after which the rest is given up."""
LONGEST_S: Final = 200_000.0
"""Time after which a run is given up, s."""
REPLAN_S: Final = 0.4
"""Minimum time between two plans in flight, s."""


@dataclass(frozen=True, slots=True)
class Camera:
    """The sides of a frame on the ground along the grid, its votes, and its errors."""

    east_m: float
    north_m: float
    frame_s: float = 0.2
    frames: int = 5
    """Maximum number of counted votes of a cell; `majority` of them make it ROI."""
    majority: int = 3
    error_rate: float = 0.0
    """Probability of each vote to be wrong."""
    loss_rate: float = 0.0
    """Probability of each frame to be lost."""

    @property
    def against(self) -> int:
        """Votes against that decide a cell."""
        return self.frames - self.majority + 1

    def kinematics(self, speed_m_s: float, accel_m_s2: float, cell_m: float) -> Kinematics:
        """Return the kinematics of a vehicle with this camera.

        Raises `StrategyError` for a footprint that never shows a whole cell for long enough.
        """
        least_m = cell_m + 1.0
        if min(self.east_m, self.north_m) < least_m:
            raise StrategyError(
                f"a footprint of {self.east_m:g} m x {self.north_m:g} m is too small for cells of "
                f"{cell_m:g} m; {least_m:g} m see them whole in passing"
            )
        half_east_m, half_north_m = (self.east_m - cell_m) / 2, (self.north_m - cell_m) / 2
        return Kinematics(speed_m_s, accel_m_s2, self.frame_s, half_east_m, half_north_m)


@dataclass(frozen=True, slots=True)
class Verdict:
    """A change of a cell's verdict: by a majority so far, or decided."""

    t_s: float
    cell: Cell
    roi: bool
    decided: bool


@dataclass(frozen=True, slots=True)
class FlightResult:
    """The outcome of a run."""

    makespan_s: float
    missed: int
    """Needed cells that are not decided."""
    wrong: int
    """Cells decided against the truth."""
    decisions: int
    """Number of plans."""
    paths: tuple[tuple[Trajectory, ...], ...] = ()
    """Paths by vehicle, each flown until the next begins; only of a recorded run."""
    verdicts: tuple[Verdict, ...] = ()
    """Verdicts in the order of time; only of a recorded run."""


@dataclass(slots=True)
class Ground:
    """The truth, and the part of it that frames have shown."""

    roi: Roi
    cell_m: float
    kinematics: Kinematics
    camera: Camera
    seed: int = 1
    record: bool = False
    chart: Chart = field(init=False)
    truth: NDArray[np.int64] = field(init=False)
    verdicts: list[Verdict] = field(default_factory=list)
    _random: np.random.Generator = field(init=False)
    _right: NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        shown = math.ceil(max(self.camera.east_m, self.camera.north_m) / self.cell_m)
        self.chart = Chart.around(self.roi.cells, self.cell_m, max(PAD_CELLS, shown))
        self.truth = np.zeros(self.chart.columns * self.chart.rows, np.int64)
        for cell in self.roi.cells:
            self.truth[self.chart.index(cell)] = 1
        self._random = np.random.default_rng(self.seed)
        self._right = np.zeros_like(self.truth)

    @property
    def home(self) -> GridPoint:
        """The centre of the start cell."""
        return GridPoint(self.roi.start.east * self.cell_m, self.roi.start.north * self.cell_m)

    def frame(self, t_s: float, path: Trajectory | None) -> int:
        """Take a frame from a path, or over the start; return the number of counted votes."""
        camera, chart = self.camera, self.chart
        x, y = self.home if path is None else self._middle(path, t_s)
        if camera.loss_rate and self._random.random() < camera.loss_rate:
            return 0
        wrong = self._right
        if camera.error_rate:
            wrong = (self._random.random(self.truth.size) < camera.error_rate).astype(np.int64)
        before = self._standing() if self.record else None
        counted: int = kernels.see(
            x, y, self.kinematics.half_east_m, self.kinematics.half_north_m, chart.grid,
            self.truth, wrong, chart.yes, chart.no, camera.frames, camera.majority,
        )  # fmt: skip
        if before is not None:
            standing = self._standing()
            for index in np.flatnonzero(standing != before):
                state = int(standing[index])
                cell = chart.cell(int(index))
                self.verdicts.append(Verdict(t_s, cell, state > 0, abs(state) == 2))
        return counted

    def _middle(self, path: Trajectory, t_s: float) -> tuple[float, float]:
        kin, m = self.kinematics, path.at(t_s)
        if not kin.tilt_m_s2:
            return m.east_m, m.north_m
        east = m.a_east_m_s2 + kin.drag_1_s * (m.v_east_m_s - kin.wind_east_m_s)
        north = m.a_north_m_s2 + kin.drag_1_s * (m.v_north_m_s - kin.wind_north_m_s)
        return m.east_m - kin.tilt_m_s2 * east, m.north_m - kin.tilt_m_s2 * north

    def decided(self) -> NDArray[np.bool_]:
        """Return True for each cell whose verdict further votes could not change."""
        chart, camera = self.chart, self.camera
        return np.asarray((chart.yes >= camera.majority) | (chart.no >= camera.against))

    def _standing(self) -> NDArray[np.int64]:
        """Return by cell 1 and -1 for a majority for and against ROI, twice that if decided."""
        sign = np.sign(self.chart.yes - self.chart.no)
        standing: NDArray[np.int64] = np.where(self.decided(), 2 * sign, sign)
        return standing

    def needed(self) -> NDArray[np.int64]:
        """Return the cells to decide: the region and its neighbours."""
        cells = {near for cell in self.roi.cells for near in cell.cross()}
        return np.array(sorted(map(self.chart.index, cells)), np.int64)

    def along(self, paths: Sequence[Trajectory]) -> FlightResult:
        """Fly paths to their ends, frame by frame, without a plan."""
        end_s = max(path.end_s for path in paths)
        for tick in range(math.floor(end_s / self.camera.frame_s + 1e-9) + 1):
            for path in paths:
                self.frame(tick * self.camera.frame_s, path)
        return self.outcome(end_s, 0, tuple((path,) for path in paths))

    def outcome(
        self, makespan_s: float, decisions: int, paths: tuple[tuple[Trajectory, ...], ...]
    ) -> FlightResult:
        """Return the outcome of a run that ended at `makespan_s`."""
        decided = self.decided()
        roi = self.chart.yes >= self.camera.majority
        return FlightResult(
            makespan_s,
            int((~decided[self.needed()]).sum()),
            int((decided & (roi != (self.truth == 1))).sum()),
            decisions,
            paths if self.record else (),
            tuple(self.verdicts),
        )


@dataclass(frozen=True, slots=True)
class Team:
    """Vehicles that are all alike, and the edge of the cells that they map."""

    robots: int
    camera: Camera
    cell_m: float = 4.0
    speed_m_s: float = 6.0
    accel_m_s2: float = 2.5

    @property
    def kinematics(self) -> Kinematics:
        """The kinematics of each. Raises `StrategyError` as `Camera.kinematics` does."""
        return self.camera.kinematics(self.speed_m_s, self.accel_m_s2, self.cell_m)

    def over(self, roi: Roi, seed: int = 1, *, record: bool = False) -> Ground:
        """Return an unseen region. Raises `StrategyError` as `kinematics` does."""
        return Ground(roi, self.cell_m, self.kinematics, self.camera, seed, record)


@dataclass(slots=True)
class Run:
    """A run of the planner under way."""

    ground: Ground
    robots: int
    planner: Planner
    t_s: float = 0.0
    paths: list[Trajectory | None] = field(init=False)
    routes: list[Route | None] = field(init=False)
    decisions: int = 0
    _flown: list[list[Trajectory]] = field(init=False)

    def __post_init__(self) -> None:
        self.paths = [None] * self.robots
        self.routes = [None] * self.robots
        self._flown = [[] for _ in range(self.robots)]

    def fly(self) -> FlightResult:
        """Fly to the end."""
        ground = self.ground
        tick, planned_s, news, fruitless = 0, -math.inf, True, 0
        while self.t_s < LONGEST_S and fruitless < FRUITLESS_PLANS:
            self.t_s = tick * ground.camera.frame_s
            if sum(ground.frame(self.t_s, path) for path in self.paths):
                news, fruitless = True, 0
            at_rest = all(path is not None and self.t_s >= path.end_s for path in self.paths)
            if at_rest or (news and self.t_s - planned_s >= REPLAN_S - 1e-9):
                plan = self._decide()
                if at_rest and plan.work == 0 and self._all_home():
                    break
                planned_s, news, fruitless = self.t_s, False, fruitless + at_rest
            tick += 1
        ends_s = [path.end_s for path in self.paths if path is not None]
        return ground.outcome(max(ends_s), self.decisions, tuple(map(tuple, self._flown)))

    def _decide(self) -> Plan:
        """Plan, and adopt the new part."""
        ground, camera, kinematics = self.ground, self.ground.camera, self.ground.kinematics
        root = ground.chart.index(ground.roi.start)
        valued = self.planner.worth(ground.chart, root, camera.frames, camera.majority)
        team = [
            Flyer(kinematics, ground.home, ground.home, path, route)
            for path, route in zip(self.paths, self.routes, strict=True)
        ]
        plan = self.planner.plan(
            ground.chart, team, valued, self.t_s, ground.seed * 1_000_003 + self.decisions,
            [kinematics.frame_s] * self.robots,
        )  # fmt: skip
        self.decisions += 1
        for k, (path, route) in enumerate(zip(plan.paths, plan.routes, strict=True)):
            if path is not None:
                self.paths[k], self.routes[k] = path, route
                if ground.record:
                    self._flown[k].append(path)
        return plan

    def _all_home(self) -> bool:
        return all(
            path is not None
            and self.t_s >= path.end_s
            and path.place_at(self.t_s).distance_to(self.ground.home) < 0.01
            for path in self.paths
        )


def fly_team(roi: Roi, team: Team, *, seed: int = 1, record: bool = False) -> FlightResult:
    """Fly one run of a team that plans in flight; raises as `Team.kinematics`.

    >>> from missions.units import Cell
    >>> lake = Roi("lake", Cell(0, 0), frozenset({Cell(0, 0), Cell(1, 0)}))
    >>> run = fly_team(lake, Team(1, Camera(15.0, 15.0)))
    >>> run.missed, run.makespan_s < 10.0
    (0, True)
    """
    return Run(team.over(roi, seed, record=record), team.robots, Planner(Tuning())).fly()
