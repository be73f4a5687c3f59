"""Trials of localization: robots that do not know where they are, on ROIs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Any, Final

import numpy as np

from missions.lab.arena.roi import Roi
from missions.lab.localization.grid_map import GridMap
from missions.lab.localization.localization_planner import Planner
from missions.lab.localization.localization_run import Localized, localize
from missions.lab.localization.methods import Method
from missions.lab.localization.noisy_run import Errors, localize_with_errors

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


@dataclass(frozen=True, slots=True)
class LocalizationTrial:
    """One method on one ROI, from several starts."""

    roi: str
    method: str
    cells: int
    bound: int | None
    """Moves that it promises to take at most."""
    done: tuple[Localized, ...]

    def figures(self) -> dict[str, Any]:
        """Return the figures for the JSON of `uavmap simulate --localize`."""
        moves = [one.moves for one in self.done]
        return {
            "roi": self.roi,
            "cells": self.cells,
            "trials": len(self.done),
            "moves_mean": round(fmean(moves), 9),
            "moves_max": max(moves),
            "bound": self.bound,
            "bound_held": None if self.bound is None else max(moves) <= self.bound,
            "right": fmean(one.right for one in self.done),
            "wrong": fmean(not one.right and one.answer is not None for one in self.done),
            "gave_up": fmean(one.answer is None for one in self.done),
            "confidence_mean": round(fmean(one.confidence for one in self.done), 9),
        }


def localization_trials(
    rois: Sequence[Roi], methods: Sequence[Method], terms: Terms
) -> Iterator[LocalizationTrial]:
    """Yield every method on every ROI, from the same starts and with the same random numbers."""
    for number, roi in enumerate(rois):
        known = GridMap.of(roi.cells)
        planner = Planner(known) if terms.with_map else None
        for method in methods:
            bound = method.bound
            yield LocalizationTrial(
                roi.name,
                method.name,
                known.size,
                None if bound is None or terms.errors is not None else bound(known.size),
                tuple(
                    _localized(known, planner, method, terms, (terms.seed, number, trial))
                    for trial in range(terms.trials)
                ),
            )


def _localized(
    known: GridMap, planner: Planner | None, method: Method, terms: Terms, seed: tuple[int, ...]
) -> Localized:
    rng = np.random.default_rng(seed)
    start = known.cells[int(rng.integers(known.size))]
    if terms.errors is not None:
        return localize_with_errors(known, start, method, terms.errors, rng)
    return localize(known, start, method, rng, planner)


def localization_means(done: Sequence[LocalizationTrial]) -> dict[str, Any]:
    """Return the means of the figures over ROIs, the most moves, and whether all kept their
    bound."""
    if not done:
        return {}
    rows = [trial.figures() for trial in done]
    held = [row["bound_held"] for row in rows]
    values: dict[str, Any] = {key: round(fmean(row[key] for row in rows), 9) for key in _MEANS}
    values["moves_max"] = max(row["moves_max"] for row in rows)
    values["bound_held"] = None if None in held else all(held)
    return values
