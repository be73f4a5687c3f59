"""What is said, and done, before work begins that will be slow."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final

from missions.planning.sweep.strategies import NONSTOP
from uavmap.base.extras import install_command

_PLANNERS: Final = ("horizon", *NONSTOP)


def tell_if_uncompiled(strategies: Iterable[str], say: Callable[[str], None]) -> None:
    """Say so where a planner is among the strategies and numba is not installed."""
    slow = [name for name in strategies if name in _PLANNERS]
    if slow:
        from missions.planning.kernels.jit import COMPILED  # noqa: PLC0415 - numba takes a second

        if not COMPILED:
            remedy = install_command("fast")
            say(f"{slow[0]} plans slowly without numba, which compiles it: {remedy}")


def ready_planner(strategy: str, say: Callable[[str], None]) -> None:
    """Compile the planner of a strategy that does not stop; `say` if that is still to do."""
    if strategy not in NONSTOP:
        return
    from missions.planning.kernels import swath as kernels  # noqa: PLC0415 - numba takes a second
    from missions.planning.sweep.memo import warm_up  # noqa: PLC0415, as above

    stats = getattr(kernels.improve, "stats", None)  # None where nothing is compiled
    kept = getattr(stats, "cache_path", None)
    if kept is not None and not any(Path(kept).glob("swath.improve-*.nbi")):
        say("the planner is compiled, once on this machine; that may take a minute")
    warm_up()
