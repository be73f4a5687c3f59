"""The page of the study of the Homing Robot: tables, a plot and the conclusions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from uavmap.lab.studies.study_model import COLOURS, MARKERS, Figure, Page, Table, Value

WORST, MANY_GRIDS, COMPARED, OPTIMUM, NOISE = "worst", "bounds", "methods", "optimum", "errors"
BEST: Final = "best of all plans"
PRINTED: Final = {"homing": "at most 4", "depth-first": "at most 2 - 2 / n"}


@dataclass(frozen=True, slots=True)
class MethodResult:
    """The moves of one method in a job."""

    part: str
    grid: str
    cells: int
    method: str
    with_map: bool
    runs: int
    moves: float
    """Sum of the moves of all runs."""
    most: float
    """Moves for each cell in the longest run."""
    broken: int
    """Runs above the method's bound, or with a wrong answer without errors."""
    right: int
    confidence: float
    """Sum of the certainties of all runs."""


SUMMED: Final = ("runs", "moves", "broken", "right", "confidence")
"""The sums over jobs."""


def page(rows: Sequence[MethodResult]) -> Page:
    """Return the page of the study."""
    table = Table(
        ("part", "grid", "cells", "method", "map", "runs", "mean moves", "most moves / n",
         "paper, moves / n", "bound broken", "right", "stated certainty"),
        tuple(
            (
                row.part, row.grid, None if row.part == MANY_GRIDS else row.cells, row.method,
                row.with_map, row.runs, row.moves / row.runs,
                None if row.part == OPTIMUM else row.most, _printed(row),
                None if row.part == NOISE else row.broken,
                row.right / row.runs, row.confidence / row.runs,
            )
            for row in rows
        ),
    )  # fmt: skip
    return Page("The Homing Robot", _text(rows), table, lambda f: _draw(f, rows), (11.0, 4.5))


def _printed(row: MethodResult) -> Value:
    if row.part == WORST and row.grid.startswith("chevrons"):
        return "towards 3"
    if row.part == WORST and row.grid.startswith("studded"):
        return "towards 8/3"
    if row.part == WORST:
        return f"at least {(row.cells - 3) / row.cells:.5g}"
    return PRINTED.get(row.method) if row.part != OPTIMUM else None


def _text(rows: Sequence[MethodResult]) -> str:
    grids = [row for row in rows if row.part == MANY_GRIDS]
    runs, broken = sum(row.runs for row in grids), sum(row.broken for row in grids)
    wrong = sum(row.broken for row in rows if row.part in (WORST, COMPARED))
    corridors = [row for row in rows if row.part == WORST and row.grid.startswith("corridor")]
    above = max(_mean(rows, g, "plan") / _mean(rows, g, BEST) - 1.0 for g in _grids(rows))
    short = sum(row.most * row.cells < row.cells - 3 - 1e-9 for row in corridors)
    return f"""\
Source: Wongngamnit and Angluin, *The Robot, the Grid, and the Algorithm* (1999). A robot senses the
eight neighbours of its cell and finds its cell, with the given width and height of the grid.
Moves from cell to cell are counted, over the n cells of the grid.

**Bounds.** {max((row.runs for row in grids), default=0)} random grids (rooms with obstacles, and
grown regions) have one start each. There are **{broken} violations** in {runs} runs of the
Homing Robot (4 n), the Depth-first Robot (2 n - 2) and the planner (4 n); {wrong} in the other
parts.

**The paper's grids.** On the chevrons of Figure 6 the Homing Robot tends towards 3 n moves; on
those of Lemma 8 circumnavigations over boundary cells tend towards 8/3. In a corridor of n cells
each method needs n - 3 moves from its worst start (Theorem 3), also with a map: {short} of
{len(corridors)} needed fewer.

{_ratios(rows).markdown()}

**Methods.** Mean moves from random starts of grown regions, without a map / with one. With a map
the robot ends when one cell alone fits its readings, which is soon.

{_methods(rows).markdown()}

**How good a plan can be.** On regions of up to 120 cells the best of all plans can be found by
branch and bound. Cells that look like others need one move at least. The best of all plans takes
{_best_of_homing(rows)} of the moves of the Homing Robot with the same map.
The planner needs at most {above:.1%} more moves than the best plan.

{_optimum(rows).markdown()}

**With errors**: 27 of 483 obstructed cells look unobstructed, 53 of 483 the reverse (counted in
flight by Sung and Tokekar). One move of fifty stays or goes elsewhere. The robot has a map and ends
at 95 % certainty. Methods get the neighbours of the most probable cell.

{_errors(rows).markdown()}
"""


def _ratios(rows: Sequence[MethodResult]) -> Table:
    shown = [row for row in rows if row.part == WORST and not row.grid.startswith("corridor")]
    return Table(
        ("grid", "n", "moves, or c", "/ n", "paper"),
        tuple(
            (row.grid, row.cells, int(row.moves), round(row.most, 4), _printed(row))
            for row in sorted(shown, key=lambda row: (row.grid.split()[0], row.cells))
        ),
    )


def _by_region(rows: Sequence[MethodResult], shown: Callable[[str, int, str], Value]) -> Table:
    """Return a table with a row for each set of regions and a column for each method."""
    names = list(dict.fromkeys(row.method for row in rows))
    sets = dict.fromkeys((row.grid, row.cells) for row in rows)
    return Table(
        ("regions", "cells", *names),
        tuple((grid, cells, *(shown(grid, cells, name) for name in names)) for grid, cells in sets),
    )


def _methods(rows: Sequence[MethodResult]) -> Table:
    shown = [row for row in rows if row.part == COMPARED]
    mean = {(r.grid, r.cells, r.method, r.with_map): r.moves / r.runs for r in shown}

    def both(grid: str, cells: int, name: str) -> str:
        values = (mean.get((grid, cells, name, with_map)) for with_map in (False, True))
        return " / ".join("-" if value is None else f"{value:.2f}" for value in values)

    return _by_region(shown, both)


def _mean(rows: Sequence[MethodResult], grid: str, method: str) -> float:
    return next(
        row.moves / row.runs
        for row in rows
        if (row.part, row.grid, row.method) == (OPTIMUM, grid, method)
    )


def _grids(rows: Sequence[MethodResult]) -> list[str]:
    return list(dict.fromkeys(row.grid for row in rows if row.part == OPTIMUM))


def _best_of_homing(rows: Sequence[MethodResult]) -> str:
    return ", ".join(
        f"{_mean(rows, grid, BEST) / _mean(rows, grid, 'homing'):.2f} ({grid})"
        for grid in _grids(rows)
    )


def _optimum(rows: Sequence[MethodResult]) -> Table:
    shown = [row for row in rows if row.part == OPTIMUM]
    mean = {(row.grid, row.cells, row.method): row.moves / row.runs for row in shown}
    return _by_region(shown, lambda *key: round(mean[key], 3))


def _errors(rows: Sequence[MethodResult]) -> Table:
    return Table(
        ("regions", "cells", "method", "runs", "mean moves", "right", "stated certainty"),
        tuple(
            (
                row.grid, row.cells, row.method, row.runs, round(row.moves / row.runs, 2),
                f"{row.right / row.runs:.1%}", f"{row.confidence / row.runs:.1%}",
            )
            for row in rows
            if row.part == NOISE
        ),
    )  # fmt: skip


def _draw(figure: Figure, rows: Sequence[MethodResult]) -> None:
    worst, compared = figure.subplots(1, 2)
    for i, (family, limit, label) in enumerate(
        (("chevrons", 3.0, "Homing Robot, Figure 6"), ("studded", 8 / 3, "c / b, Lemma 8"))
    ):
        points = sorted((r.cells, r.most) for r in rows if r.grid.startswith(f"{family} "))
        worst.plot(*zip(*points, strict=True), color=COLOURS[i], marker=MARKERS[i], label=label)
        worst.axhline(limit, color=COLOURS[i], ls="--", lw=1)
    worst.axhline(4.0, color="k", lw=1, label="bound")
    worst.set(xscale="log", xlabel="n", ylabel="/ n", ylim=(0, 4.2))
    worst.legend(fontsize=8)
    sets = list(dict.fromkeys((r.grid, r.cells) for r in rows if r.part == COMPARED))
    names = list(dict.fromkeys(r.method for r in rows if r.part == COMPARED))
    for i, name in enumerate(names):
        for with_map, style in ((False, "none"), (True, "full")):
            found = {
                (r.grid, r.cells): r.moves / r.runs
                for r in rows
                if (r.part, r.method, r.with_map) == (COMPARED, name, with_map)
            }
            places = [k for k, which in enumerate(sets) if which in found]
            compared.plot(
                places, [found[sets[k]] for k in places], ls="", color=COLOURS[i], ms=7,
                marker=MARKERS[i], fillstyle=style, label=name if with_map else None,
            )  # fmt: skip
    compared.set(yscale="log", ylabel="mean moves; filled: with a map")
    compared.set_xticks(range(len(sets)), [f"{kind}\n{cells}" for kind, cells in sets])
    compared.legend(fontsize=8)
