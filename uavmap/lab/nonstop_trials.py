"""Trials of strategies that do not stop over cells: runs in seconds, with their bounds."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from missions.lab.arena.nonstop import FlightResult, Team, fly_team
from missions.lab.arena.roi import Roi
from missions.lab.arena.survey import surveyed
from missions.lab.arena.time_bounds import lower_bound_s, reference
from missions.planning.sweep.strategies import SURVEY, StrategyInfo
from uavmap.lab.trials import Figures, Trial, means_of, ratio


@dataclass(frozen=True, slots=True)
class FlightTerms:
    """The terms of flight without stopping."""

    team: Team
    box_factor: float | None = None
    """Margin of a survey's box around the region; by default two cells a side."""
    offline: bool = False
    """True to search for a reference that knows the region, which takes long."""
    seed: int = 1


def fly_strategy(
    roi: Roi, strategy: StrategyInfo, terms: FlightTerms, *, record: bool = False
) -> FlightResult:
    """Fly in the arena. Raises `StrategyError` for a footprint too small for cells or speed."""
    if strategy is SURVEY:
        return surveyed(
            roi, terms.team, box_factor=terms.box_factor, seed=terms.seed, record=record
        )
    return fly_team(roi, terms.team, seed=terms.seed, record=record)


def nonstop_trials(
    rois: Sequence[Roi], strategies: Sequence[StrategyInfo], terms: FlightTerms
) -> Iterator[Trial]:
    """Yield every strategy on every ROI, one ROI after the other; raises as `fly_strategy`."""
    for roi in rois:
        needed = {near for cell in roi.cells for near in cell.cross()}
        team = terms.team
        bound_s = lower_bound_s(needed, roi.start, team.robots, team.cell_m, team.kinematics)
        offline_s = None
        if terms.offline:
            offline_s = reference(roi, team, seed=terms.seed).makespan_s
        for strategy in strategies:
            begin_s = time.perf_counter()
            done = fly_strategy(roi, strategy, terms)
            figures: Figures = {
                "makespan_s": round(done.makespan_s, 6),
                "lower_bound_s": round(bound_s, 6),
                "ratio": ratio(done.makespan_s, bound_s, 6),
                "cells_missed": done.missed,
                "cells_wrong": done.wrong,
                "plans": done.decisions,
                "wall_s": round(time.perf_counter() - begin_s, 6),
            }
            if offline_s is not None:
                figures["offline_s"] = round(offline_s, 6)
                figures["ratio_offline"] = ratio(done.makespan_s, offline_s, 6)
            yield Trial(roi.name, strategy.name, figures)


def nonstop_means(rows: Sequence[Figures]) -> Figures:
    """Return the means of the figures; a ratio is that of the means."""
    values = means_of(rows, [key for key in rows[0] if "ratio" not in key], 6)
    for key, of in (("ratio", "lower_bound_s"), ("ratio_offline", "offline_s")):
        if of in rows[0]:
            values[key] = ratio(sum(r["makespan_s"] for r in rows), sum(r[of] for r in rows), 6)
    return values
