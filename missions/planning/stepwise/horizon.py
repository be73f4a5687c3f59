"""A rolling horizon: at every step routes for the whole team through all that is left to look at.

The nodes are the known vertices that nobody has looked from. Every robot has a route through its
nodes and home; a node counts with the unobserved cells round it besides, for what may lie behind.
The routes are improved from those of the last step, and each robot makes the first step of its own.

It watches its own progress, and in good time goes home and leaves the rest to Algorithm 1
(`missions.planning.stepwise.finish_by_rdfs`), so that it never takes more than twice Algorithm 1's
bound.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from missions.planning.stepwise.finish_by_rdfs import Retreat
from missions.planning.stepwise.interface import Decision, Situation
from missions.planning.stepwise.rdfs import rdfs_bound_moves
from missions.planning.stepwise.route_planner import SMALL_TEAM, Ground, Sites, step_cost
from missions.units import Cell


@dataclass(frozen=True, slots=True)
class PlannerMemory:
    """What the planner remembers."""

    routes: Mapping[int, tuple[Cell, ...]] = field(default_factory=dict)
    """Each robot's route through the vertices that are left."""
    goals: Mapping[int, Cell] = field(default_factory=dict)
    """Where robots are bound that do not decide in step with all others."""
    clocks: Mapping[int, float] = field(default_factory=dict)
    """When each robot is at the vertex to which it was sent last."""
    now: float = 0.0
    decisions: int = 0
    retreat: Retreat | None = None


@dataclass(frozen=True, slots=True)
class Horizon:
    """The planner. `until` is a time after which it retreats in any case.

    >>> from missions.mapping.tree import Tree
    >>> tree = Tree.rooted(Cell(0, 0)).looked(Cell(0, 0), [Cell(0, 1), Cell(1, 0)])
    >>> both = {1: Cell(0, 0), 2: Cell(0, 0)}
    >>> sorted(Horizon().decide(Situation(tree, both, (1, 2))).moves.values())
    [Cell(east=0, north=1), Cell(east=1, north=0)]
    """

    name: str = "horizon"
    guarantee: str = "T <= 4 (C - 1 + depth_T floor(log2 R)) / (1 + floor(log2 R)) moves"
    source: str = "a rolling-horizon team planner of this project; falls back to Algorithm 1"
    when: str = "you want the shortest tours from cell to cell in nearly every shape, and a promise"
    until: float = float("inf")

    def bound_moves(self, cells: int, depth: int, robots: int) -> float | None:
        """Twice Lemma 1."""
        return 2.0 * rdfs_bound_moves(cells, depth, robots)

    def decide(self, situation: Situation) -> Decision:
        """The first steps of the routes, or those of the retreat."""
        outlook = (
            situation.memory if isinstance(situation.memory, PlannerMemory) else PlannerMemory()
        )
        if outlook.retreat is None:
            ground = Ground.of(situation.tree)
            moves, ahead = _ahead(situation, outlook, ground)
            if ahead.now < self.until and _in_time(situation, moves, ahead, ground):
                return Decision(moves, ahead)
            outlook = replace(outlook, retreat=Retreat.of(situation.tree))
        assert outlook.retreat is not None
        moves, retreat = outlook.retreat.moves(situation)
        return Decision(moves, replace(outlook, retreat=retreat))


def _ahead(
    situation: Situation, outlook: PlannerMemory, ground: Ground
) -> tuple[dict[int, Cell | None], PlannerMemory]:
    """Where the routes lead next, and what to remember.

    When not all robots decide at once, whoever is bound for a vertex counts as being there, and
    keeps to it until somebody has looked from it. So each decision leads to a look, even when
    what is thought of the others is out of date. Who is away for a battery has no share until
    it is back.
    """
    tree, at, robots = situation.tree, situation.at, situation.robots
    goals: dict[int, Cell] = {}
    together = set(robots) == set(at)
    if not together:
        goals = {
            r: goal
            for r, goal in outlook.goals.items()
            if r in at and r not in situation.away and goal in tree and not tree.has_looked(goal)
        }
    if tree.is_explored(tree.root):
        goals.update(dict.fromkeys(robots, tree.root))
    asked = [r for r in robots if r not in goals]
    routes = outlook.routes
    wide = ground
    if asked:
        small = together and len(at) <= SMALL_TEAM and not situation.metric.straight
        wide = ground.with_nooks() if small else ground  # nobody keeps to a mere guess
        away = situation.away.difference(robots)
        places = {r: cell for r, cell in {**at, **goals}.items() if r not in away}
        sites = Sites.of(situation, wide, places)
        routes = sites.routes(routes, outlook.decisions)
        for robot, goal in sites.goals(routes, asked).items():
            goals[robot] = goal
    moves: dict[int, Cell | None] = {}
    for robot in robots:
        goal = goals.get(robot, at[robot])
        moves[robot] = None if goal == at[robot] else wide.towards(situation, at[robot], goal)
    kept = {r: goal for r, goal in goals.items() if goal in tree and not tree.has_looked(goal)}
    now, clocks = _clocks(situation, outlook, moves)
    return moves, PlannerMemory(routes, kept, clocks, now, outlook.decisions + 1)


def _clocks(
    situation: Situation, outlook: PlannerMemory, moves: Mapping[int, Cell | None]
) -> tuple[float, dict[int, float]]:
    """What time it is, and when each robot is done with its move; to wait is to wait for a step."""
    tree, at, metric = situation.tree, situation.at, situation.metric
    clocks = {r: outlook.clocks.get(r, outlook.now) for r in at}
    now = max(outlook.now, *(clocks[r] for r in situation.robots))
    for robot, cell in moves.items():
        if cell is None:
            clocks[robot] = now + step_cost(metric)
        else:
            look = 0.0 if tree.has_looked(cell) else metric.look
            clocks[robot] = now + metric.from_rest(metric.tour_leg(at[robot], cell)) + look
    return now, clocks


def _in_time(
    situation: Situation, moves: Mapping[int, Cell | None], ahead: PlannerMemory, ground: Ground
) -> bool:
    """Whether (1) of `missions.planning.stepwise.finish_by_rdfs` holds after the moves.

    In time rather than moves: a move costs a step at most, and at most every second one ends with
    a look, for tours are closed and a vertex is looked from once.
    """
    tree, metric = situation.tree, situation.metric
    if tree.is_explored(tree.root):
        return True
    step = step_cost(metric)

    def bound(cells: int, depth: int) -> float:
        moves = rdfs_bound_moves(cells, depth, len(situation.at))
        return moves * (step + metric.look / 2.0) + metric.look

    after = {r: moves.get(r) or cell for r, cell in situation.at.items()}
    steps = ground.steps_from(tree.root)
    home = max(ahead.clocks[r] + step * steps[ground.number(c)] for r, c in after.items())
    if home <= bound(len(tree), int(steps.max())):  # (1) holds with c' = c and at most d
        return True
    left = sum(not tree.is_explored(cell) for cell in tree.vertices)
    return bool(home + bound(left, tree.depth) <= 2.0 * bound(len(tree), tree.depth) + 1e-9)
