"""The film of a run without stopping, from its paths and verdicts."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from missions.geo.trajectory import Trajectory
from missions.lab.arena.roi import Roi
from uavmap.output.facts.map_model import State
from uavmap.output.film.film import Change, Film, Fix, Place, Unit

if TYPE_CHECKING:  # loads the compiler
    from missions.lab.arena.nonstop import Flown, Verdict

_FIX_S: Final = 0.2


def film_of_nonstop(
    run: Flown, roi: Roi, cell_m: float, footprint_m: tuple[float, float], title: str
) -> Film:
    """Create the film of a recorded run.

    A cell with a majority for ROI so far is under exploration; a decided one is explored or no
    region.
    """
    tracks = {k: tuple(_fixes(paths, run.makespan_s, cell_m)) for k, paths in enumerate(run.paths)}
    east_m, north_m = footprint_m
    return Film(
        title=title,
        unit=Unit.SECONDS,
        end_t=run.makespan_s,
        roi=roi.cells,
        changes=tuple(
            Change(verdict.t_s, verdict.cell, _state(verdict))
            for verdict in run.verdicts
            if verdict.roi or verdict.decided
        ),
        tracks=tracks,
        start=Place(*roi.start),
        footprint=Place(east_m / cell_m, north_m / cell_m),
    )


def _state(verdict: Verdict) -> State:
    if not verdict.decided:
        return "under exploration"
    return "explored" if verdict.roi else "non-roi"


def _fixes(paths: tuple[Trajectory, ...], end_s: float, cell_m: float) -> list[Fix]:
    """Return places so dense that lines between them follow the path."""
    fixes = []
    for path, following in zip(paths, [*paths[1:], None], strict=True):
        until_s = end_s if following is None else following.begin_s
        count = max(1, math.ceil((until_s - path.begin_s) / _FIX_S))
        for i in range(count + (following is None)):
            t_s = path.begin_s + (until_s - path.begin_s) * i / count
            place = path.at(t_s).place
            fixes.append(Fix(t_s, Place(place.east_m / cell_m, place.north_m / cell_m)))
    return fixes
