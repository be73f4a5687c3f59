"""Trials: strategies on ROIs in the arena, each with the figures of its certificate."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Any

from missions.lab.arena.arena_run import Comms, Run, certify, run
from missions.lab.arena.radio import Links
from missions.lab.arena.roi import Roi
from missions.planning.lower_bounds import LowerBounds
from missions.planning.stepwise import Explorer
from missions.planning.stepwise.interface import Metric

Figures = dict[str, Any]
"""The figures of a trial, with the keys of the JSON of `uavmap simulate`."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One strategy, or one method of localization, on one ROI."""

    roi: str
    strategy: str
    figures: Figures


Means = Callable[[Sequence[Figures]], Figures]
"""The means of the figures of one trial or more."""


@dataclass(frozen=True, slots=True)
class Terms:
    """The terms of an exploration."""

    robots: int
    metric: Metric
    comms: Comms | Links = Comms.SHARED


def explored(roi: Roi, explorer: Explorer, terms: Terms) -> Run:
    """Explore in the arena."""
    return run(explorer, roi.cells, roi.start, terms.robots, metric=terms.metric, comms=terms.comms)


def trials(rois: Sequence[Roi], explorers: Sequence[Explorer], terms: Terms) -> Iterator[Trial]:
    """Yield every strategy on every ROI, one ROI after the other.

    `moves` are those of all robots, `wall_s` is the real time of the run, `lower_bound_wall_s` that
    of the ROI's lower bounds, once for all strategies. Raises `StrategyError` for a strategy that
    breaks its protocol.
    """
    for roi in rois:
        begin_s = time.perf_counter()
        static = LowerBounds.from_roi(roi.cells, roi.start)
        static_s = time.perf_counter() - begin_s
        for explorer in explorers:
            begin_s = time.perf_counter()
            done = explored(roi, explorer, terms)
            wall_s = time.perf_counter() - begin_s
            known = certify(done, explorer, terms.robots, terms.metric, static, comms=terms.comms)
            figures = {
                "makespan": round(known.makespan, 9),
                "lower_bound": round(known.lower_bound, 9),
                "bound": None if known.bound is None else round(known.bound, 9),
                "bound_held": known.bound_held,
                "moves": len(done.legs),
                "tree_depth": known.tree_depth,
                "wall_s": round(wall_s, 6),
                "lower_bound_wall_s": round(static_s, 6),
            }
            yield Trial(roi.name, explorer.name, figures)


def means(rows: Sequence[Figures]) -> Figures:
    """Return the means; `ratio` is mean makespan over mean lower bound."""
    values = means_of(rows, rows[0], 9)
    return values | {"ratio": ratio(values["makespan"], values["lower_bound"], 9)}


def means_of(rows: Sequence[Figures], keys: Iterable[str], digits: int) -> Figures:
    """Return rounded means; None if a row has none; for `bound_held` True if all kept it."""
    values: Figures = {}
    for key in keys:
        column = [row[key] for row in rows]
        if None in column:
            values[key] = None
        else:
            values[key] = all(column) if key == "bound_held" else round(fmean(column), digits)
    return values


def ratio(value: float, of: float, digits: int) -> float | None:
    """Return a rounded ratio; None without a value."""
    return round(value / of, digits) if of > 0.0 else None


def by_strategy(done: Sequence[Trial], names: Iterable[str]) -> dict[str, list[Figures]]:
    """Return the figures of the trials of each strategy."""
    return {name: [t.figures for t in done if t.strategy == name] for name in names}


def means_by_name(groups: Mapping[str, Sequence[Figures]], means: Means) -> dict[str, Figures]:
    """Return the means of each group; nothing for one without trials."""
    return {name: means(rows) if rows else {} for name, rows in groups.items()}
