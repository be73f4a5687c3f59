"""One exploration of a generated ROI, with its certificate."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby
from typing import TypeVar

from missions.lab.arena.arena_run import Certificate, certify, run
from missions.lab.arena.fast import Lattice, run_rdfs
from missions.lab.arena.roi import Roi, grown
from missions.lab.strategies import EXPLORERS
from missions.mapping.tree import distances
from missions.planning.lower_bounds import LowerBounds, drift_lower_bound, flight_lower_bound
from missions.planning.stepwise.interface import Metric, bound_time

T = TypeVar("T")
K = TypeVar("K")

_SHARED_BY_TRIALS = 256
MANY_CELLS = 5000
PLAIN = "rdfs, plain"
"""`rdfs` with the child rule alone, as in `missions.lab.arena.fast.run_rdfs`."""


@dataclass(frozen=True, slots=True)
class Job:
    """A strategy on a generated ROI."""

    strategy: str
    kind: str
    cells: int
    robots: int
    seed: int


def grouped(found: Iterable[T], key: Callable[[T], K]) -> dict[K, list[T]]:
    """Group results that follow each other, by their key."""
    return {name: list(group) for name, group in groupby(found, key)}


@lru_cache(_SHARED_BY_TRIALS)
def roi_of(kind: str, cells: int, seed: int) -> Roi:
    """Grow a ROI, which several trials share."""
    return grown(kind, cells, seed)


@lru_cache(_SHARED_BY_TRIALS)
def bounds_of(roi: Roi) -> LowerBounds:
    """Return its lower bounds on a resting ROI."""
    return LowerBounds.from_roi(roi.cells, roi.start)


@lru_cache(_SHARED_BY_TRIALS)
def eccentricity(roi: Roi) -> int:
    """Return the steps from the start to the farthest cell."""
    return max(distances(roi.cells, roi.start).values())


@lru_cache(_SHARED_BY_TRIALS)
def lattice_of(roi: Roi) -> Lattice:
    """Return its arrays."""
    return Lattice.from_cells(roi.cells)


@dataclass(frozen=True, slots=True)
class Explored:
    """The outcome of a job."""

    job: Job
    found: Certificate
    eccentricity: int
    """Steps from the start to the farthest cell."""


def explored(job: Job) -> Explored:
    """Explore the ROI of a job."""
    roi = roi_of(job.kind, job.cells, job.seed)
    return Explored(job, explore(job.strategy, roi, job.robots), eccentricity(roi))


def explore(strategy: str, roi: Roi, robots: int, metric: Metric | None = None) -> Certificate:
    """Explore a ROI with a strategy, or with `PLAIN`; `rdfs` is compiled."""
    metric = metric if metric is not None else Metric()
    explorer = EXPLORERS["rdfs" if strategy == PLAIN else strategy]
    if explorer.name != "rdfs":
        result = run(explorer, roi.cells, roi.start, robots, metric=metric)
        return certify(result, explorer, robots, metric, bounds_of(roi))
    done = run_rdfs(lattice_of(roi), roi.start, robots, metric, plain=strategy == PLAIN)
    return Certificate(
        makespan=done.makespan,
        lower_bound=_lower_bound(roi, robots, metric),
        bound=bound_time(explorer.bound_moves(done.cells, done.depth, robots), metric),
        tree_depth=done.depth,
        cells=done.cells,
    )


def _lower_bound(roi: Roi, robots: int, metric: Metric) -> float:
    """Return the largest known bound; that for blocks only where it takes no minutes."""
    flight = flight_lower_bound(roi.cells, roi.start, robots, metric)
    if len(roi.cells) > MANY_CELLS:
        return max(flight, drift_lower_bound(2 * eccentricity(roi), metric))
    return max(flight, drift_lower_bound(bounds_of(roi).moves(robots), metric))
