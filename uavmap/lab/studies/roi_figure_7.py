"""Figure 7 of Sung and Tokekar: the time of Algorithm 1 between its bounds.

One of C = 120 cells, R = 20 robots and Sr / Sp = 2.5 varies. The ROI drifts with one cell per unit
of time in one of the four directions of the grid. There are 100 trials each, on three kinds of ROI.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import mean
from typing import Final

from missions.planning.stepwise.interface import Metric
from missions.planning.stepwise.rdfs import rdfs_bound_moves
from missions.units import Cell
from uavmap.lab.studies.outcomes import explore, grouped, roi_of
from uavmap.lab.studies.study_model import COLOURS, Figure, Page, Study, Table, trial_seed

KINDS: Final = ("eden", "ragged", "thin")
FIXED: Final = {"cells": 120.0, "robots": 20.0, "speed ratio": 2.5}
VARIED: Final = {
    "cells": (20.0, 40.0, 60.0, 80.0, 100.0, 120.0, 140.0, 160.0, 180.0, 200.0),
    "robots": (1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 12.0, 16.0, 20.0, 25.0, 30.0),
    "speed ratio": (1.25, 1.5, 1.75, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 8.0, 10.0),
}
TRIALS: Final = 100
QUICK_TRIALS: Final = 4
_WINDS: Final = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))
_ROUNDING: Final = 1e-9


@dataclass(frozen=True, slots=True)
class Job:
    """A trial: a ROI, and the parameters of its exploration."""

    kind: str
    varied: str
    value: float
    seed: int

    def parameter(self, name: str) -> float:
        """Return a parameter of this trial."""
        return self.value if name == self.varied else FIXED[name]


@dataclass(frozen=True, slots=True)
class Times:
    """The times of a trial, in units in which the ROI drifts by one cell."""

    job: Job
    makespan: float
    upper: float
    lower: float
    paper_upper: float
    """Lemma 1 as printed: every move against the drift's worst."""
    paper_lower: float
    """Lemma 2: every move at its best."""
    lawn_mower: float

    @property
    def violated(self) -> bool:
        """True if a stated bound does not hold."""
        above = self.makespan > self.upper * (1 + _ROUNDING)
        return above or self.makespan < self.lower * (1 - _ROUNDING)


def jobs(quick: bool, seed: int) -> list[Job]:
    """Return all trials; those of one number share their ROI if they have equally many cells."""
    return [
        Job(kind, varied, value, trial_seed(seed, number))
        for kind in KINDS
        for varied, values in VARIED.items()
        for value in (values[::4] if quick else values)
        for number in range(QUICK_TRIALS if quick else TRIALS)
    ]


def trial(job: Job) -> Times:
    """Explore a ROI, and mow its rectangle."""
    cells, robots, speed = (
        int(job.parameter("cells")),
        int(job.parameter("robots")),
        job.parameter("speed ratio"),
    )
    metric = Metric(speed, *_WINDS[job.seed % len(_WINDS)])
    roi = roi_of(job.kind, cells, job.seed)
    done = explore("rdfs", roi, robots, metric)
    if done.bound is None:
        raise ValueError("rdfs states a bound")
    return Times(
        job=job,
        makespan=done.makespan,
        upper=done.bound,
        lower=done.lower_bound,
        paper_upper=rdfs_bound_moves(done.cells, done.tree_depth, robots) / (speed - 1.0),
        paper_lower=(done.cells - 1) / ((speed + 1.0) * robots),
        lawn_mower=lawn_mower(roi.cells, robots, metric),
    )


@dataclass(frozen=True, slots=True)
class Case:
    """The trials of one point of a curve."""

    kind: str
    varied: str
    value: float
    times: tuple[Times, ...]

    def mean(self, of: Callable[[Times], float]) -> float:
        """Return a mean over the trials."""
        return mean(map(of, self.times))

    @property
    def makespans(self) -> list[float]:
        """T of every trial."""
        return [t.makespan for t in self.times]

    @property
    def makespan(self) -> float:
        """The mean T."""
        return mean(self.makespans)


def conclude(times: Sequence[Times]) -> Page:
    """Compare means, least and most with the paper's statements."""
    groups = grouped(times, lambda t: (t.job.kind, t.job.varied, t.job.value))
    cases = [Case(*key, tuple(group)) for key, group in groups.items()]
    table = Table(
        ("ROI", "varied", "value", "trials", "mean", "min", "max", "upper bound", "lower bound",
         "lawn mower", "paper's upper", "paper's lower", "violations"),
        tuple(
            (
                c.kind, c.varied, c.value, len(c.times), c.makespan, min(c.makespans),
                max(c.makespans), c.mean(lambda t: t.upper), c.mean(lambda t: t.lower),
                c.mean(lambda t: t.lawn_mower), c.mean(lambda t: t.paper_upper),
                c.mean(lambda t: t.paper_lower), sum(t.violated for t in c.times),
            )
            for c in cases
        ),
    )  # fmt: skip
    violations = sum(t.violated for t in times)
    text = f"""\
Source: Sung and Tokekar, section 6. C = 120, R = 20, Sr / Sp = 2.5, while one of them varies. The
ROI drifts at Sp = 1 cell a unit of time in a random one of the four directions. The paper prints no
values, so its statements are set beside ours. Upper and lower bound are the ones that this project
states; the paper's, as printed, are in the table. The lawn mower knows the rectangle around the ROI
and its ways are not counted: a baseline, not a lower bound.

**{violations} violations of the stated bounds in {len(times)} runs.**

{_statements(cases).markdown()}
"""
    return Page(
        "Algorithm 1 between its bounds, Figure 7",
        text,
        table,
        lambda figure: _draw(figure, cases),
        (11.0, 9.0),
    )


def _statements(cases: Sequence[Case]) -> Table:
    rows: list[tuple[str, ...]] = []
    for statement, varied, holds in (
        ("time grows with the cells", "cells", lambda cs: _rises([c.makespan for c in cs])),
        ("max - min grows with the cells", "cells", lambda cs: _spread(cs[-1]) > _spread(cs[0])),
        ("upper bound - time grows with the cells", "cells",
         lambda cs: _slack(cs[-1]) > _slack(cs[0])),
        ("time is nearer to the lawn mower than to its upper bound", "cells", _near_lawn_mower),
        ("time falls with the robots", "robots", lambda cs: _rises([-c.makespan for c in cs])),
        ("time is below the upper bound", "robots", lambda cs: all(_slack(c) >= 0 for c in cs)),
        ("time falls with the speed ratio", "speed ratio",
         lambda cs: _rises([-c.makespan for c in cs])),
        ("upper - lower bound falls with the speed ratio", "speed ratio",
         lambda cs: _rises([c.mean(lambda t: t.lower - t.upper) for c in cs])),
    ):  # fmt: skip
        of = {k: [c for c in cases if (c.kind, c.varied) == (k, varied)] for k in KINDS}
        rows.append((statement, *("yes" if holds(of[kind]) else "no" for kind in KINDS)))
    return Table(("the paper states", *(f"here, {kind}" for kind in KINDS)), tuple(rows))


def _rises(values: Sequence[float]) -> bool:
    """Return True if values rise on the whole: no step back exceeds a tenth of the way."""
    way = values[-1] - values[0]
    return way > 0 and all(b - a > -0.1 * way for a, b in pairwise(values))


def _spread(case: Case) -> float:
    return max(case.makespans) - min(case.makespans)


def _slack(case: Case) -> float:
    return case.mean(lambda t: t.upper) - case.makespan


def _near_lawn_mower(cases: Sequence[Case]) -> bool:
    return all(
        c.makespan - c.mean(lambda t: t.lawn_mower) < c.mean(lambda t: t.paper_upper) - c.makespan
        for c in cases[len(cases) // 2 :]
    )


def _draw(figure: Figure, cases: Sequence[Case]) -> None:
    grid = figure.subplots(len(KINDS), len(VARIED), squeeze=False)
    for axes, (kind, varied) in zip(
        grid.flat, ((k, v) for k in KINDS for v in VARIED), strict=True
    ):
        own = [c for c in cases if (c.kind, c.varied) == (kind, varied)]
        x = [c.value for c in own]
        low, high = [min(c.makespans) for c in own], [max(c.makespans) for c in own]
        axes.fill_between(x, low, high, color=COLOURS[0], alpha=0.2, lw=0, label="least to most")
        for label, colour, style, of in (
            ("upper bound", COLOURS[1], "--", lambda t: t.upper),
            ("rdfs, mean", COLOURS[0], "o-", lambda t: t.makespan),
            ("lawn mower", COLOURS[4], ":", lambda t: t.lawn_mower),
            ("lower bound", COLOURS[2], "-.", lambda t: t.lower),
        ):
            axes.plot(x, [c.mean(of) for c in own], style, color=colour, ms=4, label=label)
        axes.set(title=kind, xlabel=varied, ylabel="time", ylim=(0, None))
    grid[0, 0].legend(fontsize=8)


STUDY: Final = Study(
    "roi-figure-7", "Algorithm 1 between its bounds (Sung and Tokekar)", jobs, trial, conclude
)


# --- the lawn mower ------------------------------------------------------------------------------
def lawn_mower(roi: Collection[Cell], robots: int, metric: Metric) -> float:
    """Return the time to mow the known rectangle around a ROI, one strip a robot.

    The rectangle is split along its length or its breadth, whichever is faster; the paths to the
    strips and home do not count. It is a baseline, neither a strategy nor a lower bound.

    >>> lawn_mower([Cell(0, 0), Cell(3, 1)], 2, Metric())
    3.0
    """
    wide = max(c.east for c in roi) - min(c.east for c in roi) + 1
    high = max(c.north for c in roi) - min(c.north for c in roi) + 1
    return min(
        _mow(-(-wide // robots), high, metric),
        _mow(wide, -(-high // robots), metric),
    )


def _mow(wide: int, high: int, metric: Metric) -> float:
    """Return the time for a rectangle from the best corner, in lanes along the better axis."""
    east, north = Cell(1, 0), Cell(0, 1)
    return min(
        _lanes(wide, high, east, north, metric),
        _lanes(high, wide, north, east, metric),
    )


def _lanes(steps: int, lanes: int, along: Cell, across: Cell, metric: Metric) -> float:
    origin = Cell(0, 0)
    forth, back = metric.leg(origin, along), metric.leg(along, origin)
    aside = min(metric.leg(origin, across), metric.leg(across, origin))
    first, second = -(-lanes // 2), lanes // 2
    up_and_down = min(first * forth + second * back, first * back + second * forth)
    return (steps - 1) * up_and_down + (lanes - 1) * aside
