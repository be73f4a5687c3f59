"""A rolling horizon: at every step routes for the whole team through all cells left to observe.

The nodes are the known vertices that no robot has observed. Every robot has a route through its
nodes and home. A node also counts with the unobserved cells around it, for possible finds behind
it. The routes are improved from those of the last step, and each robot makes the first step of its
own. The planner watches its own progress. In good time it goes home and leaves the rest to
Algorithm 1, so that it never takes more than twice Algorithm 1's bound.

A return home and a new start with Algorithm 1 give any planner a bound. Let B(C, D) be the bound of
Algorithm 1 for the final tree, in moves or in time. It is linear and grows with the cells C and the
depth D. A planner may continue as long as, after its next moves,

    h + B(c', d) <= 2 B(c, d)                                                       (1)

where h is the time of the last return if all turned back after these moves, by shortest known ways.
The cells and the depth known are c and d. T' is the known tree, pruned to the paths from the root
to vertices that no robot has observed. It has c' vertices.

When (1) would fail, all go home and wait for the last. They explore T' by Algorithm 1 as if no
robot had been there; finds are added below it. Then the makespan is at most 2 B(C, D):

* The robots are where (1) allowed them to be, so all are home by h.
* T' is explored by Algorithm 1 from the root and from nothing. With C' vertices and depth D' at its
  end it takes B(C', D') at most. Knowing a branch before it is entered changes nothing, as the rule
  uses only the children of the vertex where a robot is.
* A vertex that is found later counts in C and in C' alike: C' <= c' + C - c. (1) uses not the depth
  of T' but d, so B(C', D') - B(c', d) <= B(C, D) - B(c, d).
* So T <= h + B(C', D') <= 2 B(c, d) + B(C, D) - B(c, d) <= 2 B(C, D).

When it never fails, h at the last observation is the makespan itself, and (1) gives T <= 2 B(C, D).
At the start (1) holds: with one move out and one back h = 2 <= B(c, 1), and c' <= c. The argument
assumes rounds of unit moves, shared knowledge, and a team that stays the same.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

from missions.mapping.tree import Tree, Vertex, step_home
from missions.planning.stepwise.interface import Decision, Situation
from missions.planning.stepwise.rdfs import Rdfs, rdfs_bound_moves
from missions.planning.stepwise.route_planner import SMALL_TEAM, Ground, Sites, step_cost
from missions.units import Cell


@dataclass(frozen=True, slots=True)
class Retreat:
    """The state of a retreat: vertices that are done, and those observed anew since."""

    dropped: frozenset[Cell]
    """Vertices outside T'."""
    passed: frozenset[Cell] = frozenset()
    """Vertices of T' that a robot has visited since it came home."""
    home: frozenset[int] = frozenset()
    """Robots that have been home."""

    @classmethod
    def from_tree(cls, tree: Tree) -> Retreat:
        """Return the retreat that begins now."""
        return cls(frozenset(cell for cell in tree.vertices if tree.is_explored(cell)))

    def moves(self, situation: Situation) -> tuple[dict[int, Cell | None], Retreat]:
        """Return the moves of the robots that decide, and the state after."""
        tree, at, robots = situation.tree, situation.at, situation.robots
        dropped = _closed(tree, self.dropped)
        arrived = {r for r in robots if at[r] == tree.root}
        home = frozenset(r for r in self.home | arrived if r in at and at[r] not in dropped)
        if tree.is_explored(tree.root):
            return {r: step_home(tree, at[r]) for r in robots}, replace(self, home=home)
        started = bool(self.passed) or set(robots) != set(at) or home >= set(at)
        if not started:  # those at home wait for the last
            homeward: dict[int, Cell | None] = {r: step_home(tree, at[r]) for r in robots}
            return homeward, Retreat(dropped, frozenset(), home)
        exploring = tuple(r for r in robots if r in home)
        passed = self.passed | {at[r] for r in exploring}
        among = {r: cell for r, cell in at.items() if r in home}
        fresh = _anew(tree, dropped, passed)
        moves = dict(
            Rdfs().decide(replace(situation, tree=fresh, at=among, robots=exploring)).moves
        )
        moves.update({r: step_home(tree, at[r]) for r in robots if r not in home})
        return moves, Retreat(dropped, passed, home)


def _closed(tree: Tree, dropped: frozenset[Cell]) -> frozenset[Cell]:
    """Return the dropped vertices without the paths to the root of others.

    Those are cells that became ROI late, or have another parent since two trees were joined.
    """
    back = set()
    for cell in tree.vertices:
        up = None if cell in dropped else tree.parent(cell)
        while up is not None and up in dropped and up not in back:
            back.add(up)
            up = tree.parent(up)
    return dropped - back


def _anew(tree: Tree, dropped: Collection[Cell], passed: Collection[Cell]) -> Tree:
    """Return T': the vertices that are not dropped, observed only if a robot has been there
    since."""
    return Tree.from_vertices(
        tree.root,
        {
            cell: Vertex(vertex.parent, vertex.depth, vertex.observed and cell in passed)
            for cell, vertex in tree.vertices.items()
            if cell not in dropped
        },
    )


@dataclass(frozen=True, slots=True)
class PlannerMemory:
    """The memory of the planner."""

    routes: Mapping[int, tuple[Cell, ...]] = field(default_factory=dict)
    """Each robot's route through the vertices that are left."""
    goals: Mapping[int, Cell] = field(default_factory=dict)
    """Targets of robots that do not decide in step with all others."""
    clocks: Mapping[int, float] = field(default_factory=dict)
    """Time when each robot is at the vertex of its last move."""
    now: float = 0.0
    decisions: int = 0
    retreat: Retreat | None = None


@dataclass(frozen=True, slots=True)
class Horizon:
    """The planner. `until` is a time after which it retreats in any case.

    >>> from missions.mapping.tree import Tree
    >>> tree = Tree.rooted(Cell(0, 0)).with_observation(Cell(0, 0), [Cell(0, 1), Cell(1, 0)])
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
        """Return twice Lemma 1."""
        return 2.0 * rdfs_bound_moves(cells, depth, robots)

    def decide(self, situation: Situation) -> Decision:
        """Return the first steps of the routes, or those of the retreat."""
        outlook = (
            situation.memory if isinstance(situation.memory, PlannerMemory) else PlannerMemory()
        )
        if outlook.retreat is None:
            ground = Ground.from_tree(situation.tree)
            moves, ahead = _ahead(situation, outlook, ground)
            if ahead.now < self.until and _in_time(situation, moves, ahead, ground):
                return Decision(moves, ahead)
            outlook = replace(outlook, retreat=Retreat.from_tree(situation.tree))
        assert outlook.retreat is not None
        moves, retreat = outlook.retreat.moves(situation)
        return Decision(moves, replace(outlook, retreat=retreat))


def _ahead(
    situation: Situation, outlook: PlannerMemory, ground: Ground
) -> tuple[dict[int, Cell | None], PlannerMemory]:
    """Return the next steps of the routes, and the new memory.

    If not all robots decide at once, one on its way to a vertex counts as being there. It keeps its
    target until a robot has observed it. So each decision leads to an observation, even when
    others' knowledge is out of date. A robot that is away for a battery has no share until it is
    back.
    """
    tree, at, robots = situation.tree, situation.at, situation.robots
    goals: dict[int, Cell] = {}
    together = set(robots) == set(at)
    if not together:
        goals = {
            r: goal
            for r, goal in outlook.goals.items()
            if r in at and r not in situation.away and goal in tree and not tree.is_observed(goal)
        }
    if tree.is_explored(tree.root):
        goals.update(dict.fromkeys(robots, tree.root))
    asked = [r for r in robots if r not in goals]
    routes = outlook.routes
    wide = ground
    if asked:
        small = together and len(at) <= SMALL_TEAM and not situation.metric.straight
        wide = ground.with_nooks() if small else ground  # no robot keeps to a guess
        away = situation.away.difference(robots)
        places = {r: cell for r, cell in {**at, **goals}.items() if r not in away}
        sites = Sites.from_situation(situation, wide, places)
        routes = sites.routes(routes, outlook.decisions)
        for robot, goal in sites.goals(routes, asked).items():
            goals[robot] = goal
    moves: dict[int, Cell | None] = {}
    for robot in robots:
        goal = goals.get(robot, at[robot])
        moves[robot] = None if goal == at[robot] else wide.towards(situation, at[robot], goal)
    kept = {r: goal for r, goal in goals.items() if goal in tree and not tree.is_observed(goal)}
    now, clocks = _clocks(situation, outlook, moves)
    return moves, PlannerMemory(routes, kept, clocks, now, outlook.decisions + 1)


def _clocks(
    situation: Situation, outlook: PlannerMemory, moves: Mapping[int, Cell | None]
) -> tuple[float, dict[int, float]]:
    """Return the time, and when each robot is done with its move; waiting takes a step."""
    tree, at, metric = situation.tree, situation.at, situation.metric
    clocks = {r: outlook.clocks.get(r, outlook.now) for r in at}
    now = max(outlook.now, *(clocks[r] for r in situation.robots))
    for robot, cell in moves.items():
        if cell is None:
            clocks[robot] = now + step_cost(metric)
        else:
            look = 0.0 if tree.is_observed(cell) else metric.look
            clocks[robot] = now + metric.from_rest(metric.tour_leg(at[robot], cell)) + look
    return now, clocks


def _in_time(
    situation: Situation, moves: Mapping[int, Cell | None], ahead: PlannerMemory, ground: Ground
) -> bool:
    """Return whether (1) of `missions.planning.stepwise.horizon` holds after the moves.

    It is in time rather than moves. A move costs a step at most. At most every second one ends with
    an observation, as tours are closed and a vertex is observed once.
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
