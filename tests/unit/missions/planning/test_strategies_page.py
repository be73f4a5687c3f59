"""What docs/strategies.md shows works, and its table names every strategy."""

from __future__ import annotations

import re
from pathlib import Path

from missions.planning.stepwise import EXPLORERS
from missions.planning.sweep.strategies import ON_PATHS

PAGE = Path(__file__).parents[4] / "docs" / "strategies.md"


def test_the_examples_of_the_page_run() -> None:
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    assert len(blocks) == 4
    names: dict[str, object] = {"__name__": "page"}
    exec(compile("\n".join(blocks), "page", "exec", dont_inherit=True), names)
    assert {"Nearest", "BACKWARDS"} <= names.keys()


def test_the_table_has_a_row_for_every_strategy_in_their_order() -> None:
    first, *_ = PAGE.read_text("utf-8").split("\n## ")
    rows = re.findall(r"^\| `([a-z-]+)` \|", first, re.MULTILINE)
    assert rows == [*EXPLORERS, *ON_PATHS]
