"""uavmap simulate --localize: moves until a robot knows its cell."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from missions.lab.arena.roi import Roi
from missions.lab.localization.methods import METHODS
from uavmap.lab.commands.runs import Column, Outcome, print_means, run_trials
from uavmap.lab.commands.simulate_options import methods_of, terms_of
from uavmap.lab.localization_trials import Terms, localization_means, localization_trials


def run_localize(
    options: argparse.Namespace, read: Callable[[], Sequence[Roi]], out: Path | None
) -> int:
    """Localize on ROIs, which are read once the options are valid; return the exit code."""
    methods, terms = methods_of(options), terms_of(options)
    rois = read()
    outcome = run_trials(
        localization_trials(rois, methods, terms), len(rois), [m.name for m in methods],
        localization_means, out, as_json=options.json,
    )  # fmt: skip
    if outcome.done and not outcome.printed:
        _print_tables(outcome, terms)
    return outcome.code


_COLUMNS: Final = {
    "moves": Column("moves_mean", ".2f"),
    "most": Column("moves_max"),
    "bound": Column("promise"),
    "held": Column("bound_held"),
    "right": Column("right", ".1%"),
    "certainty": Column("confidence_mean", ".1%"),
}


def _print_tables(outcome: Outcome, terms: Terms) -> None:
    knowing = "with a map" if terms.with_map else "without a map"
    means = {
        name: mean
        and {**mean, "promise": METHODS[name].promise if terms.errors is None else "none"}
        for name, mean in outcome.means.items()
    }
    title = f"{outcome.of}, {terms.trials} starts each, {knowing}"
    print_means(title, _COLUMNS, means, ("method", "bound"))
    print("moves from cell to cell until the robot knows its cell, most of one start; bound for n")
    print("cells, without errors; right: it was there; certainty: what it thought of that itself")
