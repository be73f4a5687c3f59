"""Simulated runs: their progress, the files of their results, their figures and tables."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, TypeVar

from rich.console import Console, JustifyMethod
from rich.table import Table

from missions.errors import OutputError
from uavmap.ui.cli.common import overwrite_nothing
from uavmap.ui.cli.endings import INTERRUPTED

T = TypeVar("T")
_REPORT_S: Final = 2.0


def run_all(trials: Iterable[T], runs: int) -> tuple[list[T], int]:
    """Run trials; return those that are done, and the exit code.

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


def free_file(out: str | None, names: Sequence[str]) -> Path | None:
    """Return the first of some files in a folder for results.

    Raises `OutputError` where one of them exists, or `out` is no folder.
    """
    if out is None:
        return None
    if not out or (Path(out).exists() and not Path(out).is_dir()):
        raise OutputError(f"--out {out}: not a folder; choose another")
    overwrite_nothing(Path(out), names)
    return Path(out) / names[0]


def figures_by_name(
    done: Mapping[str, Sequence[Any]],
    means: Callable[[Sequence[Any]], dict[str, Any]],
    more: Mapping[str, Any] = MappingProxyType({}),
) -> dict[str, Any]:
    """Return the figures of the trials of one strategy or method, or of several by name."""
    every = {
        name: {**more, "rois": [trial.figures() for trial in some], "means": means(some)}
        for name, some in done.items()
    }
    return every if len(every) > 1 else next(iter(every.values()))


def print_table(
    title: str,
    columns: Sequence[str],
    rows: Iterable[Sequence[str]],
    *,
    whole: Sequence[str] = (),
    left: int = 1,
) -> None:
    """Print a table; the first `left` columns are left-aligned, those of `whole` never wrapped."""
    table = Table(title=title, title_justify="left")
    for number, name in enumerate(columns):
        justify: JustifyMethod = "left" if number < left else "right"
        table.add_column(name, justify=justify, no_wrap=name in whole)
    for row in rows:
        table.add_row(*row)
    Console().print(table)


def tell(text: str) -> None:
    """Print a line to standard error."""
    print(text, file=sys.stderr)
