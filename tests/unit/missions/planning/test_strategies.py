"""Strategies register themselves by name, and the page of the docs shows them all."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from missions.errors import MissionFileError, StrategyError
from missions.flight.setting_of import setting_of
from missions.lab.arena.arena_run import run
from missions.planning.stepwise import EXPLORERS, Decision, Situation, register
from missions.planning.stepwise.rdfs import Rdfs
from missions.planning.sweep.strategies import ON_PATHS
from missions.units import Cell
from tests.support.small_missions import mission, square


class Mine:
    """A strategy in a file of its own."""

    name = "mine"
    guarantee = source = when = "in a test only"

    def bound_moves(self, cells: int, depth: int, robots: int) -> float | None:
        return None

    def decide(self, situation: Situation) -> Decision:
        return Rdfs().decide(situation)


def test_register_a_strategy_makes_it_known_to_missions_and_simulations():
    box, fence = square(0.0, 0.0, 40.0, 40.0), square(-20.0, -20.0, 90.0, 90.0)
    with pytest.raises(MissionFileError, match="mine"):
        mission(box, fence, strategy="mine")
    mine = Mine()
    register(mine)
    try:
        assert setting_of(mission(box, fence, strategy="mine")).strategy.about is mine
        assert run(EXPLORERS["mine"], {Cell(0, 0), Cell(1, 0)}, Cell(0, 0), 1).makespan == 2.0
    finally:
        del EXPLORERS["mine"]


def test_register_a_second_strategy_of_a_name_is_refused():
    class Other(Mine):
        name = "rdfs"

    with pytest.raises(StrategyError, match="rdfs: another strategy has this name"):
        register(Other())
    assert isinstance(EXPLORERS["rdfs"], Rdfs)
    register(Rdfs())  # the same once more


DOCS = Path(__file__).parents[4] / "docs"
PAGE = DOCS / "how-to" / "add-strategy.md"


def test_the_examples_of_the_page_run():
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    assert len(blocks) == 4
    names: dict[str, object] = {"__name__": "page"}
    exec(compile("\n".join(blocks), "page", "exec", dont_inherit=True), names)
    assert {"Nearest", "BACKWARDS"} <= names.keys()


def test_the_table_has_a_row_for_every_strategy_in_their_order():
    page = DOCS / "explanation" / "strategies.md"
    first, *_ = page.read_text("utf-8").split("\n## ")
    rows = re.findall(r"^\| `([a-z-]+)` \|", first, re.MULTILINE)
    assert rows == [*EXPLORERS, *ON_PATHS]
