"""The strategies by name: those of the core, and those that are registered.

A user's own strategy is an object that implements `interface.Explorer`. `register` makes it known
by its name to missions, simulations and commands; `missions.lab.strategies` does so when imported.
"""

from __future__ import annotations

from typing import Final

from missions.errors import StrategyError
from missions.planning.stepwise.horizon import Horizon
from missions.planning.stepwise.interface import Decision, Explorer, Memory, Situation
from missions.planning.stepwise.rdfs import Rdfs

EXPLORERS: Final[dict[str, Explorer]] = {}


def register(*explorers: Explorer) -> None:
    """Add strategies to `EXPLORERS`. Raises `StrategyError` if another one has the name."""
    for explorer in explorers:
        if EXPLORERS.setdefault(explorer.name, explorer) != explorer:
            raise StrategyError(
                f"{explorer.name}: another strategy has this name; choose a new one"
            )


register(Rdfs(), Horizon())

__all__ = ["EXPLORERS", "Decision", "Explorer", "Memory", "Situation", "register"]
