"""Strategies of plug-ins: packages beside uavmap that have an entry point for them."""

from __future__ import annotations

import logging
from functools import lru_cache
from importlib.metadata import entry_points
from typing import Final

from missions.errors import StrategyError

GROUP: Final = "uavmap.strategies"
"""The entry points that plug-ins have: a name, and an object that is a `Strategy`."""
_log = logging.getLogger(__name__)


@lru_cache(maxsize=1)
def load_strategies() -> None:
    """Register the strategies of all plug-ins, once; what is wrong with one is said."""
    for point in entry_points(group=GROUP):
        try:
            strategy = point.load()
        except Exception as error:
            fault = f"it cannot be loaded ({type(error).__name__}: {error})"
        else:
            fault = _registered(strategy)
        if fault:
            _log.warning(
                "strategy %s: the plug-in %s: %s; install it again, or remove it",
                point.name, point.value, fault,
            )  # fmt: skip


def _registered(strategy: object) -> str:
    """Register a strategy; what is wrong with it, empty for nothing."""
    # half a second, which no command needs where there is no plug-in
    from missions.flight.strategies import register  # noqa: PLC0415
    from missions.flight.strategy.interface import Strategy  # noqa: PLC0415

    if not isinstance(strategy, Strategy):
        return "it is no missions.flight.strategy.interface.Strategy"
    try:
        register(strategy)
    except StrategyError as error:
        return str(error)
    return ""
