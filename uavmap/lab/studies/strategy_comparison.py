"""All strategies compared: mean makespan over the mean lower bound."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import mean
from typing import Final

from missions.lab.strategies import EXPLORERS
from uavmap.lab.studies.outcomes import Explored, Job, explored, grouped
from uavmap.lab.studies.study_model import COLOURS, MARKERS, Figure, Page, Study, Table, trial_seed

KINDS: Final = ("eden", "ragged", "rectangle", "thin")
ROBOTS: Final = (1, 2, 4, 8, 20)
CELLS, TRIALS = 120, 100
LARGE_KIND, LARGE, LARGE_TRIALS = "eden", 500, 20
PATIENT_TRIALS: Final = 10
"""Trials of strategies that have no map and wander for long."""
QUICK_CELLS, QUICK_TRIALS, QUICK_ROBOTS = 24, 2, (1, 4)

_COLUMNS: Final = ("rdfs-paper", "rdfs", "greedy", "hungarian", "horizon", "offline")
_REFERENCE: Final[Mapping[tuple[str, int], Sequence[Sequence[float | None]]]] = {
    ("eden", 120): (
        (1.69, 1.69, 1.40, 1.19, 1.11, 1.01),
        (2.36, 1.85, 1.51, 1.27, 1.17, 1.02),
        (2.80, 2.10, 1.57, 1.41, 1.30, 1.09),
        (2.14, 1.71, 1.30, 1.21, 1.17, 1.03),
        (1.40, 1.30, 1.08, 1.06, 1.06, 1.00),
    ),
    ("ragged", 120): (
        (1.24, 1.24, 1.19, 1.08, 1.04, 1.00),
        (1.76, 1.42, 1.37, 1.29, 1.27, 1.13),
        (1.89, 1.56, 1.46, 1.42, 1.42, 1.13),
        (1.47, 1.35, 1.27, 1.25, 1.23, 1.02),
        (1.22, 1.19, 1.14, 1.16, 1.13, 1.01),
    ),
    ("eden", 500): (
        (None, 1.84, None, None, 1.12, None),
        (None, 2.14, None, None, 1.15, None),
        (None, 2.79, None, None, 1.22, None),
        (None, 3.40, None, None, 1.36, None),
        (None, 2.27, None, None, 1.12, None),
    ),
}
"""Prototypes of these strategies on ROIs of the same kinds, and the best known offline tours; one
row for each of `ROBOTS`."""


def reference(kind: str, cells: int, robots: int, strategy: str) -> float | None:
    """Return the ratio of a prototype; None if there was none.

    >>> reference("eden", 120, 4, "rdfs")
    2.1
    """
    rows = _REFERENCE.get((kind, cells))
    if rows is None or robots not in ROBOTS or strategy not in _COLUMNS:
        return None
    return rows[ROBOTS.index(robots)][_COLUMNS.index(strategy)]


def jobs(quick: bool, seed: int) -> list[Job]:
    """Return all strategies on the same ROIs."""
    sets = [(kind, QUICK_CELLS, QUICK_TRIALS) for kind in KINDS]
    if not quick:
        sets = [*((kind, CELLS, TRIALS) for kind in KINDS), (LARGE_KIND, LARGE, LARGE_TRIALS)]
    found = []
    for kind, cells, trials in sets:
        for robots in QUICK_ROBOTS if quick else ROBOTS:
            for name, explorer in EXPLORERS.items():
                patient = getattr(explorer, "patience", 1.0) > 1.0
                if patient and cells > CELLS:
                    continue
                for number in range(min(trials, PATIENT_TRIALS) if patient else trials):
                    found.append(Job(name, kind, cells, robots, trial_seed(seed, cells, number)))
    return found


def conclude(found: Sequence[Explored]) -> Page:
    """Compare the ratios with those of the prototypes."""
    groups = grouped(found, lambda f: (f.job.kind, f.job.cells, f.job.robots, f.job.strategy))
    makespans = {key: mean(f.found.makespan for f in fs) for key, fs in groups.items()}
    lowers = {key: mean(f.found.lower_bound for f in fs) for key, fs in groups.items()}
    ratios = {key: makespan / lowers[key] for key, makespan in makespans.items()}
    table = Table(
        ("ROI", "cells", "robots", "strategy", "runs", "mean T", "mean lower bound", "T / LB",
         "prototype", "offline", "bound broken"),
        tuple(
            (
                *key, len(fs), makespans[key], lowers[key], ratios[key], reference(*key),
                reference(*key[:3], "offline"), _broken(fs),
            )
            for key, fs in groups.items()
        ),
    )  # fmt: skip
    names = list(dict.fromkeys(f.job.strategy for f in found))
    sets = list(dict.fromkeys(key[:3] for key in groups))
    broken = _broken(found)
    text = f"""\
The table has the mean makespan over the mean lower bound on the optimum. ROIs rest, robots fly at
unit speed from a random cell of the boundary, and all robots share one map. In brackets: prototypes
of the same strategies on other ROIs of the same kind. *Offline*: the best known tours with a known
ROI.

{_matrix(names, sets, ratios).markdown()}

A strategy's stated bound was broken in {broken} of {len(found)} runs. Strategies without a map ran
on at most {PATIENT_TRIALS} ROIs each, and not on the largest.
"""
    return Page("Strategies", text, table, lambda figure: _draw(figure, names, ratios), (11.0, 8.0))


def _broken(found: Sequence[Explored]) -> int:
    return sum(f.found.bound_held is False for f in found)


def _matrix(
    names: Sequence[str],
    sets: Sequence[tuple[str, int, int]],
    ratios: Mapping[tuple[str, int, int, str], float],
) -> Table:
    rows = []
    for kind, cells, robots in sets:
        row = []
        for name in names:
            ours = ratios.get((kind, cells, robots, name))
            theirs = reference(kind, cells, robots, name)
            own = "" if ours is None else f"{ours:.2f}"
            row.append(own if theirs is None else f"{own} ({theirs:.2f})")
        rows.append((f"{kind} {cells}", robots, *row, reference(kind, cells, robots, "offline")))
    return Table(("ROI", "robots", *names, "offline"), tuple(rows))


def _draw(
    figure: Figure, names: Sequence[str], ratios: Mapping[tuple[str, int, int, str], float]
) -> None:
    smallest = min(cells for _, cells, _, _ in ratios)
    grid = figure.subplots(2, 2)
    for axes, kind in zip(grid.flat, KINDS, strict=True):
        for i, name in enumerate(names):
            points = sorted(
                (robots, ratio)
                for (of, cells, robots, by), ratio in ratios.items()
                if (of, cells, by) == (kind, smallest, name)
            )
            axes.plot(*zip(*points, strict=True), color=COLOURS[i % len(COLOURS)],
                      marker=MARKERS[i % len(MARKERS)], ms=4, label=name,
                      ls="-" if i < len(COLOURS) else "--")  # fmt: skip
        axes.axhline(1.0, color="k", lw=1)
        axes.set(title=f"{kind}, {smallest} cells", xscale="log", yscale="log", xlabel="robots",
                 ylabel="T / LB")  # fmt: skip
    grid[0, 0].legend(fontsize=7)


STUDY: Final = Study(
    "strategies",
    "every strategy on every kind of ROI, and the lower bound",
    jobs,
    explored,
    conclude,
)
