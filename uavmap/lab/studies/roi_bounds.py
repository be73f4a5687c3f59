"""Which bound on Algorithm 1 holds: Lemma 1 with a child rule, Lemma 1 as printed, Theorem 1.

Lemma 1 (resting ROI, unit speed): T <= 2 (C - 1 + d floor(log2 R)) / (1 + floor(log2 R)). With d
the depth of the exploration tree it holds for `rdfs`; the listing read literally (`rdfs-paper`)
breaks it. Theorem 1 takes d for a distance in the graph, which no tour can undercut; but the tree
of a grid with cycles may be far deeper than its graph.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from statistics import mean
from typing import Final

from missions.planning.stepwise.rdfs import rdfs_bound_moves
from uavmap.lab.studies.outcomes import PLAIN, Job, eccentricity, explore, roi_of
from uavmap.lab.studies.study_model import COLOURS, MARKERS, Figure, Page, Study, Table, trial_seed

KINDS: Final = ("eden", "ragged", "rectangle", "thin")
ROBOTS: Final = (1, 2, 3, 4, 6, 8, 12, 16, 20, 32)
SIZES: Final = {"rdfs": (30, 120, 500), PLAIN: (30, 120, 500), "rdfs-paper": (30, 120)}
TRIALS: Final = 100
LARGE_KIND, LARGE, LARGE_TRIALS = "eden", 100_000, 5
LARGE_ROBOTS: Final = (8, 20, 32, 64, 128)
QUICK_LARGE: Final = 3_000
_ROUNDING: Final = 1e-9


@dataclass(frozen=True, slots=True)
class Found:
    """A run and its bounds, in moves."""

    job: Job
    makespan: float
    lower: float
    lemma_1: float
    """With the depth of the tree."""
    lemma_1_ecc: float
    """With the distance of the farthest cell in its place."""
    theorem_1: float
    """The ratio of Theorem 1 times what an optimum needs at most."""
    depth: int
    eccentricity: int


def jobs(quick: bool, seed: int) -> list[Job]:
    """Return small ROIs of every kind for both readings, and a few large ones."""
    large = QUICK_LARGE if quick else LARGE
    small = [
        Job(strategy, kind, cells, robots, trial_seed(seed, cells, number))
        for strategy, sizes in SIZES.items()
        for kind in KINDS
        for cells in (sizes[:1] if quick else sizes)
        for robots in (ROBOTS[1::3] if quick else ROBOTS)
        for number in range(4 if quick else TRIALS)
    ]
    return small + [
        Job(strategy, LARGE_KIND, large, robots, trial_seed(seed, large, number))
        for strategy in ("rdfs", PLAIN)
        for robots in LARGE_ROBOTS
        for number in range(1 if quick else LARGE_TRIALS)
    ]


def trial(job: Job) -> Found:
    """Explore a ROI."""
    roi = roi_of(job.kind, job.cells, job.seed)
    done = explore(job.strategy, roi, job.robots)
    farthest = eccentricity(roi)
    edges, halvings = done.cells - 1, math.floor(math.log2(job.robots))
    # a depth-first tour of the shortest-path tree, cut into R pieces, and the ways to and fro
    optimum_at_most = 2 * farthest + 2 * math.ceil(edges / job.robots)
    ratio = 2 * (job.robots + halvings) / (1 + halvings)
    return Found(
        job=job,
        makespan=done.makespan,
        lower=done.lower_bound,
        lemma_1=rdfs_bound_moves(done.cells, done.tree_depth, job.robots),
        lemma_1_ecc=rdfs_bound_moves(done.cells, farthest, job.robots),
        theorem_1=ratio * optimum_at_most + 2 / (1 + halvings),
        depth=done.tree_depth,
        eccentricity=farthest,
    )


def _broken(found: Sequence[Found], bound: str) -> int:
    return sum(f.makespan > getattr(f, bound) * (1 + _ROUNDING) for f in found)


def conclude(found: Sequence[Found]) -> Page:
    """Count the violations."""
    groups = [
        (key, list(group))
        for key, group in groupby(
            found, lambda f: (f.job.strategy, f.job.kind, f.job.cells, f.job.robots)
        )
    ]
    table = Table(
        ("strategy", "ROI", "cells", "robots", "runs", "mean T", "mean lower bound", "mean T / LB",
         "max T / LB", "max T / Lemma 1", "above Lemma 1", "above Lemma 1 with ecc",
         "above Theorem 1", "below lower bound", "mean depth_T", "mean ecc"),
        tuple(
            (
                *key, len(fs), mean(f.makespan for f in fs), mean(f.lower for f in fs),
                mean(f.makespan / f.lower for f in fs), max(f.makespan / f.lower for f in fs),
                max(f.makespan / f.lemma_1 for f in fs), _broken(fs, "lemma_1"),
                _broken(fs, "lemma_1_ecc"), _broken(fs, "theorem_1"),
                sum(f.makespan < f.lower * (1 - _ROUNDING) for f in fs),
                mean(f.depth for f in fs), mean(f.eccentricity for f in fs),
            )
            for key, fs in groups
        ),
    )  # fmt: skip
    largest = max(f.job.cells for f in found)
    large = [f for f in found if f.job.cells == largest]
    ours, plain = ([f for f in large if f.job.strategy == s] for s in ("rdfs", PLAIN))
    rows = [
        (
            strategy, len(fs), _broken(fs, "lemma_1"), _broken(fs, "lemma_1_ecc"),
            _broken(fs, "theorem_1"), sum(f.makespan < f.lower * (1 - _ROUNDING) for f in fs),
        )
        for strategy in SIZES
        for fs in ([f for f in found if f.job.strategy == strategy],)
    ]  # fmt: skip
    counts = Table(
        ("strategy", "runs", "above Lemma 1", "above Lemma 1 with ecc for depth_T",
         "above Theorem 1's ratio", "below the lower bound"),
        tuple(rows),
    )  # fmt: skip
    deep, plain_deep = (mean(f.depth for f in fs) for fs in (ours, plain))
    far = mean(f.eccentricity for f in large)
    text = f"""\
Sung and Tokekar's bounds on Algorithm 1 on resting ROIs, in moves.

{counts.markdown()}

`rdfs-paper` is the listing in the fixed order north, east, south, west. `{PLAIN}` has the child
rule: an unexplored child first, then the one with the fewest robots below. `rdfs` moreover takes
the outermost of equal children and goes home by a shortest way. Theorem 1's ratio counts as broken
only where the makespan exceeds it times a tour that exists: a depth-first tour of the shortest-path
tree cut into R pieces.

On {largest} cells, of which the farthest is on average {far:.0f} away, the tree of `{PLAIN}` is
{plain_deep:.0f} deep. In {len(plain)} runs it exceeds Lemma 1 with depth_T
{_broken(plain, "lemma_1")} times, with that distance {_broken(plain, "lemma_1_ecc")} times, and the
ratio of Theorem 1 {_broken(plain, "theorem_1")} times. The tree of `rdfs` is {deep:.0f} deep there,
and what it exceeds is {_broken(ours, "lemma_1")}, {_broken(ours, "lemma_1_ecc")} and
{_broken(ours, "theorem_1")} times. No proof keeps its tree as shallow as the ROI; so this project
states Lemma 1 with depth_T, and prints depth_T.
"""
    return Page(
        "Which bound on Algorithm 1 holds", text, table, lambda figure: _draw(figure, found, plain)
    )


def _draw(figure: Figure, found: Sequence[Found], large: Sequence[Found]) -> None:
    left, right = figure.subplots(1, 2)
    small = [f for f in found if f.job.cells != large[0].job.cells]
    for i, strategy in enumerate(SIZES):
        robots = sorted({f.job.robots for f in small if f.job.strategy == strategy})
        worst = [
            max(
                f.makespan / f.lemma_1
                for f in small
                if (f.job.strategy, f.job.robots) == (strategy, r)
            )
            for r in robots
        ]
        left.plot(robots, worst, color=COLOURS[i], marker=MARKERS[i], label=strategy)
    left.axhline(1.0, color="k", lw=1)
    left.set(xlabel="robots", ylabel="largest T / bound of Lemma 1")
    left.legend()
    for i, (label, name) in enumerate(
        (
            ("T", "makespan"),
            ("Lemma 1", "lemma_1"),
            ("Lemma 1 with ecc", "lemma_1_ecc"),
            ("Theorem 1 x optimum, at most", "theorem_1"),
            ("lower bound", "lower"),
        )
    ):
        robots = sorted({f.job.robots for f in large})
        y = [mean(getattr(f, name) for f in large if f.job.robots == r) for r in robots]
        right.plot(robots, y, color=COLOURS[i], marker=MARKERS[i], label=label)
    right.set(xscale="log", yscale="log", xlabel="robots", ylabel="moves")
    right.set_title(f"{PLAIN}: {LARGE_KIND}, {large[0].job.cells} cells")
    right.legend(fontsize=8)


STUDY: Final = Study(
    "roi-bounds", "which bounds on Algorithm 1 hold (Sung and Tokekar)", jobs, trial, conclude
)
