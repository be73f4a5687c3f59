"""Figure 3 of Batalin and Sukhatme: the time to cover a square lattice again and again.

LRV is Least Recently Visited. The others are depth-first search, which has a map, 1-LRTA* with ties
broken by chance and in a fixed order, and a random walk. LRV's cover time is the mean over 50
coverages after 300; each vertex breaks ties in an order of its own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import mean
from typing import Final

from uavmap.lab.studies.study_model import COLOURS, MARKERS, Figure, Page, Study, Table, trial_seed

PAPER: Final = dict(
    zip(
        (*range(100, 1001, 100), 1500),
        (3.9406, 3.9587, 3.9639, 3.9661, 3.9672, 3.9678, 3.9682, 3.9684, 3.9685, 3.9685, 3.9682),
        strict=True,
    )
)
"""LRV(V) / V^1.0005 as printed, by the side of the lattice."""
TOLERANCES: Final = {100: 0.002}
TOLERANCE: Final = 0.0005
"""Allowed difference from the paper's, as a share: at m = 100, and beyond."""

LRV, DFS, LRTA, LRTA_FIXED, WALK = "LRV", "DFS", "1-LRTA*", "1-LRTA* fixed order", "random walk"
WARM_UP: Final = {LRV: 300, LRTA: 100}
MEASURED: Final = {LRV: 50, LRTA: 100, LRTA_FIXED: 10, WALK: 10}
LARGEST: Final = {LRV: 1000, LRTA: 500, LRTA_FIXED: 500, WALK: 500}
QUICK: Final = (20, 50, 100)


@dataclass(frozen=True, slots=True)
class Job:
    """A walk on an m x m lattice."""

    walk: str
    m: int
    seed: int


@dataclass(frozen=True, slots=True)
class Cover:
    """The mean cover time of a walk, in steps."""

    walk: str
    m: int
    steps: float


def formula(m: int) -> float:
    """Return 2 |E| / V^1.0005: in the steady state LRV passes all edges, once in each direction.

    >>> round(formula(1500), 4)
    3.9682
    """
    return float(4.0 * (1.0 - 1.0 / m) / m**0.001)


def jobs(quick: bool, seed: int) -> list[Job]:
    """Return every walk on every lattice, the longest first."""
    sizes = QUICK if quick else tuple(PAPER)
    found = [
        Job(walk, m, trial_seed(seed, m, i))
        for i, walk in enumerate(MEASURED)
        for m in sizes
        if m <= LARGEST[walk]
    ]
    return sorted(found, key=lambda job: -job.m)


def trial(job: Job) -> Cover:
    """Walk over one lattice."""
    from missions.lab.kernels import lattice_walks as walks  # noqa: PLC0415, numba takes a second

    near, degree = walks.neighbours(job.m)
    skip = WARM_UP.get(job.walk, 0)
    coverages = skip + MEASURED[job.walk]
    seed = job.seed | 1  # the sequence of random numbers must not start at 0
    if job.walk == LRV:
        near = walks.shuffled(near, degree, seed)
    rule = {LRV: walks.LRV, WALK: walks.RANDOM}.get(job.walk, walks.LRTA)
    steps = walks.cover(rule, near, degree, coverages, 0 if job.walk == LRTA_FIXED else seed)
    return Cover(job.walk, job.m, mean(steps[skip:]))


def conclude(covers: Sequence[Cover]) -> Page:
    """Compare with the paper's sequence and the other walks."""
    found = {(c.walk, c.m): c.steps for c in covers}
    sizes = sorted(
        {*PAPER, *(c.m for c in covers)} if (LRV, 200) in found else {m for _, m in found}
    )

    def per_vertex(walk: str, m: int) -> float | None:
        return found[walk, m] / m**2 if (walk, m) in found else None

    def ours(m: int) -> float | None:
        return found[LRV, m] / m**2.001 if (LRV, m) in found else None

    table = Table(
        ("m", "paper: LRV / V^1.0005", "simulated", "off by, %", "formula", "LRV / V", "DFS / V",
         "1-LRTA* / V", "1-LRTA* fixed / V", "random walk / V", "ln V", "2 V"),
        tuple(
            (
                m, PAPER.get(m), ours(m), _off(ours(m), PAPER.get(m)), formula(m),
                per_vertex(LRV, m), (2 * m**2 - 2) / m**2, per_vertex(LRTA, m),
                per_vertex(LRTA_FIXED, m), per_vertex(WALK, m), math.log(m**2), 2 * m**2,
            )
            for m in sizes
        ),
    )  # fmt: skip
    compared = {m: _off(ours(m), PAPER.get(m)) for m in sizes}
    within = [
        abs(off) <= 100 * TOLERANCES.get(m, TOLERANCE)
        for m, off in compared.items()
        if off is not None
    ]
    text = f"""\
Batalin and Sukhatme, section V: LRV's cover time over V^1.0005 on lattices of m x m vertices.
{sum(within)} of {len(within)} simulated values are within 0.2 % (m = 100) or 0.05 % (beyond) of the
printed ones. In the steady state LRV is a rotor-router, which passes all edges once in each
direction: 2 |E| = 4 m (m - 1) steps. The formula 4 (1 - 1/m) / m^0.001 gives the printed sequence,
with its fall at the end. So the growth that the paper fits by V^1.0005 is that of the share of
inner vertices. The cover time stays below 4 V for every m.

Depth-first search takes 2 V - 2 with a map. With ties broken in a fixed order (the first
{MEASURED[LRTA_FIXED]} coverages), 1-LRTA* beats LRV, as in Figure 3c. With ties broken by
chance, it beats LRV only on small lattices. The random walk lies between V ln V and 2 V^2.
"""

    def draw(figure: Figure) -> None:
        axes = figure.subplots(1, 2)
        known = [m for m in sizes if m in PAPER]
        mine = [c.m for c in covers if c.walk == LRV]
        axes[0].plot(known, [PAPER[m] for m in known], "o", ms=9, mfc="none", color=COLOURS[1],
                     label="paper")  # fmt: skip
        axes[0].plot(sizes, [formula(m) for m in sizes], "-", color=COLOURS[6], label="formula")
        axes[0].plot(mine, [found[LRV, m] / m**2.001 for m in mine], "s", ms=4, color=COLOURS[0],
                     label="simulated")  # fmt: skip
        axes[0].set(xlabel="m", ylabel="LRV / V^1.0005")
        axes[0].legend()
        for i, walk in enumerate(MEASURED):
            own = sorted(c.m for c in covers if c.walk == walk)
            axes[1].plot([m**2 for m in own], [found[walk, m] for m in own], color=COLOURS[i],
                         marker=MARKERS[i], label=walk)  # fmt: skip
        axes[1].plot([m**2 for m in sizes], [2 * m**2 - 2 for m in sizes], "k--", label=DFS)
        axes[1].plot([m**2 for m in sizes], [m**2 * math.log(m**2) for m in sizes], "k:",
                     label="V ln V")  # fmt: skip
        axes[1].set(xscale="log", yscale="log", xlabel="V", ylabel="cover time, steps")
        axes[1].legend(fontsize=8)

    return Page("Least Recently Visited, Figure 3", text, table, draw)


def _off(ours: float | None, paper: float | None) -> float | None:
    return None if ours is None or paper is None else 100.0 * (ours / paper - 1.0)


STUDY: Final = Study(
    "lrv-figure-3", "cover time of LRV on lattices (Batalin and Sukhatme)", jobs, trial, conclude
)
