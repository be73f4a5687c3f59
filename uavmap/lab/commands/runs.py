"""Simulated runs as they are done: how far they are is told, and Ctrl-C ends them."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable
from typing import Final, TypeVar

from uavmap.ui.cli.endings import INTERRUPTED

T = TypeVar("T")
_REPORT_S: Final = 2.0


def run_all(trials: Iterable[T], runs: int) -> tuple[list[T], int]:
    """Those of `runs` trials that are done, and the exit code.

    >>> run_all(iter("abc"), 3)
    (['a', 'b', 'c'], 0)
    """
    done: list[T] = []
    last_s = time.monotonic()
    try:
        for trial in trials:
            done.append(trial)
            if time.monotonic() - last_s > _REPORT_S:
                last_s = time.monotonic()
                print(f"{len(done)} of {runs} runs", file=sys.stderr)
    except KeyboardInterrupt:
        print(f"uavmap: interrupted after {len(done)} of {runs} runs", file=sys.stderr)
        return done, INTERRUPTED
    return done, 0
