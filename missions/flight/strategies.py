"""The strategies of flights by name, and the registration of others."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from missions.errors import StrategyError
from missions.flight.state import Strategy
from missions.flight.strategy.every_patch import ALL, WHOLE_BOX
from missions.flight.strategy.leapfrog import PAIR
from missions.flight.strategy.stepwise import Stepwise
from missions.flight.strategy.sweep import FIRST
from missions.mission.schema import Mission
from missions.planning.stepwise import EXPLORERS
from missions.planning.sweep.strategies import ON_PATHS, StrategyInfo

CHOICES: Final[dict[str, Callable[[Mission], Strategy]]] = {
    FIRST.about.name: lambda mission: ALL if mission.search.find == "all" else FIRST,
    WHOLE_BOX.about.name: lambda mission: WHOLE_BOX,
    PAIR.about.name: lambda mission: PAIR,
}
"""Strategies without stops. All others are the explorers of `missions.planning.stepwise`."""


def chosen(mission: Mission) -> Strategy:
    """Return the strategy that a mission names."""
    choose = CHOICES.get(mission.strategy)
    return Stepwise(EXPLORERS[mission.strategy]) if choose is None else choose(mission)


def register(strategy: Strategy) -> None:
    """Register a strategy by the name in its `about`. Raises `StrategyError` if that is taken."""
    about = strategy.about
    if not isinstance(about, StrategyInfo):
        raise StrategyError(f"{about.name}: its texts are no `StrategyInfo`")
    if about.name in EXPLORERS or ON_PATHS.setdefault(about.name, about) is not about:
        raise StrategyError(f"{about.name}: another strategy has this name; choose a new one")
    CHOICES.setdefault(about.name, lambda mission: strategy)
