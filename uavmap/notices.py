"""What is said before work begins that will be slow."""

from __future__ import annotations

from collections.abc import Callable, Iterable


def tell_if_uncompiled(strategies: Iterable[str], say: Callable[[str], None]) -> None:
    """Say so where the planner is among the strategies and numba is not installed."""
    if "horizon" in strategies:
        from missions.kernels.jit import COMPILED  # noqa: PLC0415 - numba takes a second

        if not COMPILED:
            say("horizon plans slowly without numba; pip install 'uavmap[fast]' compiles it")
