"""Table 1 of Tovey and Koenig: a graph on which Greedy Mapping walks to and fro.

The graph has a stem v_0 ... v_{n^n}. For i = 1..n there are n^(n-i) branches of length L_i = (n^i -
n) / (n - 1). They are at the stem's every n^i-th vertex, from v_0 on for even i and from v_{n^i} on
for odd i. A branch is two parallel paths of L_i edges that meet at a junction, which bears a leaf;
for L_i = 0 it is a bare leaf. One more leaf hangs on v_0. The robot starts at v_{n^n}.

Of several nearest vertices it takes one of a branch, then one of the stem, then the leaf of the
lowest level. So it comes home from every branch by the other path and leaves the leaf behind. It
has to sweep the stem once for each level.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from uavmap.lab.studies.study_model import COLOURS, Figure, Page, Study, Table

PAPER: Final = {
    3: (207, 80),
    4: (2279, 778),
    5: (31253, 9612),
    6: (515085, 144014),
    7: (9928271, 2542528),
    8: (219130987, 51744018),
    9: (5448100629, 1193201300),
    10: (150617283953, 30753086422),
}
"""Travel and vertices as printed."""
SIMULATED: Final = 8
"""Largest n whose graph is walked; the rest is by formula."""
QUICK: Final = 5

_BRANCH, _STEM, _EXTRA = 0, 1, 2
"""Ranks of vertices, lowest first; the leaf of level i has 2 + i."""


def branch_length(n: int, level: int) -> int:
    """Return L_i: edges of each of the two paths of a branch."""
    return int((n**level - n) // (n - 1))


def vertices(n: int) -> int:
    """Return |V| by formula.

    >>> vertices(3)
    80
    """
    paths = sum(2 * n ** (n - i) * branch_length(n, i) for i in range(2, n + 1))
    return int(n**n + 2 + n ** (n - 1) + paths)


def travel(n: int) -> int:
    """Return the travel to the last leaf by formula: sweeps, rounds of branches, and leaves.

    >>> travel(3)
    207
    """
    lengths = {i: branch_length(n, i) for i in range(1, n + 1)}
    round_trips = sum(2 * n ** (n - i) * length for i, length in lengths.items())
    leaves = sum(2 * n ** (n - i) * (lengths[i] + 1) for i in range(1, n))
    return int((n + 1) * n**n + 2 + round_trips + leaves + lengths[n] + 1)


def graph(n: int) -> tuple[NDArray[np.int32], NDArray[np.int8]]:
    """Return the edges, shape (E, 2), and the rank of every vertex; v_0 ... v_{n^n} come first.

    >>> [len(part) for part in graph(3)]
    [83, 80]
    """
    stem = np.arange(n**n + 1, dtype=np.int32)
    edges = [np.stack([stem[:-1], stem[1:]], axis=1), np.array([[0, n**n + 1]], np.int32)]
    ranks = [np.full(n**n + 1, _STEM, np.int8), np.array([_EXTRA], np.int8)]
    free = n**n + 2
    for level in range(1, n + 1):
        count, length = n ** (n - level), branch_length(n, level)
        foot = (np.arange(count, dtype=np.int32)[:, None] + level % 2) * n**level
        size = max(2 * length, 1)
        own = np.arange(free, free + count * size, dtype=np.int32).reshape(count, size)
        leaf, junction = own[:, -1:], own[:, length - 1 : length] if length else foot
        ways = [np.hstack([junction, leaf])]
        if length:
            ways += [
                np.hstack([foot, own[:, :length]]),
                np.hstack([foot, own[:, length:-1], junction]),
            ]
        edges += [np.stack([w[:, :-1].ravel(), w[:, 1:].ravel()], axis=1) for w in ways]
        rank = np.full((count, size), _BRANCH, np.int8)
        rank[:, -1] = _EXTRA + level
        ranks.append(rank.ravel())
        free += count * size
    return np.concatenate(edges), np.concatenate(ranks)


def simulate(n: int) -> tuple[int, int]:
    """Return travel and vertices of a walk on the graph by Greedy Mapping.

    >>> simulate(3)
    (207, 80)
    """
    from missions.lab.kernels import greedy_kernels as greedy  # noqa: PLC0415, importing numba takes a second

    edges, rank = graph(n)
    first, beside = greedy.adjacency(len(rank), edges)
    del edges
    return greedy.greedy_travel(first, beside, rank, n**n)


@dataclass(frozen=True, slots=True)
class Row:
    """A row of the table."""

    n: int
    travel: int
    vertices: int
    simulated: bool


def jobs(quick: bool, seed: int) -> list[tuple[int, bool]]:
    """Return every n, and whether it is walked; nothing in it is random."""
    last = QUICK if quick else SIMULATED
    return [(n, n <= last) for n in PAPER if not quick or n <= last]


def trial(job: tuple[int, bool]) -> Row:
    """Compute one row."""
    n, walk = job
    return Row(n, *(simulate(n) if walk else (travel(n), vertices(n))), walk)


def conclude(rows: Sequence[Row]) -> Page:
    """Compare the table with the paper's."""
    columns = ("n", "travel", "vertices", "ratio", "paper: travel", "paper: vertices",
               "paper: ratio", "equal", "2 sqrt(V) + 4", "by")  # fmt: skip
    table = Table(
        columns,
        tuple(
            (
                row.n, row.travel, row.vertices, row.travel / row.vertices,
                *PAPER[row.n], PAPER[row.n][0] / PAPER[row.n][1],
                (row.travel, row.vertices) == PAPER[row.n],
                2 * row.vertices**0.5 + 4,
                "simulation" if row.simulated else "formula",
            )
            for row in rows
        ),
    )  # fmt: skip
    equal = sum((row.travel, row.vertices) == PAPER[row.n] for row in rows)
    walked = [row.n for row in rows if row.simulated]
    text = f"""\
Tovey and Koenig, *Improved Analysis of Greedy Mapping*, Table 1: {equal} of {len(rows)} rows are
the paper's to the digit. Up to n = {max(walked)} the robot walks the graph, always to a nearest
vertex that it has not visited; larger n are by formula. The ratio of travel to vertices grows
without bound, as in Theorem 1, and stays far below the 2 sqrt(V) + 4 of Theorem 2.
"""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        sizes = [row.vertices for row in rows]
        paper = [PAPER[row.n][0] / PAPER[row.n][1] for row in rows]
        ours = [row.travel / row.vertices for row in rows]
        axes.plot(sizes, paper, "o", ms=11, mfc="none", color=COLOURS[1], label="paper")
        axes.plot(sizes, ours, ".-", color=COLOURS[0], label="ours")
        axes.set(xscale="log", xlabel="vertices", ylabel="travel / vertices")
        axes.legend()

    return Page("Greedy Mapping, Table 1", text, table, draw, (7.0, 4.0))


STUDY: Final = Study(
    "greedy-table-1", "Greedy Mapping's worst graphs (Tovey and Koenig)", jobs, trial, conclude
)
