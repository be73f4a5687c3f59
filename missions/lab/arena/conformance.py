"""A check of the duties of every strategy, for strategies of your own:

    from missions.lab.arena.conformance import check
    check(MyStrategy())

A strategy that passes explores every ROI and brings all robots home under every condition of
`CHECKS`. It is a pure function of the situation and keeps its stated bound. The ROIs are small: a
check takes seconds.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from missions.errors import StrategyError
from missions.lab.arena.arena_run import Comms, Run, patience_of, run
from missions.lab.arena.radio import Links, observe
from missions.lab.arena.roi import component, eden, thin
from missions.mapping.tree import Tree
from missions.planning.stepwise.interface import (
    Decision,
    Explorer,
    Memory,
    Metric,
    Situation,
    promised_moves,
)
from missions.units import Cell

START = Cell(0, 0)
TEAMS = (1, 2, 3, 7)
"""Team sizes of the checks."""

Roi = frozenset[Cell]
Rois = Mapping[str, Roi]


def check(explorer: Explorer, *, cells: int = 18, seed: int = 1) -> None:
    """Raise StrategyError with a line for every check that a strategy fails.

    One instance serves all missions of the check. The ROIs have about `cells` cells; `seed` draws
    them.

    >>> from missions.planning.stepwise import EXPLORERS
    >>> check(EXPLORERS["rdfs"], cells=8)
    """
    failed = failures(explorer, cells=cells, seed=seed)
    if failed:
        lines = "\n".join(f"  {name}: {why}" for name, why in failed.items())
        raise StrategyError(f"{explorer.name} does not pass {len(failed)} checks:\n{lines}")


def failures(explorer: Explorer, *, cells: int = 18, seed: int = 1) -> dict[str, str]:
    """Return the first reason of every failed check, by its name."""
    rois = small_rois(cells, seed)
    found = ((name, _first_failure(each, explorer, rois)) for name, each in CHECKS.items())
    return {name: why for name, why in found if why is not None}


def small_rois(cells: int, seed: int) -> Rois:
    """Return ROIs of several shapes around the start, each of about `cells` cells."""
    rng = np.random.default_rng(seed)
    side = max(2, round(cells**0.5))
    block = {Cell(east, north) for east in range(side) for north in range(side)}
    comb = {Cell(east, 0) for east in range(side)}
    comb |= {Cell(east, north) for east in range(0, side, 2) for north in range(side)}
    return {
        "single cell": frozenset({START}),
        "corridor": frozenset(Cell(east, 0) for east in range(-2, cells // 2)),
        "block": frozenset(block),
        "ring": frozenset(block - {c for c in block if min(c) > 0 and max(c) < side - 1}),
        "comb": frozenset(comb),
        "compact": frozenset(eden(cells, rng)),
        "tree": frozenset(thin(cells, rng)),
    }


_Check = Callable[[Explorer, Rois], Iterator[str]]


def _first_failure(each: _Check, explorer: Explorer, rois: Rois) -> str | None:
    """Return the first fault; a defect of the strategy is a failure as well."""
    try:
        return next(each(explorer, rois), None)
    except StrategyError as error:
        return str(error)
    except Exception as error:  # a strategy may raise any error
        return f"{type(error).__name__}: {error}"


# --- the checks: each yields faults in words -----------------------------------------------------
def _explores(teams: Collection[int] = TEAMS, kinds: Collection[str] = (), **how: object) -> _Check:
    """Return the check that teams explore all ROIs, or those of `kinds`, and come home."""

    def check(explorer: Explorer, rois: Rois) -> Iterator[str]:
        chosen = {kind: roi for kind, roi in rois.items() if not kinds or kind in kinds}
        for robots in teams:
            yield from _runs(explorer, chosen, robots, **how)

    return check


def _not_too_far(start: Cell, end: Cell) -> bool:
    return abs(start.east - end.east) + abs(start.north - end.north) < 4


def _radio(explorer: Explorer, rois: Rois) -> Iterator[str]:
    """Yield faults with news that comes late, in pieces or not at all."""
    for links in (Links(range_cells=2.0, loss=0.3, seed=1), Links(delay=2.0, rate=1.0)):
        yield from _runs(explorer, rois, 3, comms=links)


def _runs(explorer: Explorer, rois: Rois, robots: int, **how: object) -> Iterator[str]:
    for kind, roi in rois.items():
        try:
            result = run(explorer, roi, START, robots, **how)  # type: ignore[arg-type]
        except Exception as error:
            yield f"{kind}, {robots} robots: {type(error).__name__}: {error}"
            return
        yield from (f"{kind}, {robots} robots: {why}" for why in _unfinished(result, roi))


def _unfinished(result: Run, roi: Roi) -> Iterator[str]:
    missing = component(roi, START) - {c for c, v in result.tree.vertices.items() if v.observed}
    if missing:
        yield f"never visited: {sorted(missing)}"
    away = {robot: cell for robot, cell in result.at.items() if cell != START}
    if away:
        yield f"not home in the end: {away}"


def _bound(explorer: Explorer, rois: Rois) -> Iterator[str]:
    for robots in (*TEAMS, 20):
        for kind, roi in rois.items():
            result = run(explorer, roi, START, robots)
            bound = promised_moves(explorer, result.tree, robots, Metric())
            if bound is not None and result.makespan > bound + 1e-9:
                yield f"{kind}, {robots} robots: {result.makespan:g} moves, stated {bound:g}"


def _dropouts(explorer: Explorer, rois: Rois) -> Iterator[str]:
    """Yield faults of five robots, one of which joins late, and two leave for a while.

    One comes back at the very end.
    """
    away = {1: (0, 6), 2: (3, 9), 3: (5, 12), 4: (4, 1_000_000)}

    def team(t: float, tree: Tree) -> list[int]:
        if tree.is_explored(START):  # a robot that was given up returns as well
            return list(range(5))
        return [r for r in range(5) if not (r in away and away[r][0] <= t < away[r][1])]

    yield from _runs(explorer, rois, 5, team=team)


def _repeats(explorer: Explorer, rois: Rois) -> Iterator[str]:
    for kind in ("compact", "tree"):
        once, again = (run(explorer, rois[kind], START, 3) for _ in range(2))
        if once.legs != again.legs:
            yield f"{kind}: a second run of the same mission takes another way"


def _pure(explorer: Explorer, rois: Rois) -> Iterator[str]:
    for kind in ("compact", "ring"):
        watch: Any = _Watch(explorer)  # with all attributes of the strategy
        run(watch, rois[kind], START, 3)
        yield from (f"{kind}: {why}" for why in watch.faults)


def _restart(explorer: Explorer, rois: Rois) -> Iterator[str]:
    """Yield faults after a restart: the journal restores the tree but not the memory."""
    for kind, roi in rois.items():
        for rounds in (3, len(roi) // 2, len(roi)):
            party = _Party.at_start(3, roi)
            party = replace(party.after(explorer, roi, rounds), memory=None)
            yield from _ends(explorer, party, roi, f"{kind}, memory lost after {rounds} rounds")


def _late(explorer: Explorer, rois: Rois) -> Iterator[str]:
    """Yield faults of a cell that becomes ROI late: half way, and when all else is explored."""
    for kind, roi in rois.items():
        for rounds in (len(roi) // 2, None):
            party = _Party.at_start(2, roi).after(explorer, roi, rounds)
            where = max(c for c, v in party.tree.vertices.items() if v.observed)
            late = Cell(where.east + 1, where.north)
            if late in roi:
                continue
            grown = roi | {late, Cell(late.east + 1, late.north)}
            party = replace(party, tree=party.tree.with_observation(where, [late]))
            yield from _ends(explorer, party, grown, f"{kind}, a late cell at {late}")


def _ends(explorer: Explorer, party: _Party, roi: Roi, what: str) -> Iterator[str]:
    end = party.after(explorer, roi, None)
    result = Run(0.0, end.tree, (), end.at)
    yield from (f"{what}: {why}" for why in _unfinished(result, roi))


CHECKS: Mapping[str, _Check] = {
    "explores everything and returns": _explores(),
    "more robots than cells to visit": _explores((20,), ("block", "tree")),
    "the stated bound holds": _bound,
    "a drifting ROI": _explores(metric=Metric(drift_east=0.5, drift_north=-0.2)),
    # legs and observations differ, so that robots decide one at a time; some ways are barred
    "straight flight, one decision at a time": _explores(
        metric=Metric(1.3, 0.3, 0.1, straight=True, look=0.7, passable=_not_too_far)
    ),
    "talk only where robots meet": _explores(TEAMS[1:3], comms=Comms.MEETING),
    "talk over a poor radio": _radio,
    "robots drop out and join": _dropouts,
    "the same mission twice": _repeats,
    "a pure function of the situation": _pure,
    "a restart without the memory": _restart,
    "a cell that is ROI late": _late,
}


# --- the drivers of the checks --------------------------------------------------------------------
@dataclass(frozen=True, slots=True)
class _Party:
    """Robots in step on a resting ROI, whose tree and memory can be changed in between."""

    tree: Tree
    at: Mapping[int, Cell]
    memory: Memory | None = None

    @classmethod
    def at_start(cls, robots: int, roi: Collection[Cell]) -> _Party:
        return cls(observe(Tree.rooted(START), START, roi), dict.fromkeys(range(robots), START))

    def after(self, explorer: Explorer, roi: Collection[Cell], rounds: int | None) -> _Party:
        """Return the party `rounds` later; None: when all is done."""
        limit = int(50 * (len(roi) + 1) * patience_of(explorer)) if rounds is None else rounds
        party = self
        for _ in range(limit):
            asked = tuple(r for r, cell in party.at.items() if not party.done(cell))
            if not asked:
                return party
            party = party.moved(explorer, roi, asked)
        if rounds is None:
            raise StrategyError(f"not done after {limit} rounds; it does not come to an end")
        return party

    def done(self, cell: Cell) -> bool:
        return cell == self.tree.root and self.tree.is_explored(cell)

    def moved(self, explorer: Explorer, roi: Collection[Cell], asked: tuple[int, ...]) -> _Party:
        decision = explorer.decide(Situation(self.tree, self.at, asked, self.memory))
        moves = {r: cell for r, cell in decision.moves.items() if cell is not None}
        tree = self.tree
        for robot, cell in sorted(moves.items()):
            if cell not in self.at[robot].neighbours() or cell not in self.tree:
                raise StrategyError(f"robot {robot} jumps from {self.at[robot]} to {cell}")
            if not tree.is_observed(cell):
                tree = observe(tree, cell, roi)
        return _Party(tree, {**self.at, **moves}, decision.memory)


@dataclass(slots=True)
class _Watch:
    """A strategy that decides twice, the second time from copies, as a resumed mission does."""

    explorer: Explorer
    faults: list[str] = field(default_factory=list)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.explorer, name)

    def decide(self, situation: Situation) -> Decision:
        """Decide; note if a second decision differs."""
        before = copy.deepcopy(situation)
        decision = self.explorer.decide(situation)
        kept = copy.deepcopy(decision)
        if situation.memory != before.memory or situation.at != before.at:
            self.faults.append("it changes its arguments")
        again = self.explorer.decide(before)
        if set(decision.moves) != set(situation.robots):
            self.faults.append(f"asked for {situation.robots}, it moves {sorted(decision.moves)}")
        if again != kept:
            self.faults.append(
                f"two decisions on one situation differ: {kept.moves}, {again.moves}"
            )
        return decision
