"""The films of simulated runs: from moves and the tree, or from paths and verdicts."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import TYPE_CHECKING, Final

from missions.geo.trajectory import Trajectory
from missions.lab.arena.arena_run import Run
from missions.lab.arena.roi import Roi
from missions.mapping.tree import Tree
from missions.units import Cell
from uavmap.output.facts.map_model import State
from uavmap.output.film.film import Change, Film, Fix, Place, Unit

if TYPE_CHECKING:  # loads the compiler
    from missions.lab.arena.nonstop import FlightResult, Verdict

_FIX_S: Final = 0.2
_GOLDEN_RAD: Final = math.pi * (3.0 - math.sqrt(5.0))
_SPREAD: Final = 0.36
"""Maximum distance of robots at one vertex, which are shown beside each other, in cells."""


def film_of_run(run: Run, roi: Collection[Cell], title: str) -> Film:
    """Create the film of a run on a ROI.

    The states are those that all robots know together. An observed vertex without a move to it was
    known beforehand.

    >>> from missions.lab.arena.arena_run import run
    >>> from missions.planning.stepwise import EXPLORERS
    >>> line = {Cell(0, 0), Cell(1, 0)}
    >>> film = film_of_run(run(EXPLORERS["rdfs"], line, Cell(0, 0), 1), line, "a line")
    >>> [(change.t, change.state) for change in film.changes if change.cell == Cell(0, 0)]
    [(0.0, 'under exploration'), (1.0, 'explored')]
    """
    tracks = {robot: [Fix(0.0, _beside(run.tree.root, robot, len(run.at)))] for robot in run.at}
    for leg in run.legs:
        track = tracks[leg.robot]
        track.append(Fix(leg.start_t, track[-1].place))
        track.append(Fix(leg.end_t, _beside(leg.end, leg.robot, len(run.at))))
    return Film(
        title=title,
        unit=Unit.STEPS,
        end_t=run.makespan,
        roi=frozenset(roi),
        changes=tuple(_changes(run)),
        tracks={robot: tuple(track) for robot, track in tracks.items()},
        start=Place(*run.tree.root),
        radius=0.3 if len(run.at) == 1 else max(0.3 / math.sqrt(len(run.at)), 0.1),
    )


def _beside(cell: Cell, robot: int, robots: int) -> Place:
    """Return a robot's own spot at a vertex, as the seeds of a sunflower: none hides another."""
    if robots == 1:
        return Place(*cell)
    away = _SPREAD * math.sqrt((robot + 0.5) / robots)
    angle_rad = robot * _GOLDEN_RAD
    return Place(cell.east + away * math.cos(angle_rad), cell.north + away * math.sin(angle_rad))


def _changes(run: Run) -> list[Change]:
    tree = run.tree
    looked_t = {tree.root: 0.0}
    for leg in sorted(run.legs, key=lambda leg: leg.end_t):
        looked_t.setdefault(leg.end, leg.end_t)
    for cell, vertex in tree.vertices.items():
        if vertex.observed:
            looked_t.setdefault(cell, 0.0)
    explored_t = _explored_t(tree, looked_t)
    changes = []
    for cell, vertex in tree.vertices.items():
        seen_t = [looked_t[n] for n in cell.neighbours() if n in looked_t]
        known_t = 0.0 if vertex.parent is None else min(seen_t)
        if known_t < looked_t.get(cell, math.inf):
            changes.append(Change(known_t, cell, "unexplored", vertex.parent))
        if cell in looked_t and looked_t[cell] < explored_t[cell]:
            changes.append(Change(looked_t[cell], cell, "under exploration", vertex.parent))
        if explored_t[cell] < math.inf:
            changes.append(Change(explored_t[cell], cell, "explored", vertex.parent))
    return sorted(changes, key=lambda change: change.t)


def _explored_t(tree: Tree, looked_t: dict[Cell, float]) -> dict[Cell, float]:
    """Return the times at which all below each vertex was observed; infinity if never."""
    explored_t: dict[Cell, float] = {}
    for cell in sorted(tree.vertices, key=lambda cell: -tree.vertices[cell].depth):
        below = [explored_t[child] for child in tree.children(cell)]
        explored_t[cell] = max([looked_t.get(cell, math.inf), *below])
    return explored_t


# --- without stopping ----------------------------------------------------------------------------
def film_of_nonstop(
    run: FlightResult, roi: Roi, cell_m: float, footprint_m: tuple[float, float], title: str
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
            Change(verdict.t_s, verdict.cell, _verdict_state(verdict))
            for verdict in run.verdicts
            if verdict.roi or verdict.decided
        ),
        tracks=tracks,
        start=Place(*roi.start),
        footprint=Place(east_m / cell_m, north_m / cell_m),
    )


def _verdict_state(verdict: Verdict) -> State:
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
