"""The conformance check finds what is wrong with a strategy, and says it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import pytest

from missions.errors import StrategyError
from missions.lab.arena.conformance import check, failures
from missions.mapping.breadth_first import step_home
from missions.planning.stepwise import EXPLORERS, Decision, Situation
from missions.units import Cell

Mend = Callable[[Situation, Decision], Decision]


@dataclass
class Wrong:
    """A depth-first search that does one thing wrong."""

    mend: Mend
    stated: float | None = None
    name: str = "wrong"
    guarantee: str = "none"
    source: str = "this test"
    when: str = "never"
    calls: list[int] = field(default_factory=list)

    def bound_moves(self, cells: int, depth: int, robots: int) -> float | None:
        return self.stated

    def decide(self, situation: Situation) -> Decision:
        self.calls.append(1)
        return self.mend(situation, EXPLORERS["rdfs"].decide(situation))


def right(situation: Situation, decision: Decision) -> Decision:
    return decision


def waits(situation: Situation, decision: Decision) -> Decision:
    return Decision(dict.fromkeys(situation.robots))


def jumps(situation: Situation, decision: Decision) -> Decision:
    return Decision({r: Cell(cell.east + 1, cell.north + 1) for r, cell in situation.at.items()})


def goes_home_early(situation: Situation, decision: Decision) -> Decision:
    if len(situation.tree) < 6:
        return decision
    return Decision({r: step_home(situation.tree, situation.at[r]) for r in situation.robots})


def forgets_a_robot(situation: Situation, decision: Decision) -> Decision:
    return Decision({r: m for r, m in decision.moves.items() if r != 2 or len(situation.at) < 3})


def changes_its_memory(situation: Situation, decision: Decision) -> Decision:
    memory = situation.memory if isinstance(situation.memory, list) else []
    memory.append(len(situation.tree))
    return replace(decision, memory=memory)


def hangs_on_its_memory(situation: Situation, decision: Decision) -> Decision:
    if situation.memory is None and any(cell != Cell(0, 0) for cell in situation.at.values()):
        raise KeyError("memory")
    return replace(decision, memory="kept")


def fails_at(size: int) -> Mend:
    def divide(situation: Situation, decision: Decision) -> Decision:
        return replace(decision, memory=1 // (len(situation.at) - size))

    return divide


def found(strategy: Wrong) -> dict[str, str]:
    return failures(strategy, cells=9)


def test_a_right_one_passes() -> None:
    assert found(Wrong(right)) == {}


@pytest.mark.parametrize(
    ("mend", "check_name", "said"),
    [
        (waits, "explores everything and returns", "everybody waits"),
        (jumps, "explores everything and returns", "moves from"),
        (forgets_a_robot, "a pure function of the situation", "it moves"),
        (changes_its_memory, "a pure function of the situation", "changes what it is given"),
        (fails_at(20), "more robots than cells to visit", "block, 20 robots: ZeroDivisionError"),
    ],
)
def test_check_names_what_a_wrong_strategy_does(mend: Mend, check_name: str, said: str) -> None:
    assert said in found(Wrong(mend))[check_name]


def test_who_leaves_cells_out_is_found() -> None:
    failed = found(Wrong(goes_home_early))
    assert {"explores everything and returns", "robots drop out and join"} <= set(failed)


def test_who_keeps_something_between_calls_is_found() -> None:
    strategy = Wrong(right)

    def drifts(situation: Situation, decision: Decision) -> Decision:
        home = step_home(situation.tree, situation.at[situation.robots[0]])
        if len(strategy.calls) % 3 == 0 and home is not None:
            return Decision({**decision.moves, situation.robots[0]: home})
        return decision

    strategy.mend = drifts
    assert "asked twice" in found(strategy)["a pure function of the situation"]


def test_who_cannot_do_without_its_memory_is_found() -> None:
    failed = found(Wrong(hangs_on_its_memory))
    assert "KeyError" in failed["a restart without the memory"]
    assert "explores everything and returns" not in failed


def test_a_bound_that_does_not_hold_is_found() -> None:
    failed = found(Wrong(right, stated=3.0))
    assert list(failed) == ["the stated bound holds"]
    assert "stated 3" in failed["the stated bound holds"]


def test_all_failures_are_told_at_once() -> None:
    with pytest.raises(StrategyError, match=r"wrong does not pass \d+ checks:\n  explores"):
        check(Wrong(waits), cells=9)
