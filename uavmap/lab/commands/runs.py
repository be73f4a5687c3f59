"""Simulated runs: their progress, the files of their results, their figures and tables."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, NamedTuple, TypeVar

from rich.console import Console, JustifyMethod
from rich.table import Table

from missions.errors import OutputError, UavmapError
from uavmap.journal.results_folder import make_folder
from uavmap.lab.trials import Figures, Means, Trial, by_strategy, means_by_name
from uavmap.ui.cli import INTERRUPTED
from uavmap.ui.cli.common import print_figures, refuse_existing

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

    Raises `OutputError` if one of them exists, or `out` is no folder.
    """
    if out is None:
        return None
    if not out or (Path(out).exists() and not Path(out).is_dir()):
        raise OutputError(f"--out {out}: not a folder; choose another")
    refuse_existing(Path(out), names)
    return Path(out) / names[0]


class Outcome(NamedTuple):
    """The outcome of trials."""

    done: list[Trial]
    means: dict[str, Figures]
    """Means of the figures, by strategy or method."""
    code: int
    """The exit code."""
    printed: bool
    """True if the figures are printed already, as JSON."""

    @property
    def title(self) -> str:
        """The ROI, or the number of ROIs; empty without trials."""
        runs = len(self.done) // len(self.means)
        return "" if not self.done else self.done[0].roi if runs == 1 else f"means of {runs} ROIs"


def run_trials(
    trials: Iterator[Trial],
    rois: int,
    names: Sequence[str],
    means: Means,
    out: Path | None,
    *,
    as_json: bool,
    more: Mapping[str, Any] = MappingProxyType({}),
) -> Outcome:
    """Run trials of strategies or methods on a number of ROIs; write and print their figures.

    `more` adds a text to each strategy.
    """
    if out is not None:
        make_folder(out.parent)  # before anything is computed
    done, code = run_all(trials, rois * len(names))
    groups = by_strategy(done, names)
    mean = means_by_name(groups, means)
    every = {n: {**more, "rois": rows, "means": mean[n]} for n, rows in groups.items()}
    figures = every if len(every) > 1 else next(iter(every.values()))
    return Outcome(done, mean, code, print_figures(figures, out, as_json=as_json))


class Column(NamedTuple):
    """A figure in a table of means."""

    key: str
    form: str = ""
    absent: str = ""
    """Text instead of None."""

    def text(self, figures: Figures) -> str:
        """Return its text."""
        value = figures[self.key]
        if value is None:
            return self.absent
        return (
            {True: "yes", False: "NO"}[value] if isinstance(value, bool) else f"{value:{self.form}}"
        )


def print_means(
    title: str, columns: Mapping[str, Column], means: Mapping[str, Figures], whole: Sequence[str]
) -> None:
    """Print a row of means by heading, for each strategy that has any; the first is its name."""
    rows = (
        (name, *(column.text(mean) for column in columns.values()))
        for name, mean in means.items()
        if mean
    )
    print_table(title, (whole[0], *columns), rows, whole=whole)


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


def print_line(text: str) -> None:
    """Print a line to standard error."""
    print(text, file=sys.stderr)


# --- options ------------------------------------------------------------------------------------
NONSTOP_DEFAULTS: Final[dict[str, Any]] = {
    "footprint": "15",
    "accel": 2.5,
    "frame_s": 0.2,
    "error_rate": 0.0,
    "loss_rate": 0.0,
    "box_factor": None,
    "offline": False,
}
"""Default of each option. The parser has none, to distinguish the given ones."""

Add = Callable[..., None]


def value_options(parser: argparse.ArgumentParser | argparse._ArgumentGroup) -> Add:
    """Return a function that adds an option with a value: flag, metavar, help, conversion."""

    def add(flag: str, metavar: str | None, text: str, kind: Any = None, **more: Any) -> None:
        parser.add_argument(flag, metavar=metavar, help=text, type=kind, **more)

    return add


def refuse(
    options: argparse.Namespace, names: Iterable[str], error: type[UavmapError], why: str
) -> None:
    """Raise an error for the first of some options that is given."""
    for name in names:
        if getattr(options, name) is not None:
            raise error(f"--{name.replace('_', '-')} {why}")
