"""A study: independent trials, and a page with the conclusions.

The trials are pure functions of their job, which holds the parameters and the seed. They run
anywhere and in any order: the same seed gives the same files, byte for byte.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from PIL import Image

from uavmap.base.atomic_write import write_bytes, write_text

if TYPE_CHECKING:
    from matplotlib import figure

    Figure = figure.Figure
else:  # matplotlib is an extra
    Figure = Any

Value = str | int | float | bool | None

COLOURS: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
"""Colours of Okabe and Ito, distinct for colour-blind eyes."""
PNG_COLOURS: Final = 64
MARKERS: Final = ("o", "s", "^", "D", "v", "P", "X")


@dataclass(frozen=True, slots=True)
class Table:
    """Columns with a name, and rows."""

    columns: tuple[str, ...]
    rows: tuple[tuple[Value, ...], ...]

    def csv(self) -> str:
        """Write CSV, with a line of column names.

        >>> Table(("n", "ratio"), ((3, 2.5875),)).csv()
        'n,ratio\\n3,2.5875\\n'
        """
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.columns)
        writer.writerows([_plain(value) for value in row] for row in self.rows)
        return text.getvalue()

    def markdown(self) -> str:
        """Write Markdown, numbers with five digits.

        >>> print(Table(("n", "ratio"), ((3, 2.587537),)).markdown())
        | n | ratio |
        |---|---|
        | 3 | 2.5875 |
        """
        lines = ["| " + " | ".join(self.columns) + " |", "|" + "---|" * len(self.columns)]
        lines += ["| " + " | ".join(_short(value) for value in row) + " |" for row in self.rows]
        return "\n".join(lines)


def _plain(value: Value) -> str:
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: ""}[value]
    return f"{value:.10g}" if isinstance(value, float) else str(value)


def _short(value: Value) -> str:
    return f"{value:.5g}" if isinstance(value, float) and abs(value) < 1e5 else _plain(value)


@dataclass(frozen=True, slots=True)
class Page:
    """The findings of a study."""

    title: str
    text: str
    """Markdown; the table follows it."""
    table: Table
    draw: Callable[[Figure], None]
    size_in: tuple[float, float] = (9.0, 4.5)

    @staticmethod
    def files(name: str) -> list[str]:
        """Return the names of the files that `write` makes."""
        return [f"{name}.{kind}" for kind in ("csv", "png", "md")]

    def write(self, name: str, folder: Path) -> list[Path]:
        """Write NAME.csv, NAME.png and NAME.md into a folder."""
        from matplotlib import figure  # noqa: PLC0415, an extra

        files = [folder / file for file in self.files(name)]
        write_text(files[0], self.table.csv())
        plot = figure.Figure(figsize=self.size_in, layout="constrained")
        self.draw(plot)
        drawn, small = io.BytesIO(), io.BytesIO()
        plot.savefig(drawn, dpi=110)
        Image.open(drawn).convert("RGB").quantize(PNG_COLOURS).save(small, "png", optimize=True)
        write_bytes(files[1], small.getvalue())
        parts = (
            f"# {self.title}",
            f"<!-- made by: uavmap study {name} -->",
            f"![{self.title}]({name}.png)",
            self.text.strip(),
            f"The table, also as [{name}.csv]({name}.csv):",
            self.table.markdown(),
        )
        write_text(files[2], "\n\n".join(parts) + "\n")
        return files


@dataclass(frozen=True, slots=True)
class Study:
    """A study: its jobs, its trial, and its conclusions."""

    name: str
    about: str
    """Description for the help, in a line."""
    jobs: Callable[[bool, int], Sequence[Any]]
    """Function that returns the jobs; its arguments are True for quick ones, and the seed."""
    trial: Callable[[Any], Any]
    """Function for a job; a function of a module, so that it can be sent to a process."""
    conclude: Callable[[Sequence[Any]], Page]
    """Function that returns the page, from the results in the order of the jobs."""


def trial_seed(seed: int, *numbers: int) -> int:
    """Return a seed of its own for every trial.

    >>> trial_seed(1, 2) != trial_seed(2, 1)
    True
    """
    return int(np.random.SeedSequence((seed, *numbers)).generate_state(1, np.uint32)[0])
