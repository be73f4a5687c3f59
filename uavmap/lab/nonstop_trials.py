"""Trials of strategies that do not stop over cells: runs in seconds, with their bounds."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Any

from missions.lab.arena.nonstop import Flown, Team, flown
from missions.lab.arena.offline_reference import reference
from missions.lab.arena.roi import Roi
from missions.lab.arena.survey import surveyed
from missions.lab.arena.time_bounds import lower_bound_s
from missions.planning.sweep.strategies import SURVEY, WithoutStopping


@dataclass(frozen=True, slots=True)
class FlightTerms:
    """The terms of flight without stopping."""

    team: Team
    box_factor: float | None = None
    """Of a survey: how much wider its box is than the region; by default two cells a side."""
    offline: bool = False
    """Whether to look for a reference that knows the region; it takes long."""
    seed: int = 1


@dataclass(frozen=True, slots=True)
class NonstopTrial:
    """One strategy on one ROI; times in seconds."""

    roi: str
    strategy: str
    makespan_s: float
    lower_bound_s: float
    offline_s: float | None
    cells_missed: int
    cells_wrong: int
    plans: int
    wall_s: float
    """Real time of the run."""

    def figures(self) -> dict[str, Any]:
        """Return the figures for the JSON of `uavmap simulate`."""
        values: dict[str, Any] = {
            "makespan_s": round(self.makespan_s, 6),
            "lower_bound_s": round(self.lower_bound_s, 6),
            "ratio": _ratio(self.makespan_s, self.lower_bound_s),
            "cells_missed": self.cells_missed,
            "cells_wrong": self.cells_wrong,
            "plans": self.plans,
            "wall_s": round(self.wall_s, 6),
        }
        if self.offline_s is not None:
            values["offline_s"] = round(self.offline_s, 6)
            values["ratio_offline"] = _ratio(self.makespan_s, self.offline_s)
        return values


def _ratio(value: float, of: float) -> float | None:
    return round(value / of, 6) if of > 0.0 else None


def flown_under(
    roi: Roi, strategy: WithoutStopping, terms: FlightTerms, *, record: bool = False
) -> Flown:
    """Fly in the arena. Raises `StrategyError` for a footprint too small for cells or speed."""
    if strategy is SURVEY:
        return surveyed(
            roi, terms.team, box_factor=terms.box_factor, seed=terms.seed, record=record
        )
    return flown(roi, terms.team, seed=terms.seed, record=record)


def nonstop_trials(
    rois: Sequence[Roi], strategies: Sequence[WithoutStopping], terms: FlightTerms
) -> Iterator[NonstopTrial]:
    """Yield every strategy on every ROI, one ROI after the other; raises as `flown_under`."""
    for roi in rois:
        needed = {near for cell in roi.cells for near in cell.cross()}
        team = terms.team
        bound_s = lower_bound_s(needed, roi.start, team.robots, team.cell_m, team.kinematics)
        offline_s = None
        if terms.offline:
            offline_s = reference(roi, team, seed=terms.seed).makespan_s
        for strategy in strategies:
            begin_s = time.perf_counter()
            done = flown_under(roi, strategy, terms)
            yield NonstopTrial(
                roi.name, strategy.name, done.makespan_s, bound_s, offline_s, done.missed,
                done.wrong, done.decisions, time.perf_counter() - begin_s,
            )  # fmt: skip


def nonstop_means(done: Sequence[NonstopTrial]) -> dict[str, Any]:
    """Return the means of the figures; a ratio is that of the means."""
    if not done:
        return {}
    rows = [trial.figures() for trial in done]
    values: dict[str, float | None] = {
        key: round(fmean(row[key] for row in rows), 6) for key in rows[0] if "ratio" not in key
    }
    for ratio, of in (("ratio", "lower_bound_s"), ("ratio_offline", "offline_s")):
        if of in rows[0]:
            whole = sum(row["makespan_s"] for row in rows), sum(row[of] for row in rows)
            values[ratio] = _ratio(*whole)
    return values
