"""uavmap simulate --localize: moves until a robot knows its cell."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from missions.lab.arena.roi import Roi
from missions.lab.localization.methods import METHODS
from uavmap.journal.results_folder import make_folder
from uavmap.lab.commands.runs import figures_by_name, print_table, run_all
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
    """Localize on ROIs, which are read once the options are valid; return the exit code."""
    methods, terms = methods_of(options), terms_of(options)
    rois = read()
    if out is not None:
        make_folder(out.parent)  # before anything is computed
    done, code = run_all(localization_trials(rois, methods, terms), len(rois) * len(methods))
    groups = {m.name: [trial for trial in done if trial.method == m.name] for m in methods}
    figures = figures_by_name(groups, localization_means)
    if not print_figures(figures, out, as_json=options.json) and done:
        _print_tables(groups, terms)
    return code


def _print_tables(groups: Mapping[str, Sequence[LocalizationTrial]], terms: Terms) -> None:
    names = {trial.roi for trials in groups.values() for trial in trials}
    what = next(iter(names)) if len(names) == 1 else f"means of {len(names)} ROIs"
    knowing = "with a map" if terms.with_map else "without a map"
    means = ((name, localization_means(trials)) for name, trials in groups.items())
    rows = (
        (
            name,
            f"{mean['moves_mean']:.2f}",
            str(mean["moves_max"]),
            METHODS[name].promise if terms.errors is None else "none",
            {True: "yes", False: "NO", None: ""}[mean["bound_held"]],
            f"{mean['right']:.1%}",
            f"{mean['confidence_mean']:.1%}",
        )
        for name, mean in means
        if mean
    )
    print_table(
        f"{what}, {terms.trials} starts each, {knowing}",
        ("method", "moves", "most", "bound", "held", "right", "certainty"),
        rows,
        whole=("method", "bound"),
    )
    print("moves from cell to cell until the robot knows its cell, most of one start; bound for n")
    print("cells, without errors; right: it was there; certainty: what it thought of that itself")
