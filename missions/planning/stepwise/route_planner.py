"""The sites of a team's routes: cells to observe, the robots, and home."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from missions.mapping.tree import Tree, distances
from missions.planning.stepwise.interface import Metric, Situation
from missions.units import Cell

if TYPE_CHECKING:
    from missions.planning.kernels.routes import Outlays

MOVES, MOVES_EACH = 25000, 300
"""Maximum attempts of the local search at each step: in all, and for each node."""
TEAM_MOVES_TIMES_NODES_SQUARED = 4_000_000_000
"""Limit for a team: an attempt takes longer with more nodes, and more decisions are made.

25,000 attempts at 400 nodes, 4,000 at 1,000.
"""
ATTEMPTS_PER_NODE_SINGLE, ATTEMPTS_PER_NODE_TEAM, ATTEMPTS_EXTRA = 200, 60, 30
"""Attempts per node: of one robot; of a team, and the addition for each of its robots."""
INITIAL_TEMPERATURE = 0.02
"""Increase of the whole cost that an attempt may make at first, as a fraction."""
SMALL_TEAM = 4
"""Maximum number of robots that plan with nooks as if they were ROI: cells between known ones."""
DEPTH, OCCUPIED = 0.85, 2.5
"""Weights for a robot without a route: the depth of its goal, and other robots there."""
_MARGIN = 3


@dataclass(frozen=True, slots=True)
class FrontierCost:
    """The planner's estimates for unknown cells, in steps.

    Tuned on grown ROIs of 120 and 500 cells, and in flight on ROIs of 300 and 400. Other growths
    have other optima, so the figures are round.
    """

    unseen: float
    """Mean addition of an unobserved cell to a tour."""
    behind: float
    """Possible addition of an unobserved cell to a tour."""
    far: float
    """Possible extension behind any node with unobserved cells, in return paths from the farthest
    node.

    The larger the ROI has become, the farther it may extend.
    """
    share: float
    """Weight of such a longer tour beside the known tour."""


FEW, MANY = FrontierCost(0.5, 3.5, 0.4, 0.15), FrontierCost(1.0, 4.0, 0.4, 0.3)
"""Costs for up to `SMALL_TEAM` robots, and for more."""
FLOWN = FrontierCost(0.0, 0.5, 0.0, 0.3)
"""Costs in straight flight, where a cell that was left behind is not far away."""


@dataclass(frozen=True, slots=True)
class Ground:
    """The known cells as arrays."""

    corner: Cell
    width: int
    picture: NDArray[np.int8]
    cells: NDArray[np.int32]
    near: NDArray[np.int32]
    unseen: NDArray[np.int32]

    @classmethod
    def from_tree(cls, tree: Tree) -> Ground:
        """Return the vertices of a tree."""
        # numba takes a second to import, so the kernels are imported where they are needed
        from missions.planning.kernels import ground as kernels  # noqa: PLC0415

        count = len(tree)
        cells = np.fromiter(chain.from_iterable(tree.vertices), np.int64, 2 * count)
        east, north = cells[0::2], cells[1::2]
        looked = np.fromiter((v.observed for v in tree.vertices.values()), np.bool_, count)
        corner = Cell(int(east.min()) - _MARGIN, int(north.min()) - _MARGIN)
        width = int(east.max()) - corner.east + _MARGIN + 1
        height = int(north.max()) - corner.north + _MARGIN + 1
        picture = np.zeros(width * height, np.int8)
        flat = (north - corner.north) * width + east - corner.east
        picture[flat] = np.where(looked, kernels.LOOKED, kernels.UNLOOKED)
        numbers, near, unseen = kernels.survey(picture, width)
        return cls(corner, width, picture, numbers, near, unseen)

    def with_nooks(self) -> Ground:
        """Return the ground with the nooks between the known cells."""
        from missions.planning.kernels import ground as kernels  # noqa: PLC0415, as above

        picture = self.picture.copy()
        kernels.imagine(picture, self.width)
        cells, near, unseen = kernels.survey(picture, self.width)
        return replace(self, picture=picture, cells=cells, near=near, unseen=unseen)

    def number(self, cell: Cell) -> int:
        """Return the number of a known cell."""
        flat = (cell.north - self.corner.north) * self.width + cell.east - self.corner.east
        return int(self.cells.searchsorted(flat))

    def cells_of(self, numbers: NDArray[np.intp]) -> tuple[Cell, ...]:
        """Return the cells of numbers: the inverse of `number`."""
        north, east = np.divmod(self.cells[numbers], self.width)
        east, north = east + self.corner.east, north + self.corner.north
        return tuple(map(Cell, east.tolist(), north.tolist()))

    def steps_from(self, cell: Cell) -> NDArray[np.int32]:
        """Return the steps from a cell to every other, by number."""
        from missions.planning.kernels import ground as kernels  # noqa: PLC0415, as above

        steps: NDArray[np.int32] = kernels.spread(
            self.near, np.array([self.number(cell)], np.int32)
        )[0]
        return steps

    def towards(self, situation: Situation, start: Cell, goal: Cell) -> Cell:
        """Return the next vertex on the way to a known or imagined goal.

        Over the grid it is a neighbour. In flight it is the goal if the straight way is allowed.
        Else it is the last vertex of a shortest way that is reached straight.
        """
        if not situation.metric.straight:
            return self._step(start, goal)
        allowed = situation.metric.passable
        if allowed is None or allowed(start, goal):
            return goal
        steps = distances(situation.tree, goal)
        reached = cell = min(start.neighbours(), key=lambda near: steps.get(near, len(steps)))
        while cell != goal:
            cell = min(cell.neighbours(), key=lambda near: steps.get(near, len(steps)))
            if allowed(start, cell):
                reached = cell
        return reached

    def _step(self, start: Cell, goal: Cell) -> Cell:
        from missions.planning.kernels import ground as kernels  # noqa: PLC0415, as above

        steps = self.steps_from(goal)
        fresh = self.picture[self.cells] != kernels.LOOKED
        number = kernels.step_on(self.near, steps, fresh, self.number(start))
        return self.cells_of(np.array([number]))[0]


@dataclass(frozen=True, slots=True)
class Sites:
    """Nodes, robots and home, in this order, with the costs between them.

    Costs are in steps of one cell.
    """

    ground: Ground
    metric: Metric
    tree: Tree
    places: Mapping[int, Cell]
    """Start of each robot's route."""
    nodes: tuple[Cell, ...]
    legs: NDArray[np.float64]
    unseen: NDArray[np.int32]
    """Number of unobserved neighbours of each site; 0 for an observed site."""

    @classmethod
    def from_situation(
        cls, situation: Situation, ground: Ground, places: Mapping[int, Cell]
    ) -> Sites:
        """Return sites whose nodes are the vertices that no robot has observed or is on its way
        to."""
        from missions.planning.kernels import ground as kernels  # noqa: PLC0415, as above

        tree, metric = situation.tree, situation.metric
        others = [ground.number(cell) for cell in (*places.values(), tree.root)]
        open_to_all = ground.picture[ground.cells] != kernels.LOOKED
        open_to_all[others] = False
        free = np.flatnonzero(open_to_all)
        nodes = ground.cells_of(free)
        cells = (*nodes, *places.values(), tree.root)
        numbers = np.array([*free.tolist(), *others], np.int32)
        if metric.straight:
            legs = _straight(metric, cells)
        else:
            steps = kernels.spread(ground.near, numbers)
            # rows first, as the other two have them: kernels are compiled again for each order
            legs = steps[:, numbers].astype(np.float64, order="C")
        return cls(ground, metric, tree, dict(places), nodes, legs, ground.unseen[numbers])

    def routes(
        self, last: Mapping[int, Sequence[Cell]], decisions: int
    ) -> dict[int, tuple[Cell, ...]]:
        """Return a route for every robot, the nodes in their order, improved from the last ones."""
        from missions.planning.kernels import routes as kernels  # noqa: PLC0415, as above

        index = {cell: node for node, cell in enumerate(self.nodes)}
        rows = [[index.pop(c) for c in last.get(r, ()) if c in index] for r in self.places]
        before = np.zeros((len(rows), max(map(len, rows))), np.int32)
        for row, nodes in zip(before, rows, strict=True):
            row[: len(nodes)] = nodes
        lengths = np.array([len(nodes) for nodes in rows], np.int64)
        each = ATTEMPTS_PER_NODE_SINGLE
        if len(self.places) > 1:
            each = min(MOVES_EACH, ATTEMPTS_PER_NODE_TEAM + ATTEMPTS_EXTRA * len(self.places))
        moves = min(MOVES, each * len(self.nodes))
        if len(self.places) > 1 and self.nodes:
            moves = min(moves, TEAM_MOVES_TIMES_NODES_SQUARED // len(self.nodes) ** 2)
        seed = (decisions * 104729 + 12345) & 0x7FFFFFFF
        routes, counts = kernels.arrange(
            self._outlays(), before, lengths, moves, INITIAL_TEMPERATURE, seed
        )
        return {
            r: tuple(self.nodes[node] for node in route[:count])
            for r, route, count in zip(self.places, routes, counts, strict=True)
        }

    def _outlays(self) -> Outlays:
        from missions.planning.kernels.routes import Outlays  # noqa: PLC0415, as above

        frontier_cost = FLOWN
        if not self.metric.straight:
            frontier_cost = FEW if len(self.places) <= SMALL_TEAM else MANY
        looks = self.metric.look / step_cost(self.metric)
        count = len(self.nodes)
        unseen = self.unseen[:count].astype(np.float64)
        loads = looks + frontier_cost.unseen * (1.0 + looks) * unseen
        if len(self.places) == 1:  # only a team can share longer tours
            return Outlays(self.legs, loads, np.zeros(count), frontier_cost.share)
        farthest = max(self.legs[:count, -1].max(initial=0.0), 1.0)
        behind = frontier_cost.behind * unseen + frontier_cost.far * farthest * (unseen > 0.0)
        return Outlays(self.legs, loads, (1.0 + looks) * behind, frontier_cost.share)

    def goals(self, routes: Mapping[int, Sequence[Cell]], asked: Sequence[int]) -> dict[int, Cell]:
        """Return goals along the routes, or, where these are empty, after the others.

        While there is a node some robot goes to one.
        """
        goals = {r: routes[r][0] for r in self.places if routes[r]}
        idle = [r for r in asked if r not in goals]
        if self.nodes and len(idle) == len(asked):
            robot = idle.pop(0)
            row = self.legs[self._site(robot), : len(self.nodes)]
            goals[robot] = self.nodes[int(row.argmin())]
        if idle:
            goals.update(self._behind(idle, goals))
        return {robot: goals[robot] for robot in asked}

    def _site(self, robot: int) -> int:
        return len(self.nodes) + list(self.places).index(robot)

    def _behind(self, idle: Sequence[int], goals: Mapping[int, Cell]) -> dict[int, Cell]:
        """Return goals of robots without a route.

        On a grid it is the open frontier where it is deep, near and free; home without one. In
        straight flight they wait for news.
        """
        cells = (*self.nodes, *self.places.values())
        open_sites = np.flatnonzero(self.unseen[:-1])
        if open_sites.size == 0:
            return dict.fromkeys(idle, self.tree.root)
        if self.metric.straight:
            return {robot: self.places[robot] for robot in idle}
        bound_for = list(goals.values())
        taken = np.array([bound_for.count(cells[site]) for site in open_sites])
        cost = self.legs[[self._site(robot) for robot in idle]][:, open_sites]
        cost = cost - DEPTH * self.legs[-1, open_sites] + OCCUPIED * taken
        found: dict[int, Cell] = {}
        while len(found) < len(idle):  # the best pair of all, again and again
            robot, site = np.unravel_index(cost.argmin(), cost.shape)
            found[idle[int(robot)]] = cells[int(open_sites[site])]
            cost[robot] = np.inf
            cost[:, site] += OCCUPIED
        return found


def step_cost(metric: Metric) -> float:
    """Return the addition of a step of one cell to a closed tour, in the costlier direction."""
    here = Cell(0, 0)
    return metric.from_rest(max(metric.tour_leg(here, near) for near in here.neighbours()[:2]))


def _straight(metric: Metric, cells: Sequence[Cell]) -> NDArray[np.float64]:
    """Return `metric.tour_leg` between all cells, from rest to rest, in steps."""
    at = np.array(cells, np.float64)
    east = at[:, None, 0] - at[None, :, 0]
    north = at[:, None, 1] - at[None, :, 1]
    along = east * metric.drift_east + north * metric.drift_north
    rest = metric.speed**2 - metric.drift_speed**2
    legs: NDArray[np.float64] = np.sqrt(along**2 + rest * (east**2 + north**2)) / rest
    ramp = metric.ramp
    legs = np.where(legs < ramp, 2.0 * np.sqrt(legs * ramp), legs + ramp)
    return legs / step_cost(metric)
