"""Trials of localization: robots that do not know where they are, on ROIs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Final

import numpy as np

from missions.lab.arena.roi import Roi
from missions.lab.localization.grid_map import GridMap
from missions.lab.localization.localization_planner import Planner
from missions.lab.localization.localization_run import Localized, localize
from missions.lab.localization.methods import Method
from missions.lab.localization.noisy_run import Errors, localize_with_errors
from uavmap.lab.trials import Figures, Trial, means_of

_MEANS: Final = ("cells", "moves_mean", "right", "confidence_mean")


@dataclass(frozen=True, slots=True)
class Terms:
    """The terms of localization."""

    with_map: bool
    """Whether they have a map of the ROI, or only its width and height."""
    errors: Errors | None
    """How they err; None if they do not. Who errs has a map."""
    trials: int
    """Starts on each ROI, drawn from its cells."""
    seed: int


def localization_trials(
    rois: Sequence[Roi], methods: Sequence[Method], terms: Terms
) -> Iterator[Trial]:
    """Yield every method on every ROI, from the same starts and with the same random numbers."""
    for number, roi in enumerate(rois):
        known = GridMap.of(roi.cells)
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
    known: GridMap, planner: Planner | None, method: Method, terms: Terms, seed: tuple[int, ...]
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
