"""uavmap strategies: list the strategies, with their uses and guarantees."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from functools import partial
from typing import Final

from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from missions.planning.stepwise import EXPLORERS
from missions.planning.stepwise.interface import Explorer
from missions.planning.sweep.strategies import ON_PATHS, StrategyInfo
from uavmap.ui.cli.option_table import add_options

EXAMPLES: Final = """\
  uavmap strategies
  uavmap fly runway --sim --strategy rdfs
  uavmap simulate --generate eden --strategy rdfs,rdfs-paper --robots 4
  uavmap simulate --generate eden --strategy swath,survey --robots 3
"""
NOTES: Final = ""
TABLE_WIDTH: Final = 76
"""Minimum width of the table in characters: in a narrower one, some words do not fit."""
_EVERY: Sequence[Explorer | StrategyInfo] = (*EXPLORERS.values(), *ON_PATHS.values())
DESCRIPTION: Final = "List the strategies for --strategy, with their uses and guarantees."


add_arguments: Final = partial(add_options, command="strategies")


def run(options: argparse.Namespace) -> int:
    """List the strategies."""
    if options.json:
        listed = [
            {"name": e.name, "guarantee": e.guarantee, "source": e.source, "when": e.when}
            for e in _EVERY
        ]
        print(json.dumps(listed, indent=2))
        return 0
    console = Console()
    if console.width < TABLE_WIDTH:
        _list(console)
        return 0
    table = Table(show_lines=True)
    for title in ("strategy", "use it when", "guarantee", "source"):
        table.add_column(title, no_wrap=title == "strategy")
    for explorer in _EVERY:
        table.add_row(explorer.name, explorer.when, explorer.guarantee, explorer.source)
    console.print(table)
    return 0


def _list(console: Console) -> None:
    """List the strategies one below the other, if a table would cut words."""
    for explorer in _EVERY:
        console.print(Text(explorer.name, style="bold"))
        for title, text in (
            ("use it when", explorer.when),
            ("guarantee", explorer.guarantee),
            ("source", explorer.source),
        ):
            console.print(Padding(Text(f"{title}: {text}"), (0, 0, 0, 2)))
        console.print()
