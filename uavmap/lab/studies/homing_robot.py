"""The Homing Robot of Wongngamnit and Angluin: its bounds and worst grids.

Further trials show the effect of a map, a planner, and errors of sensor and odometry.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

import numpy as np

from missions.lab.arena.roi import grown
from missions.lab.localization.grid_map import GridMap, chevrons, cluttered, corridor, studded
from missions.lab.localization.localization_planner import Planner
from missions.lab.localization.localization_run import METHODS, Localized, localize
from missions.lab.localization.noisy_run import Errors, Noise, localize_with_errors
from missions.units import Cell
from uavmap.lab.studies.homing_robot_page import (
    BEST,
    COMPARED,
    MANY_GRIDS,
    NOISE,
    OPTIMUM,
    SUMMED,
    WORST,
    MethodResult,
    page,
)
from uavmap.lab.studies.outcomes import grouped
from uavmap.lab.studies.study_model import Page, Study, trial_seed

CHEVRONS: Final = ((4, 5), (10, 20), (20, 40), (40, 80), (60, 120))
STUDS: Final = (3, 10, 50)
CORRIDORS: Final = (3, 4, 10, 40)
GRIDS, GRIDS_A_JOB = 10_000, 250
KINDS: Final = ("eden", "ragged", "rectangle")
CELLS: Final = (120, 500)
ROIS: Final = {120: 100, 500: 20}
STARTS: Final = 50
RUNS: Final = 1000
ERRORS: Final = Errors(Noise(27 / 483, 53 / 483), slip=0.02)
"""The rates that Sung and Tokekar counted in flight, and a slip in fifty moves."""


@dataclass(frozen=True, slots=True)
class Job:
    """A part of the study."""

    part: str
    grid: str
    size: int
    """k of a family of grids, or number of cells; for a batch of grids their number."""
    other: int = 0
    """m of a family of grids."""
    seed: int = 0
    starts: int = 1


def jobs(quick: bool, seed: int) -> list[Job]:
    """Return all jobs, the longest first."""
    rois = {24: 3} if quick else ROIS
    found = [Job(WORST, "chevrons", *km) for km in (CHEVRONS[:1] if quick else CHEVRONS)]
    found += [Job(WORST, "studded", k) for k in STUDS]
    found += [Job(WORST, "corridor", n) for n in CORRIDORS]
    batches = 1 if quick else GRIDS // GRIDS_A_JOB
    for i in range(batches):
        size = 20 if quick else GRIDS_A_JOB
        found.append(Job(MANY_GRIDS, "random", size, seed=trial_seed(seed, 0, i)))
    for kind in KINDS:
        for cells, number in rois.items():
            runs = 5 if quick else max(RUNS // number, 1)
            for i in range(number):
                of = Job("", kind, cells, seed=trial_seed(seed, cells, i), starts=STARTS)
                found += [replace(of, part=COMPARED), replace(of, part=NOISE, starts=runs)]
                if cells <= min(CELLS):
                    found.append(replace(of, part=OPTIMUM))
    return sorted(found, key=lambda job: -job.size * job.starts)


def trial(job: Job) -> list[MethodResult]:
    """Localize robots."""
    parts = {WORST: _worst, MANY_GRIDS: _many_grids, NOISE: _noise, OPTIMUM: _optimum}
    return parts.get(job.part, _methods)(job)


@lru_cache(256)
def _map_of(kind: str, cells: int, seed: int) -> GridMap:
    return GridMap.from_cells(grown(kind, cells, seed).cells)


def _count(
    job: Job, method: str, with_map: bool, known: GridMap, done: Sequence[Localized]
) -> MethodResult:
    bound = METHODS[method].bound
    errs = job.part == NOISE
    return MethodResult(
        job.part, job.grid, known.size, method, with_map, len(done),
        float(sum(one.moves for one in done)),
        max(one.moves for one in done) / known.size,
        0 if errs else sum(
            not one.right or (bound is not None and one.moves > bound(known.size)) for one in done
        ),
        sum(one.right for one in done),
        sum(one.confidence for one in done),
    )  # fmt: skip


def _worst(job: Job) -> list[MethodResult]:
    """Localize on the paper's grids: Figure 6, Lemma 8, Theorem 3."""
    rng = np.random.default_rng(1)
    if job.grid == "studded":
        known = GridMap.from_cells(studded(job.size))
        ratio = known.circumnavigation / known.size
        return [MethodResult(WORST, f"studded {job.size}", known.size, "c / b", False, 1,
                      known.circumnavigation, ratio, 0, 1, 1.0)]  # fmt: skip
    if job.grid == "chevrons":
        cells, start = chevrons(job.size, job.other)
        known = GridMap.from_cells(cells)
        done = [localize(known, start, METHODS["homing"], rng)]
        own = replace(job, grid=f"chevrons {job.size}, {job.other}")
        return [_count(own, "homing", False, known, done)]
    known = GridMap.from_cells(corridor(job.size))
    found = []
    for name, method in METHODS.items():
        for planner in (None, Planner(known)):
            if method.bound is not None and (planner or not method.needs_map):
                done = [localize(known, start, method, rng, planner) for start in known.cells]
                own = replace(job, grid=f"corridor {job.size}")
                longest = max(done, key=lambda one: one.moves)
                found.append(_count(own, name, planner is not None, known, [longest]))
    return found


def _many_grids(job: Job) -> list[MethodResult]:
    """Check the bounds on random grids of all kinds, from a random start each."""
    rng = np.random.default_rng(job.seed)
    found = []
    for i in range(job.size):
        kind = ("cluttered", "eden", "ragged", "thin", "rectangle")[i % 5]
        if kind == "cluttered":
            width, height = (int(side) for side in rng.integers(1, 25, size=2))
            cells: frozenset[Cell] | set[Cell] = cluttered(
                width, height, float(rng.uniform(0.0, 0.45)), rng
            )
        else:
            cells = grown(kind, int(rng.integers(1, 250)), int(rng.integers(2**31))).cells
        known = GridMap.from_cells(cells)
        planner = Planner(known)
        start = known.cells[int(rng.integers(known.size))]
        for name in ("homing", "depth-first", "plan"):
            for of in (None, planner):
                if of or name != "plan":
                    done = [localize(known, start, METHODS[name], rng, of)]
                    found.append(_count(job, name, of is not None, known, done))
    return _merged(found)


def _methods(job: Job) -> list[MethodResult]:
    """Compare all methods from the same starts, without and with a map."""
    known = _map_of(job.grid, job.size, job.seed)
    planner = Planner(known)
    starts = np.random.default_rng(job.seed).integers(known.size, size=job.starts)
    found = []
    for name, method in METHODS.items():
        for of in (None, planner):
            if of is None and (method.needs_map or (name == "random" and job.size > min(CELLS))):
                continue
            done = [
                localize(known, known.cells[start], method, np.random.default_rng(i), of)
                for i, start in enumerate(starts.tolist())
            ]
            found.append(_count(job, name, of is not None, known, done))
    return found


def _optimum(job: Job) -> list[MethodResult]:
    """Find the moves of the best of all plans, over all cells as starts."""
    known = _map_of(job.grid, job.size, job.seed)
    rng = np.random.default_rng(1)
    if job.grid == "rectangle":  # it has thousands of like cells: a full search takes too long
        return []
    best = Planner(known, exact=known.size).expected_moves() * known.size
    alone = sum(len(alike) > 1 for alike in known.alike.values() for _ in alike)
    found = [
        MethodResult(OPTIMUM, job.grid, known.size, name, True, known.size, moves, 0.0, 0,
                     known.size, float(known.size))
        for name, moves in ((BEST, best), ("cells that look like others", alone))
    ]  # fmt: skip
    for name in ("plan", "homing"):
        planner = Planner(known)
        done = [localize(known, start, METHODS[name], rng, planner) for start in known.cells]
        found.append(_count(job, name, True, known, done))
    return found


def _noise(job: Job) -> list[MethodResult]:
    known = _map_of(job.grid, job.size, job.seed)
    found = []
    for name, method in METHODS.items():
        done = []
        for i in range(job.starts):
            rng = np.random.default_rng((job.seed, i))
            start = known.cells[int(rng.integers(known.size))]
            done.append(localize_with_errors(known, start, method, ERRORS, rng))
        found.append(_count(job, name, True, known, done))
    return found


def _merged(found: Sequence[MethodResult]) -> list[MethodResult]:
    """Return the sum over jobs of one kind."""

    def key(one: MethodResult) -> tuple[str, str, int, int, bool, str]:
        cells = 0 if one.part == MANY_GRIDS else one.cells
        method = list(METHODS).index(one.method) if one.method in METHODS else -1
        return one.part, one.grid, cells, method, one.with_map, one.method

    return [
        replace(
            own[0],
            most=max(one.most for one in own),
            **{name: sum(getattr(one, name) for one in own) for name in SUMMED},
        )
        for own in grouped(sorted(found, key=key), key).values()
    ]


def conclude(results: Sequence[Sequence[MethodResult]]) -> Page:
    """Write the page, beside the paper's numbers."""
    return page(_merged([one for some in results for one in some]))


STUDY: Final = Study(
    "homing-robot", "localization on a grid (Wongngamnit and Angluin)", jobs, trial, conclude
)
