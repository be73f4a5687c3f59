"""uavmap simulate --localize: where a robot is that does not know, and what finding out takes."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from missions.lab.arena.roi import Roi
from missions.lab.localization.methods import Method
from uavmap.journal.results_folder import make_folder
from uavmap.lab.commands.runs import figures_by_name, run_all
from uavmap.lab.commands.simulate_options import methods_of, terms_of
from uavmap.lab.localization_trials import (
    LocalizationTrial,
    Terms,
    localization_means,
    localization_trials,
)
from uavmap.ui.cli.common import print_figures


def run_localize(
    options: argparse.Namespace, read: Callable[[], Sequence[Roi]], out: Path | None
) -> int:
    """Localize on the ROIs that are read once the options are found to be good; returns the exit
    code."""
    methods, terms = methods_of(options), terms_of(options)
    rois = read()
    if out is not None:
        make_folder(out.parent)  # before anything is computed
    done, code = run_all(localization_trials(rois, methods, terms), len(rois) * len(methods))
    figures = figures_by_name({m.name: _of(m, done) for m in methods}, localization_means)
    if not print_figures(figures, out, as_json=options.json):
        _table(done, methods, terms)
    return code


def _of(method: Method, done: Sequence[LocalizationTrial]) -> list[LocalizationTrial]:
    return [trial for trial in done if trial.method == method.name]


def _table(done: Sequence[LocalizationTrial], methods: Sequence[Method], terms: Terms) -> None:
    """For people: of a ROI, or the means of several."""
    if not done:
        return
    rois = len({trial.roi for trial in done})
    what = done[0].roi if rois == 1 else f"means of {rois} ROIs"
    knowing = "with a map" if terms.with_map else "without a map"
    table = Table(title=f"{what}, {terms.trials} starts each, {knowing}", title_justify="left")
    table.add_column("method", no_wrap=True)
    for title in ("moves", "most", "bound", "held", "right", "certainty"):
        table.add_column(title, justify="right", no_wrap=title == "bound")
    for method in methods:
        mean = localization_means(_of(method, done))
        if mean:
            table.add_row(
                method.name,
                f"{mean['moves_mean']:.2f}",
                str(mean["moves_max"]),
                method.promise if terms.errors is None else "none",
                {True: "yes", False: "NO", None: ""}[mean["bound_held"]],
                f"{mean['right']:.1%}",
                f"{mean['confidence_mean']:.1%}",
            )
    Console().print(table)
    print("moves from cell to cell until the robot knows its cell, most of one start; bound for n")
    print("cells, without errors; right: it was there; certainty: what it thought of that itself")
