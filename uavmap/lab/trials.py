"""Trials: strategies on ROIs in the arena, each with its certificate."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Any

from missions.lab.arena.arena_run import Comms, Run, run
from missions.lab.arena.certificate import Certificate, certify
from missions.lab.arena.radio import Links
from missions.lab.arena.roi import Roi
from missions.planning.bounds.lower_bounds import LowerBounds
from missions.planning.stepwise import Explorer
from missions.planning.stepwise.metric import Metric


@dataclass(frozen=True, slots=True)
class Terms:
    """The terms of an exploration."""

    robots: int
    metric: Metric
    comms: Comms | Links = Comms.SHARED


@dataclass(frozen=True, slots=True)
class Trial:
    """One strategy on one ROI; `moves` are those of all robots."""

    roi: str
    strategy: str
    certificate: Certificate
    moves: int
    wall_s: float
    """Real time of the run."""
    lower_bound_wall_s: float
    """Real time that the lower bounds of the ROI took, once for all strategies."""

    def figures(self) -> dict[str, Any]:
        """Return the figures for the JSON of `uavmap simulate`."""
        known = self.certificate
        return {
            "makespan": round(known.makespan, 9),
            "lower_bound": round(known.lower_bound, 9),
            "bound": None if known.bound is None else round(known.bound, 9),
            "bound_held": known.bound_held,
            "moves": self.moves,
            "tree_depth": known.tree_depth,
            "wall_s": round(self.wall_s, 6),
            "lower_bound_wall_s": round(self.lower_bound_wall_s, 6),
        }


def explored(roi: Roi, explorer: Explorer, terms: Terms) -> Run:
    """Explore in the arena."""
    return run(explorer, roi.cells, roi.start, terms.robots, metric=terms.metric, comms=terms.comms)


def trials(rois: Sequence[Roi], explorers: Sequence[Explorer], terms: Terms) -> Iterator[Trial]:
    """Yield every strategy on every ROI, one ROI after the other.

    Raises `StrategyError` for a strategy that breaks its protocol.
    """
    for roi in rois:
        begin_s = time.perf_counter()
        static = LowerBounds.of(roi.cells, roi.start)
        static_s = time.perf_counter() - begin_s
        for explorer in explorers:
            begin_s = time.perf_counter()
            done = explored(roi, explorer, terms)
            wall_s = time.perf_counter() - begin_s
            certificate = certify(
                done, explorer, terms.robots, terms.metric, static, comms=terms.comms
            )
            yield Trial(roi.name, explorer.name, certificate, len(done.legs), wall_s, static_s)


def means(done: Sequence[Trial]) -> dict[str, Any]:
    """Return the means of the figures; `ratio` is mean makespan over mean lower bound, and
    `bound_held` whether all trials kept their bound."""
    if not done:
        return {}
    rows = [trial.figures() for trial in done]
    values: dict[str, Any] = {}
    for key in rows[0]:
        column = [row[key] for row in rows]
        if None in column:
            values[key] = None
        else:
            values[key] = all(column) if key == "bound_held" else round(fmean(column), 9)
    lower = values["lower_bound"]
    values["ratio"] = round(values["makespan"] / lower, 9) if lower else None
    return values
