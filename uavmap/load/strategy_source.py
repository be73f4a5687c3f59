"""Strategies of plug-ins, and the compilation of planners before a flight."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from functools import lru_cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Final

from missions.errors import StrategyError
from missions.planning.sweep.strategies import NONSTOP
from uavmap.base.extras import install_command

GROUP: Final = "uavmap.strategies"
"""The entry points of plug-ins: a name, and an object that is a `Strategy`."""
_log = logging.getLogger(__name__)


@lru_cache(maxsize=1)
def load_strategies() -> None:
    """Register the strategies of all plug-ins, once; log the fault of each that fails."""
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
    # this import takes half a second: commands without plug-ins do not need it
    from missions.flight.state import Strategy  # noqa: PLC0415
    from missions.flight.strategies import register  # noqa: PLC0415

    if not isinstance(strategy, Strategy):
        return "it is not a missions.flight.state.Strategy"
    try:
        register(strategy)
    except StrategyError as error:
        return str(error)
    return ""


# --- planners -------------------------------------------------------------------------------------
_PLANNERS: Final = ("horizon", *NONSTOP)


def warn_if_uncompiled(strategies: Iterable[str], report: Callable[[str], None]) -> None:
    """Report a planner among the strategies if numba, which compiles it, is not installed."""
    slow = [name for name in strategies if name in _PLANNERS]
    if slow:
        from missions.planning.kernels.jit import COMPILED  # noqa: PLC0415 - numba takes a second

        if not COMPILED:
            remedy = install_command("fast")
            report(f"{slow[0]} plans slowly without numba, which compiles it: {remedy}")


def compile_planner(strategy: str, report: Callable[[str], None]) -> None:
    """Compile the planner of a strategy that does not stop; `report` a first compilation."""
    if strategy not in NONSTOP:
        return
    from missions.planning.kernels import swath as kernels  # noqa: PLC0415 - numba takes a second
    from missions.planning.sweep.memo import warm_up  # noqa: PLC0415, as above

    stats = getattr(kernels.improve, "stats", None)  # None where nothing is compiled
    kept = getattr(stats, "cache_path", None)
    if kept is not None and not any(Path(kept).glob("swath.improve-*.nbi")):
        report("the planner is being compiled, once on this computer; this may take a minute")
    warm_up()
