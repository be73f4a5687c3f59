"""The arena: robots without noise explore a given ROI, led by an explorer.

A robot that arrives at a vertex observes it, learns which neighbours are ROI, and decides. Robots
that arrive at one instant first observe and then decide together. On a resting ROI at unit speed
the instants are the rounds of Sung and Tokekar, section 4.1.

With shared communication all have one tree. Robots that communicate only where they meet (the
paper's assumption) have a tree each and join them at a common vertex. Over a radio (`radio`) robots
in contact without delay decide together. With a delay or a limited rate each decides from the news
that has reached it, together only with those at its vertex.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum

from missions.errors import StrategyError
from missions.lab.arena.radio import Links, Mind, Radio, observe
from missions.mapping.tree import Tree
from missions.planning.lower_bounds import LowerBounds, drift_lower_bound, flight_lower_bound
from missions.planning.stepwise import Decision, Explorer, Situation
from missions.planning.stepwise.interface import (
    Metric,
    bound_time,
    promised_moves,
    refuse_impossible,
)
from missions.units import Cell

_SAME_INSTANT = 1e-9


class Comms(StrEnum):
    """The time when robots know the others' observations: always, or after a meeting."""

    SHARED = "shared"
    MEETING = "meeting"


@dataclass(frozen=True, slots=True)
class Leg:
    """A move of one robot."""

    robot: int
    start_t: float
    end_t: float
    start: Cell
    end: Cell


@dataclass(frozen=True, slots=True)
class Run:
    """The outcome: time of the last robot, the joined tree, every move, the last places."""

    makespan: float
    tree: Tree
    legs: tuple[Leg, ...]
    at: Mapping[int, Cell]


Team = Callable[[float, Tree], Collection[int]]
"""The robots that take part at an instant, from the time and the known tree."""


def run(
    explorer: Explorer,
    roi: Collection[Cell],
    start: Cell,
    robots: int,
    *,
    metric: Metric | None = None,
    comms: Comms | Links = Comms.SHARED,
    tree: Tree | None = None,
    team: Team | None = None,
    limit: float | None = None,
) -> Run:
    """Explore a ROI to the end and return.

    Args:
        explorer: the strategy.
        roi: the cells of the ROI; those that `start` does not reach stay unknown.
        start: the first vertex of all robots 0, 1, ...
        robots: their number.
        metric: the cost of a move, by default 1.
        comms: when robots know others' observations, or their radio.
        tree: the tree at the beginning, by default only the start.
        team: the robots that take part, by default all. One that is left out stays at the vertex
            that it reaches and is hidden from the explorer, as a vehicle that failed.
        limit: the time after which the run is given up, by default plenty.

    Raises:
        StrategyError: a strategy that jumps, never ends, or leaves all robots waiting.

    >>> from missions.planning.stepwise import EXPLORERS
    >>> run(EXPLORERS["rdfs"], {Cell(0, 0), Cell(1, 0), Cell(2, 0)}, Cell(0, 0), 1).makespan
    4.0
    """
    metric = metric if metric is not None else Metric()
    known = observe(tree if tree is not None else Tree.rooted(start), start, roi)
    slowest = 1.0 / (metric.speed - metric.drift_speed) + metric.look
    radio = Radio(comms, known.vertices.keys() | set(roi)) if isinstance(comms, Links) else None
    mind = Mind(known, dict.fromkeys(range(robots), (0.0, start)))
    everybody = range(robots)
    arena = _Arena(
        explorer, roi, metric, comms, team, radio,
        dict.fromkeys(everybody, mind), dict.fromkeys(everybody, start), set(everybody),
    )  # fmt: skip
    limit = limit if limit is not None else slowest * 50 * (len(roi) + 1) * patience_of(explorer)
    arena.play(limit)
    makespan = max((leg.end_t for leg in arena.legs), default=0.0)
    return Run(makespan, arena.everything(), tuple(arena.legs), arena.at)


def patience_of(explorer: Explorer) -> float:
    """Return the factor by which a strategy without a map may take longer than others."""
    return float(getattr(explorer, "patience", 1.0))


@dataclass(slots=True)
class _Arena:
    explorer: Explorer
    roi: Collection[Cell]
    metric: Metric
    comms: Comms | Links
    team: Team | None
    radio: Radio | None
    minds: dict[int, Mind]
    at: dict[int, Cell]
    ready: set[int]
    t: float = 0.0
    flying: dict[int, Leg] = field(default_factory=dict)
    legs: list[Leg] = field(default_factory=list)
    decided_from: dict[int, Mind] = field(default_factory=dict)
    """The mind from which each robot decided last."""

    def play(self, limit: float) -> None:
        """Run instant after instant until all are done."""
        self._receive()
        anew = True
        while True:
            present = self._present()
            moved = self._decide(present, anew=anew)
            if self.radio is not None and self.radio.links.delay:
                self.radio.send(self.minds)
            if not self.flying:
                if all(self.minds[r].done(self.at[r]) for r in self.at):
                    return
                if not moved and self.team is None and self.radio is None:
                    raise StrategyError(
                        f"{self.explorer.name}: all robots wait at t = {self.t:g}, and ROI cells "
                        "are left"
                    )
                if self.radio is None:
                    self.t += 1.0  # for robots that come back
            if self.flying or self.radio is not None:
                anew = self._arrive()
            if self.t > limit:
                raise StrategyError(
                    f"{self.explorer.name}: not done after {limit:g}; it does not come to an end"
                )

    def everything(self) -> Tree:
        """Return the tree of the joint knowledge of all."""
        minds = list(self.minds.values())
        all_of_it = minds[0]
        for mind in minds[1:]:
            all_of_it = all_of_it.meet(mind)
        return all_of_it.tree

    def _present(self) -> set[int]:
        if self.team is None:
            return set(self.at)
        return set(self.team(self.t, self.everything()))

    def _decide(self, present: set[int], *, anew: bool) -> bool:
        """Ask the explorer for the robots at vertices; unless `anew`, for those with news only."""
        moved = False
        for group in self._groups(self.ready & present):
            mind = self.minds[group[0]]
            asked = tuple(r for r in group if not mind.done(self.at[r]))
            if not asked or not (
                anew or any(self.minds[r] is not self.decided_from.get(r) for r in group)
            ):
                continue
            at = {r: mind.known_at[r][1] for r in sorted(mind.known_at) if r in present}
            situation = Situation(mind.tree, at, asked, mind.memory, self.metric)
            decision = self.explorer.decide(situation)
            refuse_impossible(self.explorer.name, situation, decision)
            moved |= self._go(mind, group, decision)
            self.decided_from.update((r, self.minds[r]) for r in group)
        return moved

    def _groups(self, ready: Iterable[int]) -> list[list[int]]:
        """Return robots that decide together: all, those in contact, or those at one vertex."""
        ordered = sorted(ready)
        if self.comms is Comms.SHARED:
            return [ordered] if ordered else []
        together: dict[object, list[int]] = {}
        for robot in ordered:
            key = () if self.radio is None else self.radio.together(robot)
            together.setdefault(key or self.at[robot], []).append(robot)
        return list(together.values())

    def _audience(self, here: Sequence[int]) -> Iterable[int]:
        """Return the robots that know at once the observations and actions of a group."""
        if self.comms is Comms.SHARED:
            return self.minds
        return here if self.radio is None else self.radio.together(here[0]) or here

    def _go(self, mind: Mind, group: list[int], decision: Decision) -> bool:
        known_at = dict(mind.known_at)
        moves = {r: cell for r, cell in decision.moves.items() if cell is not None}
        for robot, cell in moves.items():
            start = self.at[robot]
            known_at[robot] = (self.t, cell)
            leg_t = self.metric.leg(start, cell)
            if self.metric.look and not mind.tree.is_observed(cell):
                leg_t += self.metric.look
            leg = Leg(robot, self.t, self.t + leg_t, start, cell)
            self.flying[robot] = leg
            self.legs.append(leg)
            self.ready.discard(robot)
        after = replace(mind, known_at=known_at, memory=decision.memory)
        for robot in self._audience(group):
            self.minds[robot] = after
        if self.radio is not None:
            self.radio.send_places(group[0], self.minds)
        return bool(moves)

    def _arrive(self) -> bool:
        """Pass time until robots arrive, observe and join their knowledge; return True if any do.

        With a radio the time passes at most to the next whole unit.
        """
        self.t = self._next_instant()
        arrived = sorted(r for r, leg in self.flying.items() if leg.end_t <= self.t + _SAME_INSTANT)
        for robot in arrived:
            self.at[robot] = self.flying.pop(robot).end
            self.ready.add(robot)
        if self.comms is Comms.MEETING:
            self._meet({self.at[r] for r in arrived})
        self._receive()
        for cell in self._in_order(arrived):
            here = sorted(r for r in self.ready if self.at[r] == cell)
            mind = self.minds[here[0]]
            if not mind.tree.is_observed(cell):
                observed = 0 if self.radio is None else mind.observed | self.radio.bit(cell)
                seen = replace(mind, tree=observe(mind.tree, cell, self.roi), observed=observed)
                for robot in self._audience(here):
                    self.minds[robot] = seen
        if self.radio is not None and not self.radio.links.delay:
            self.radio.send(self.minds)
            self._meet({self.at[r] for r in self.ready})
        return bool(arrived)

    def _next_instant(self) -> float:
        arrival_t = min((leg.end_t for leg in self.flying.values()), default=math.inf)
        if self.radio is None:
            return arrival_t
        unit_t = math.floor(self.t + _SAME_INSTANT) + 1.0
        return arrival_t if arrival_t <= unit_t + _SAME_INSTANT else unit_t

    def _receive(self) -> None:
        if self.radio is None:
            return
        places = {r: (float(cell.east), float(cell.north)) for r, cell in self.at.items()}
        for robot, leg in self.flying.items():
            flown = min((self.t - leg.start_t) / self.metric.leg(leg.start, leg.end), 1.0)
            east, north = leg.end.east - leg.start.east, leg.end.north - leg.start.north
            places[robot] = (leg.start.east + flown * east, leg.start.north + flown * north)
        self.radio.tune(self.t, places, {r: self.at[r] for r in self.ready})
        self._meet({self.at[r] for r in self.ready})
        self.radio.deliver(self.minds, {r for r in self.ready if self.minds[r].done(self.at[r])})
        self._meet({self.at[r] for r in self.ready})

    def _in_order(self, arrived: list[int]) -> list[Cell]:
        """Return the cells of arrivals by depth, then the outermost first.

        The first observation makes a cell that two see its child, so the order must not depend on
        the numbers of the robots.
        """
        root = self.minds[0].tree.root
        depth = {self.at[r]: self.minds[r].tree.vertices[self.at[r]].depth for r in arrived}

        def rank(cell: Cell) -> tuple[int, int, Cell]:
            away = (cell.east - root.east) ** 2 + (cell.north - root.north) ** 2
            return depth[cell], -away, cell

        return sorted(depth, key=rank)

    def _meet(self, places: set[Cell]) -> None:
        for place in sorted(places):
            here = sorted(r for r in self.ready if self.at[r] == place)
            mind = self.minds[here[0]]
            for robot in here[1:]:
                mind = mind.meet(self.minds[robot])
            for robot in here:
                self.minds[robot] = mind


_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Certificate:
    """A makespan between its bounds; all times in the same unit."""

    makespan: float
    lower_bound: float
    """Minimum makespan of any team on this ROI."""
    bound: float | None
    """The strategy's bound for this ROI; None without one."""
    tree_depth: int
    cells: int

    @property
    def bound_held(self) -> bool | None:
        """True if the strategy kept its bound; None without one."""
        if self.bound is None:
            return None
        return self.makespan <= self.bound * (1.0 + _ROUNDING)


def certify(
    run: Run,
    explorer: Explorer,
    robots: int,
    metric: Metric,
    static: LowerBounds,
    comms: Comms | Links = Comms.SHARED,
) -> Certificate:
    """Return the certificate of a run in the arena that explored the whole ROI.

    `static` holds the bounds for steps to neighbours; straight flight has its own. Bounds of
    strategies hold for teams that share their knowledge. Other teams enter explored ground and get
    no bound, nor does a case that `promised_moves` excludes.
    """
    tree = run.tree
    lower = flight_lower_bound(tree.vertices, tree.root, robots, metric)
    if not metric.straight:
        lower = max(lower, drift_lower_bound(static.moves(robots), metric))
    shared = comms is Comms.SHARED
    moves = promised_moves(explorer, tree, robots, metric) if shared else None
    return Certificate(
        makespan=run.makespan,
        lower_bound=lower,
        bound=bound_time(moves, metric),
        tree_depth=tree.depth,
        cells=len(tree),
    )
