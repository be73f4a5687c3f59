"""uavmap simulate --localize: moves until a robot knows its cell."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Any, Final

import numpy as np

from missions.errors import LocalizationError
from missions.lab.arena.roi import Roi
from missions.lab.localization.grid_map import GridMap
from missions.lab.localization.localization_planner import Planner
from missions.lab.localization.localization_run import METHODS, Localized, Method, localize
from missions.lab.localization.noisy_run import EXACT, Errors, Noise, localize_with_errors
from uavmap.lab.commands.runs import (
    NONSTOP_DEFAULTS,
    Column,
    Outcome,
    print_means,
    run_trials,
    value_options,
)
from uavmap.lab.trials import Figures, Trial, means_of
from uavmap.ui.cli.common import number_type, pair

_MEANS: Final = ("cells", "moves_mean", "right", "confidence_mean")


@dataclass(frozen=True, slots=True)
class Terms:
    """The terms of localization."""

    with_map: bool
    """True if they have a map of the ROI, else only its width and height."""
    errors: Errors | None
    """Their errors, with a map; None without errors."""
    trials: int
    """Starts on each ROI, drawn from its cells."""
    seed: int


def localization_trials(
    rois: Sequence[Roi], methods: Sequence[Method], terms: Terms
) -> Iterator[Trial]:
    """Yield every method on every ROI, from the same starts and with the same random numbers."""
    for number, roi in enumerate(rois):
        known = GridMap.from_cells(roi.cells)
        planner = Planner(known) if terms.with_map else None
        for method in methods:
            done = [
                _localized(known, planner, method, terms, (terms.seed, number, trial))
                for trial in range(terms.trials)
            ]
            bound = None
            if method.bound is not None and terms.errors is None:
                bound = method.bound(known.size)
            yield Trial(roi.name, method.name, _figures(roi, done, bound))


def _figures(roi: Roi, done: Sequence[Localized], bound: int | None) -> Figures:
    moves = [one.moves for one in done]
    return {
        "roi": roi.name,
        "cells": len(roi.cells),
        "trials": len(done),
        "moves_mean": round(fmean(moves), 9),
        "moves_max": max(moves),
        "bound": bound,
        "bound_held": None if bound is None else max(moves) <= bound,
        "right": fmean(one.right for one in done),
        "wrong": fmean(not one.right and one.answer is not None for one in done),
        "gave_up": fmean(one.answer is None for one in done),
        "confidence_mean": round(fmean(one.confidence for one in done), 9),
    }


def _localized(
    known: GridMap,
    planner: Planner | None,
    method: Method,
    terms: Terms,
    seed: tuple[int, ...],
) -> Localized:
    rng = np.random.default_rng(seed)
    start = known.cells[int(rng.integers(known.size))]
    if terms.errors is not None:
        return localize_with_errors(known, start, method, terms.errors, rng)
    return localize(known, start, method, rng, planner)


def localization_means(rows: Sequence[Figures]) -> Figures:
    """Return the means of the figures over ROIs, and the most moves."""
    most = {"moves_max": max(row["moves_max"] for row in rows)}
    return means_of(rows, _MEANS, 9) | most | means_of(rows, ("bound_held",), 9)


TRIALS: Final = 100
CONFIDENCE: Final = 0.95
LOCALIZE_OPTIONS: Final = ("map", "noise", "slip", "confidence", "trials")
_REFUSED: Final = {
    "strategy": "a robot that localizes explores nothing",
    "speed": "localization counts moves",
    "drift": "localization is simulated on resting regions only",
    "comms": "a robot localizes alone",
    "animate": "there is no picture of a localization",
    "tree": "a localization has no tree",
    **dict.fromkeys(NONSTOP_DEFAULTS, "a robot that localizes moves from cell to cell"),
}


def add_localize_options(parser: argparse.ArgumentParser) -> None:
    """Add --localize and its options."""
    group = parser.add_argument_group(
        "--localize",
        "a robot that senses the eight neighbours of its cell finds out its cell in the ROI, in "
        "moves from cell to cell",
    )
    add = value_options(group)
    methods = f"one or, with commas or given again, several of {', '.join(METHODS)}"
    add("--localize", "METHOD", methods, action="append")
    with_map = "the robot has a map (default), or knows the width and height only"
    group.add_argument("--map", action=argparse.BooleanOptionalAction, default=None, help=with_map)
    add("--noise", "FP,FN", "rates of outside cells that look inside, and the reverse")
    add("--slip", "P", "rate of moves that stay, or go elsewhere", number_type(float, 0.0, 0.9))
    sure = f"with --noise or --slip: the certainty to reach (default {CONFIDENCE})"
    add("--confidence", "P", sure, number_type(float, 0.5, 0.9999))
    trials = number_type(int, 1, 1_000_000)
    add("--trials", "N", f"starts on each ROI (default {TRIALS})", trials)


def run_localize(
    options: argparse.Namespace, read: Callable[[], Sequence[Roi]], out: Path | None
) -> int:
    """Localize on ROIs, which are read once the options are valid; return the exit code."""
    methods, terms = _methods(options), _terms(options)
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
    title = f"{outcome.title}, {terms.trials} starts each, {knowing}"
    print_means(title, _COLUMNS, means, ("method", "bound"))
    print("moves from cell to cell until the robot knows its cell, most of one start; bound for n")
    print("cells, without errors; right: it was there; certainty: its own estimate")


def _methods(options: argparse.Namespace) -> list[Method]:
    """Return the chosen methods.

    Raises `LocalizationError` for an unknown one, or one that needs the map that --no-map denies.
    """
    names = [name for part in options.localize for name in part.split(",")]
    for name in names:
        if name not in METHODS:
            raise LocalizationError(
                f"--localize {name!r} is not known; choose one of {', '.join(METHODS)}"
            )
        if METHODS[name].needs_map and options.map is False:
            raise LocalizationError(f"--no-map: {name} needs a map; leave out one of the two")
    return [METHODS[name] for name in dict.fromkeys(names)]


def _terms(options: argparse.Namespace) -> Terms:
    """Return the chosen terms. Raises `LocalizationError` for options that exclude each other."""
    _refuse_others(options)
    seed = 1 if options.seed is None else options.seed
    trials = TRIALS if options.trials is None else options.trials
    errors = _errors(options)
    if errors is not None and options.map is False:
        raise LocalizationError(
            "--no-map: a robot with errors needs a map; leave out --noise and --slip, or --no-map"
        )
    return Terms(options.map is not False, errors, trials, seed)


def _refuse_others(options: argparse.Namespace) -> None:
    for name, why in _REFUSED.items():
        if getattr(options, name) is not None:
            raise LocalizationError(f"--{name.replace('_', '-')} with --localize: {why}")
    if options.robots not in (None, 1):
        raise LocalizationError(
            f"--robots {options.robots} with --localize: a robot localizes alone; leave it out"
        )
    if options.index:
        raise LocalizationError("--index with --localize: there is no picture of a localization")
    if options.generate is not None and options.cell_m is not None:
        raise LocalizationError("--cell-m with --localize is for GeoJSON: moves have no length")


def _errors(options: argparse.Namespace) -> Errors | None:
    if options.noise is None and options.slip is None:
        if options.confidence is not None:
            raise LocalizationError(
                "--confidence is for --noise or --slip: without errors a robot is certain"
            )
        return None
    noise = EXACT
    if options.noise is not None:
        what = f"--noise {options.noise}"
        rates: tuple[Any, Any] = pair(what, options.noise, "FP,FN, such as 0.05,0.1")
        try:
            noise = Noise(*rates)
        except LocalizationError as error:
            raise LocalizationError(f"{what}: {error}") from None
    return Errors(noise, options.slip or 0.0, options.confidence or CONFIDENCE)
