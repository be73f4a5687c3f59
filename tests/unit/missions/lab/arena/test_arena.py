"""The arena with scripted strategies: time, looks, decisions, radio, and forbidden acts."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import pytest

from missions.errors import StrategyError
from missions.lab.arena.arena_run import Comms, Leg, patience_of, run
from missions.lab.arena.radio import observe
from missions.lab.arena.roi import component, grown
from missions.mapping.tree import Tree
from missions.planning.stepwise import EXPLORERS, Decision, Situation
from missions.planning.stepwise.interface import Metric
from missions.units import Cell

START = Cell(0, 0)
ROW = [Cell(e, 0) for e in range(4)]
Rule = Callable[[Situation], Mapping[int, Cell | None]]


@dataclass(frozen=True)
class Scripted:
    """A strategy that follows a function, and keeps its questions."""

    rule: Rule
    asked: list[Situation] = field(default_factory=list)
    name: str = "scripted"
    guarantee: str = ""
    source: str = ""
    when: str = ""

    def bound_moves(self, cells: int, depth: int, robots: int) -> float | None:
        return None

    def decide(self, situation: Situation) -> Decision:
        self.asked.append(situation)
        return Decision(self.rule(situation), (situation.memory or 0) + 1)  # type: ignore[operator]


def out_and_back(situation: Situation) -> dict[int, Cell | None]:
    """Move along the row to its end, and home."""
    tree = situation.tree
    moves: dict[int, Cell | None] = {}
    for robot in situation.robots:
        here = situation.at[robot]
        ahead = Cell(here.east + 1, 0)
        if ahead in tree and not tree.is_explored(tree.root):
            moves[robot] = ahead
        else:
            moves[robot] = None if here == START else Cell(here.east - 1, 0)
    return moves


def ahead_or_home(situation: Situation) -> dict[int, Cell | None]:
    """Move along the row, and home at once from its end."""
    ahead = Cell(situation.at[0].east + 1, 0)
    return {0: ahead if ahead in situation.tree else START}


# --- time and looks --------------------------------------------------------------------------
def test_one_robot_along_a_row_learns_and_remembers():
    explorer = Scripted(out_and_back)
    done = run(explorer, ROW, START, 1)
    assert [leg.end.east for leg in done.legs] == [1, 2, 3, 2, 1, 0]
    assert done.at == {0: START}
    assert set(done.tree.vertices) == set(ROW)
    assert [len(situation.tree) for situation in explorer.asked][:4] == [2, 3, 4, 4]
    assert all(s.tree.is_observed(s.at[0]) for s in explorer.asked)
    assert [situation.memory for situation in explorer.asked] == [None, *range(1, 6)]


@pytest.mark.parametrize(
    ("metric", "legs"),
    [
        (Metric(), [1.0] * 6),
        (Metric(look=10.0), [11.0] * 3 + [1.0] * 3),  # at the first visit only
        (Metric(1.0, drift_east=0.5), [2.0] * 3 + [2 / 3] * 3),
    ],
    ids=["steps", "looks", "drift"],
)
def test_move_takes_the_time_of_its_metric(metric, legs):
    done = run(Scripted(out_and_back), ROW, START, 1, metric=metric)
    assert [leg.end_t - leg.start_t for leg in done.legs] == pytest.approx(legs)
    assert done.makespan == pytest.approx(sum(legs))


def test_move_to_any_known_cell_is_allowed_in_straight_flight_alone():
    done = run(Scripted(ahead_or_home), ROW, START, 1, metric=Metric(straight=True))
    assert [leg.end.east for leg in done.legs] == [1, 2, 3, 0]
    assert done.makespan == 6.0
    with pytest.raises(StrategyError, match="jumps from"):
        run(Scripted(ahead_or_home), ROW, START, 1)


def test_cells_known_beforehand_need_not_be_found():
    tree = Tree.rooted(START)
    for cell in ROW:
        tree = observe(tree, cell, ROW)
    assert run(Scripted(out_and_back), ROW, START, 1, tree=tree).legs == ()


# --- teams -----------------------------------------------------------------------------------
def test_robots_that_arrive_at_the_same_instant_decide_together():
    explorer = Scripted(out_and_back)
    run(explorer, ROW, START, 3)
    assert {situation.robots for situation in explorer.asked} == {(0, 1, 2)}


def test_robot_on_the_way_is_shown_where_it_will_be():
    """Robot 1 stays at home until robot 0 is two cells away."""

    def late(situation: Situation) -> dict[int, Cell | None]:
        moves = out_and_back(situation)
        if 1 in moves and situation.at[0].east < 2 and not situation.tree.is_explored(START):
            moves[1] = None
        return moves

    explorer = Scripted(late)
    done = run(explorer, ROW, START, 2)
    first = next(leg for leg in done.legs if leg.robot == 1)
    assert first.start_t == 2.0
    assert set(done.at.values()) == {START}


PLUS = {START, *START.neighbours(), Cell(0, 2), Cell(2, 0)}


def fan_out(after: Cell | None, until: int) -> Rule:
    """Move two robots north and east, then to a place, until a number of cells is known."""

    def rule(situation: Situation) -> Mapping[int, Cell | None]:
        goals = {0: Cell(0, 1), 1: Cell(1, 0)}
        if len(situation.tree) >= until:
            return EXPLORERS["rdfs"].decide(situation).moves
        return {r: goals[r] if situation.at[r] == START else after for r in situation.robots}

    return rule


def test_team_that_shares_knows_the_cells_that_one_sees():
    explorer = Scripted(fan_out(None, len(PLUS)))
    run(explorer, PLUS, START, 2)
    assert len(explorer.asked[1].tree) == len(PLUS)


def test_robots_that_meet_only_know_nothing_of_the_others_meanwhile():
    explorer = Scripted(fan_out(START, 7))
    run(explorer, PLUS, START, 2, comms=Comms.MEETING)
    alone = [s for s in explorer.asked if len(s.robots) == 1][:2]
    assert [len(s.tree) for s in alone] == [6, 6]  # each its own arm of the cross
    together = next(s for s in explorer.asked if s.robots == (0, 1) and len(s.tree) > 5)
    assert len(together.tree) == len(PLUS)


def test_robot_that_takes_no_part_stays_where_it_is_and_continues_later():
    def half_day(t: float, tree: Tree) -> list[int]:
        return [] if 1.5 <= t < 5.0 else [0]

    done = run(Scripted(out_and_back), ROW, START, 1, team=half_day)
    assert [leg.start_t for leg in done.legs] == [0.0, 1.0, 5.0, 6.0, 7.0, 8.0]
    assert set(done.tree.vertices) == set(ROW)


def test_failed_robot_is_not_shown_to_the_explorer():
    explorer = Scripted(out_and_back)
    run(explorer, ROW, START, 2, team=lambda t, tree: [0] if t < 3.0 else [0, 1])
    assert set(explorer.asked[0].at) == {0}
    assert set(explorer.asked[-1].at) == {0, 1}


# --- what is not allowed ---------------------------------------------------------------------
@pytest.mark.parametrize(
    ("rule", "message"),
    [
        (lambda s: {0: Cell(0, 1)}, "robot 0 moves from"),  # not known
        (lambda s: {0: START}, "robot 0 moves from"),  # to itself
        (lambda s: {0: None}, "all robots wait at t = 0"),
        (lambda s: {}, "all robots wait"),
        (lambda s: {0: Cell(2, 0) if Cell(2, 0) in s.tree else Cell(1, 0)}, "moves from"),
        (lambda s: {0: ROW[1] if s.at[0] == START else START}, "does not come to an end"),
    ],
    ids=["unknown", "itself", "waits", "silent", "stays", "to and fro"],
)
def test_a_strategy_that_breaks_the_rules_is_stopped(rule, message):
    with pytest.raises(StrategyError, match=message) as caught:
        run(Scripted(rule), ROW, START, 1)
    assert str(caught.value).startswith("scripted: ")


def test_a_limit_ends_a_run_that_would_have_ended_later():
    with pytest.raises(StrategyError, match="not done after 3"):
        run(Scripted(out_and_back), ROW, START, 1, limit=3.0)
    assert run(Scripted(out_and_back), ROW, START, 1, limit=6.0).makespan == 6.0


def test_strategies_without_a_map_are_given_more_time():
    assert patience_of(EXPLORERS["rdfs"]) == 1.0
    assert patience_of(EXPLORERS["random-walk"]) > patience_of(EXPLORERS["lrv"]) > 1.0


# --- every leg of a real run -----------------------------------------------------------------
@pytest.mark.parametrize("name", ["rdfs", "greedy", "hungarian", "bfdn"])
@pytest.mark.parametrize("comms", list(Comms))
def test_legs_join_up_and_no_robot_flies_two_at_once(name, comms):
    roi = grown("ragged", 40, 3)
    done = run(EXPLORERS[name], roi.cells, roi.start, 4, comms=comms)
    by_robot: dict[int, list[Leg]] = {}
    for leg in done.legs:
        by_robot.setdefault(leg.robot, []).append(leg)
    for robot, legs in by_robot.items():
        at, t = roi.start, 0.0
        for leg in legs:
            assert leg.start == at
            assert leg.start_t >= t - 1e-9
            assert leg.end in leg.start.neighbours()
            assert leg.end in roi.cells
            at, t = leg.end, leg.end_t
        assert at == done.at[robot] == roi.start
    assert done.makespan == max(leg.end_t for leg in done.legs)
    assert set(done.tree.vertices) == component(roi.cells, roi.start)
    assert done.tree.is_explored(roi.start)


@pytest.mark.parametrize(
    ("name", "kind", "cells", "robots", "moves", "digest"),
    [
        ("horizon", "eden", 120, 1, 142, "c2aa6f753568f028"),
        ("horizon", "eden", 120, 8, 256, "d147c209fa2397f0"),
        ("horizon", "ragged", 120, 3, 352, "a5f006d6e8e6fa2f"),
        ("horizon", "thin", 80, 4, 258, "5d1264660a387811"),
        ("horizon", "rectangle", 150, 2, 152, "9e63855d4dacef6e"),
        ("horizon", "eden", 300, 3, 358, "3e99fba0d5033aac"),
        ("horizon", "eden", 600, 2, 698, "45daf06a56c4dc52"),
        ("greedy", "eden", 120, 1, 164, "48f6732924433311"),
        ("greedy", "eden", 120, 8, 372, "41a83a2aca850f1d"),
        ("greedy", "ragged", 120, 3, 404, "1b617239c681925d"),
        ("greedy", "thin", 80, 4, 244, "85760a614feb47b8"),
        ("greedy", "rectangle", 150, 2, 164, "ff2a23bd80a14324"),
        ("greedy", "eden", 300, 3, 502, "f7c8790e1cbc2249"),
    ],
)
def test_every_move_is_the_one_that_was_recorded(name, kind, cells, robots, moves, digest):
    """Costs here are whole and half numbers, so all machines round them alike.

    After a deliberate change of a strategy record anew, and note it in the changelog."""
    roi = grown(kind, cells, 5)
    legs = run(EXPLORERS[name], roi.cells, roi.start, robots).legs
    assert len(legs) == moves
    text = ";".join(f"{m.robot} {m.start_t:g} {m.end.east} {m.end.north}" for m in legs)
    assert hashlib.sha256(text.encode()).hexdigest()[:16] == digest
