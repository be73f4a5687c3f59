"""The strategies of flights by name, and how another one is registered."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from missions.flight.strategy.every_patch import ALL
from missions.flight.strategy.interface import Strategy
from missions.flight.strategy.leapfrog import PAIR
from missions.flight.strategy.stepwise import Stepwise
from missions.flight.strategy.survey import WHOLE_BOX
from missions.flight.strategy.sweep import FIRST
from missions.mission.schema import Mission
from missions.planning.stepwise import EXPLORERS

Choice = Callable[[Mission], Strategy]
"""Which strategy a mission is flown by that names it."""

_FLOWN: Final[dict[str, Choice]] = {
    FIRST.about.name: lambda mission: ALL if mission.search.find == "all" else FIRST,
    WHOLE_BOX.about.name: lambda mission: WHOLE_BOX,
    PAIR.about.name: lambda mission: PAIR,
}
"""Those that do not stop. All others are the explorers of `missions.planning.stepwise`."""


def strategy_of(mission: Mission) -> Strategy:
    """Return the strategy that a mission names."""
    choose = _FLOWN.get(mission.strategy)
    return Stepwise(EXPLORERS[mission.strategy]) if choose is None else choose(mission)
