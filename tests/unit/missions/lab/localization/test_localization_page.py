"""What docs/localization.md shows works, and its table names every method with its promise."""

from __future__ import annotations

import re
from pathlib import Path

from missions.lab.localization.methods import METHODS

PAGE = (Path(__file__).parents[5] / "docs" / "localization.md").read_text("utf-8")


def test_the_example_of_the_page_runs() -> None:
    (block,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    exec(compile(block, "page", "exec", dont_inherit=True), {"__name__": "page"})


def test_the_table_has_every_method_with_its_promise() -> None:
    rows = re.findall(r"^\| `([a-z-]+)` \| [^|]+ \| ([^|]+) \| [^|]+ \|$", PAGE, re.MULTILINE)
    assert rows == [(m.name, m.promise) for m in METHODS.values()]
