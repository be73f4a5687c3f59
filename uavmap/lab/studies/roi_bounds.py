"""Bounds on Algorithm 1: Lemma 1 with a child rule, Lemma 1 as printed, Theorem 1.

Lemma 1 (resting ROI, unit speed): T <= 2 (C - 1 + d floor(log2 R)) / (1 + floor(log2 R)). With d
the depth of the exploration tree it holds for `rdfs`; the listing read literally (`rdfs-paper`)
breaks it. Theorem 1 takes d for a distance in the graph, which no tour can undercut. But the tree
of a grid with cycles may be far deeper than its graph.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from statistics import mean
from typing import Final

from missions.planning.stepwise.rdfs import rdfs_bound_moves
from uavmap.lab.studies.outcomes import PLAIN, Explored, Job, explored, grouped
from uavmap.lab.studies.study_model import COLOURS, MARKERS, Figure, Page, Study, Table, trial_seed

KINDS: Final = ("eden", "ragged", "rectangle", "thin")
ROBOTS: Final = (1, 2, 3, 4, 6, 8, 12, 16, 20, 32)
SIZES: Final = {"rdfs": (30, 120, 500), PLAIN: (30, 120, 500), "rdfs-paper": (30, 120)}
TRIALS: Final = 100
LARGE_KIND, LARGE, LARGE_TRIALS = "eden", 100_000, 5
LARGE_ROBOTS: Final = (8, 20, 32, 64, 128)
QUICK_LARGE: Final = 3_000
_ROUNDING: Final = 1e-9


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


def lemma_1(run: Explored) -> float:
    """Return Lemma 1 with the depth of the tree, moves."""
    return rdfs_bound_moves(run.found.cells, run.found.tree_depth, run.job.robots)


def lemma_1_ecc(run: Explored) -> float:
    """Return Lemma 1 with the distance of the farthest cell in place of the depth, moves."""
    return rdfs_bound_moves(run.found.cells, run.eccentricity, run.job.robots)


def theorem_1(run: Explored) -> float:
    """Return the ratio of Theorem 1 times the most that an optimum needs, moves."""
    robots, halvings = run.job.robots, math.floor(math.log2(run.job.robots))
    # a depth-first tour of the shortest-path tree, cut into R pieces, and the ways to and fro
    optimum_at_most = 2 * run.eccentricity + 2 * math.ceil((run.found.cells - 1) / robots)
    return 2 * (robots + halvings) / (1 + halvings) * optimum_at_most + 2 / (1 + halvings)


def _above(runs: Sequence[Explored]) -> tuple[int, ...]:
    """Return the numbers above Lemma 1 with the depth, with the distance, above Theorem 1."""
    return tuple(
        sum(run.found.makespan > bound(run) * (1 + _ROUNDING) for run in runs)
        for bound in (lemma_1, lemma_1_ecc, theorem_1)
    )


def _below(runs: Sequence[Explored]) -> int:
    return sum(r.found.makespan < r.found.lower_bound * (1 - _ROUNDING) for r in runs)


def conclude(found: Sequence[Explored]) -> Page:
    """Count the violations."""
    groups = grouped(found, lambda f: (f.job.strategy, f.job.kind, f.job.cells, f.job.robots))
    table = Table(
        ("strategy", "ROI", "cells", "robots", "runs", "mean T", "mean lower bound", "mean T / LB",
         "max T / LB", "max T / Lemma 1", "above Lemma 1", "above Lemma 1 with ecc",
         "above Theorem 1", "below lower bound", "mean depth_T", "mean ecc"),
        tuple(
            (
                *key, len(fs), mean(f.found.makespan for f in fs),
                mean(f.found.lower_bound for f in fs),
                mean(f.found.makespan / f.found.lower_bound for f in fs),
                max(f.found.makespan / f.found.lower_bound for f in fs),
                max(f.found.makespan / lemma_1(f) for f in fs), *_above(fs), _below(fs),
                mean(f.found.tree_depth for f in fs), mean(f.eccentricity for f in fs),
            )
            for key, fs in groups.items()
        ),
    )  # fmt: skip
    largest = max(f.job.cells for f in found)
    large = [f for f in found if f.job.cells == largest]
    ours, plain = ([f for f in large if f.job.strategy == s] for s in ("rdfs", PLAIN))
    of = {strategy: [f for f in found if f.job.strategy == strategy] for strategy in SIZES}
    counts = Table(
        ("strategy", "runs", "above Lemma 1", "above Lemma 1 with ecc for depth_T",
         "above Theorem 1's ratio", "below the lower bound"),
        tuple((name, len(fs), *_above(fs), _below(fs)) for name, fs in of.items()),
    )  # fmt: skip
    deep, plain_deep = (mean(f.found.tree_depth for f in fs) for fs in (ours, plain))
    above, plain_above = _above(ours), _above(plain)
    far = mean(f.eccentricity for f in large)
    text = f"""\
Sung and Tokekar's bounds on Algorithm 1 on resting ROIs, in moves.

{counts.markdown()}

`rdfs-paper` is the listing in the fixed order north, east, south, west. `{PLAIN}` has the child
rule: an unexplored child first, then the one with the fewest robots below. `rdfs` moreover takes
the outermost of equal children and goes home by a shortest way. Theorem 1's ratio counts as broken
only if the makespan exceeds the ratio times an existing tour. Such a tour is depth-first in the
shortest-path tree, cut into R pieces.

On {largest} cells, of which the farthest is on average {far:.0f} away, the tree of `{PLAIN}` is
{plain_deep:.0f} deep. In {len(plain)} runs it exceeds Lemma 1 with depth_T
{plain_above[0]} times, with that distance {plain_above[1]} times, and the
ratio of Theorem 1 {plain_above[2]} times. The tree of `rdfs` is {deep:.0f} deep there,
and it exceeds these {above[0]}, {above[1]} and
{above[2]} times. No proof keeps its tree as shallow as the ROI. So this project
states Lemma 1 with depth_T, and prints depth_T.
"""
    return Page(
        "Which bound on Algorithm 1 holds", text, table, lambda figure: _draw(figure, found, plain)
    )


def _draw(figure: Figure, found: Sequence[Explored], large: Sequence[Explored]) -> None:
    left, right = figure.subplots(1, 2)
    small = [f for f in found if f.job.cells != large[0].job.cells]
    for i, strategy in enumerate(SIZES):
        worst: dict[int, float] = {}
        for f in small:
            if f.job.strategy == strategy:
                ratio = f.found.makespan / lemma_1(f)
                worst[f.job.robots] = max(worst.get(f.job.robots, 0.0), ratio)
        left.plot(*zip(*sorted(worst.items()), strict=True), color=COLOURS[i], marker=MARKERS[i],
                  label=strategy)  # fmt: skip
    left.axhline(1.0, color="k", lw=1)
    left.set(xlabel="robots", ylabel="largest T / bound of Lemma 1")
    left.legend()
    curves: dict[str, Callable[[Explored], float]] = {
        "T": lambda f: f.found.makespan,
        "Lemma 1": lemma_1,
        "Lemma 1 with ecc": lemma_1_ecc,
        "Theorem 1 x optimum, at most": theorem_1,
        "lower bound": lambda f: f.found.lower_bound,
    }
    robots = sorted({f.job.robots for f in large})
    for i, (label, value) in enumerate(curves.items()):
        y = [mean(value(f) for f in large if f.job.robots == r) for r in robots]
        right.plot(robots, y, color=COLOURS[i], marker=MARKERS[i], label=label)
    right.set(xscale="log", yscale="log", xlabel="robots", ylabel="moves")
    right.set_title(f"{PLAIN}: {LARGE_KIND}, {large[0].job.cells} cells")
    right.legend(fontsize=8)


STUDY: Final = Study(
    "roi-bounds", "which bounds on Algorithm 1 hold (Sung and Tokekar)", jobs, explored, conclude
)
