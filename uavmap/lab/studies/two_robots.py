"""Table 1 of Rekleitis, Dudek and Milios, and the position errors of robots that watch each other.

The table has path, steps and turns of two robots that cover a rectangle by triangles or by
diamonds. The rectangles are whole stripes broad and whole moves long, so nothing is left over. The
diamonds' turns are printed without a factor: the turns inside of one stripe, not of all.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from missions.lab.cooperation.space import GRID_M, Space
from missions.lab.cooperation.tracking import Noise, followed, legs_of
from missions.lab.cooperation.trapezoids import Cover, Pattern, Reckoned, explore, reckoned
from uavmap.lab.studies.study_model import COLOURS, Figure, Page, Study, Table, trial_seed

RANGE_M: Final = 10.0
THETAS_DEG: Final = (20, 40, 60, 80, 100, 120)
STRIPES, MOVES = 20, 100
QUICK_STRIPES, QUICK_MOVES = 4, 20
SIDES_M: Final = (20, 40, 80, 160)
RUNS, QUICK_RUNS = 200, 10


@dataclass(frozen=True, slots=True)
class Covering:
    """A rectangle to be covered: `stripes` broad, and `moves` long."""

    cover: Cover
    theta_deg: int
    stripes: int
    moves: int


@dataclass(frozen=True, slots=True)
class Covered:
    """The figures of a covering, and those of Table 1."""

    job: Covering
    length_m: float
    breadth_m: float
    path_m: float
    steps: int
    turns: int
    formula: Reckoned


@dataclass(frozen=True, slots=True)
class Following:
    """A square in which the robots' places are followed, with several draws of the noise."""

    side_m: int
    seeds: tuple[int, ...]


class Followed(NamedTuple):
    """Root mean squares over all draws and both robots: a row of the table of places."""

    side_m: int
    path_m: float
    watched_m: float
    alone_m: float
    times_better: float
    nees_watched: float
    """NEES of place and heading: 3 for an honest filter."""
    nees_alone: float
    runs: int


Job = Covering | Following
Result = Covered | Followed


def jobs(quick: bool, seed: int) -> list[Job]:
    """Return the rectangles and the squares."""
    stripes, moves = (QUICK_STRIPES, QUICK_MOVES) if quick else (STRIPES, MOVES)
    thetas = THETAS_DEG[1::2] if quick else THETAS_DEG
    runs, sides = (QUICK_RUNS, SIDES_M[:2]) if quick else (RUNS, SIDES_M)
    return [
        *(Covering(cover, theta, stripes, moves) for cover in Cover for theta in thetas),
        *(Following(side, tuple(trial_seed(seed, side, i) for i in range(runs))) for side in sides),
    ]


def trial(job: Job) -> Result:
    """Cover a rectangle, or follow the robots in a square."""
    return covered(job) if isinstance(job, Covering) else _follow(job)


def covered(job: Covering) -> Covered:
    """Cover a rectangle.

    >>> found = covered(Covering(Cover.TRIANGLES, 60, 4, 20))
    >>> round(found.path_m, 1), found.steps
    (860.6, 84)
    >>> round(found.formula.path_m, 1), round(found.formula.steps)
    (869.3, 80)
    """
    theta = math.radians(job.theta_deg)
    pattern = Pattern(RANGE_M, theta, cover=job.cover)
    # a little short of whole moves and stripes: a rest of a stripe would be one more
    x = math.floor(job.moves * RANGE_M * math.sin(theta / 2.0) / GRID_M) * GRID_M
    y = math.floor(job.stripes * pattern.height_m / GRID_M) * GRID_M
    numbers = explore(Space([(0, 0), (x, 0), (x, y), (0, y)]), (0.0, 0.0), pattern).figures()
    formula = reckoned(job.cover, x, y, RANGE_M, theta)
    return Covered(job, x, y, numbers.path_m, numbers.steps, numbers.turns, formula)


def _follow(job: Following) -> Followed:
    side = float(job.side_m)
    space = Space([(0, 0), (side, 0), (side, side), (0, side)])
    exploration = explore(space, (0.0, 0.0), Pattern(RANGE_M, math.radians(60.0)))
    legs = list(legs_of(exploration))
    ends = [followed(exploration, Noise(), seed, legs=legs) for seed in job.seeds]
    squares = np.array([[[end.error_m(i) ** 2 for i in (0, 1)] for end in pair] for pair in ends])
    nees = np.array([[[end.nees(i) for i in (0, 1)] for end in pair] for pair in ends])
    watched, alone = np.sqrt(squares.mean(axis=(0, 2)))
    nees_watched, nees_alone = nees.mean(axis=(0, 2))
    return Followed(
        job.side_m, exploration.figures().path_m, float(watched), float(alone),
        float(alone) / float(watched), float(nees_watched), float(nees_alone), len(ends),
    )  # fmt: skip


def _percent(found: float, stated: float) -> float:
    return round(100.0 * (found / stated - 1.0), 2)


_COLUMNS: Final = (
    "covering", "theta, deg", "X, m", "Y, m", "path, m", "paper: path", "off, %", "steps",
    "paper: steps", "off, % ", "turns", "paper as printed: turns", "paper corrected: turns",
    "off, %  ",
)  # fmt: skip
_NOTES: Final = """\
Source: Rekleitis, Dudek and Milios, *Multi-Robot Exploration of an Unknown Environment* (IJCAI
1997), Table 1. Two robots that do not know the rectangle explore {stripes} stripes of
{moves} moves each, with a range of 10 m. The formulas leave out the ends of stripes. There the
robots stand side by side, which needs at most three steps more in a stripe. A stripe has one
diamond's tip less, and those beside the walls are cut off. No robot leaves the last stripe.
So up to one breadth of a stripe is missing from the 2Y between stripes, and so are two turns. The
largest differences are path by {path:.2f} %, steps by {steps:.2f} %, and turns by {turns:.2f} %
of the corrected formula.

The diamonds' turns as printed, 2Y/R + 4X/(R sqrt(2 - 2 cos theta)), count the turns inside of one
stripe. Multiplied by the Y/R stripes they are those of the robots.

The table below has the errors of the believed places at the end of squares, as root mean square of
both robots. They are watched, or have the same odometers alone. NEES is the normalised estimation
error squared of place and heading, which is 3 for an honest filter.

{table}
"""


def conclude(results: Sequence[Result]) -> Page:
    """Compare the table with the paper's; add the errors of places."""
    rows = [row for row in results if isinstance(row, Covered)]
    ends = [row for row in results if isinstance(row, Followed)]
    cells = [
        (
            row.job.cover.value, row.job.theta_deg, row.length_m, row.breadth_m,
            row.path_m, row.formula.path_m, _percent(row.path_m, row.formula.path_m),
            row.steps, row.formula.steps, _percent(row.steps, row.formula.steps),
            row.turns, row.formula.turns, row.formula.turns_corrected,
            _percent(row.turns, row.formula.turns_corrected),
        )
        for row in rows
    ]  # fmt: skip
    places = Table(
        ("square, m", "path, m", "watched, m", "alone, m", "alone / watched", "NEES watched",
         "NEES alone", "runs"),
        tuple(ends),
    )  # fmt: skip
    path, steps, turns = (max(abs(float(c[i])) for c in cells) for i in (6, 9, 13))
    first = rows[0].job
    text = _NOTES.format(
        stripes=first.stripes, moves=first.moves, path=path, steps=steps, turns=turns,
        table=places.markdown(),
    )  # fmt: skip
    table = Table(_COLUMNS, tuple(cells))
    return Page("Two robots, Table 1", text, table, lambda f: _draw(f, rows, ends), (10.0, 4.0))


def _draw(figure: Figure, rows: Sequence[Covered], ends: Sequence[Followed]) -> None:
    left, middle, right = figure.subplots(1, 3)
    degrees = np.linspace(min(THETAS_DEG), max(THETAS_DEG), 60)
    for colour, cover in zip(COLOURS, Cover, strict=False):
        mine = [row for row in rows if row.job.cover is cover]
        thetas = [row.job.theta_deg for row in mine]
        large = [reckoned(cover, 1e6, 1e6, 1.0, math.radians(d)) for d in degrees]
        left.plot(degrees, [f.path_m / 1e12 for f in large], color=colour, label=f"{cover}, paper")
        areas = [row.length_m * row.breadth_m for row in mine]
        known = [row.path_m - 2.0 * row.breadth_m for row in mine]
        per_area = [k * RANGE_M / a for k, a in zip(known, areas, strict=True)]
        left.plot(thetas, per_area, "o", mfc="none", color=colour, label=f"{cover}, ours")
        middle.plot(degrees, [f.steps / 1e12 for f in large], color=colour)
        steps = [row.steps * RANGE_M**2 / a for row, a in zip(mine, areas, strict=True)]
        middle.plot(thetas, steps, "o", mfc="none", color=colour)
    left.set(xlabel="theta, degrees", ylabel="(path - 2Y) R / (X Y)")
    left.legend(fontsize="small")
    middle.set(xlabel="theta, degrees", ylabel="steps R² / (X Y)")
    paths = [end.path_m for end in ends]
    right.plot(paths, [end.alone_m for end in ends], "s-", color=COLOURS[1], label="alone")
    right.plot(paths, [end.watched_m for end in ends], "o-", color=COLOURS[0], label="watched")
    right.set(xscale="log", yscale="log", xlabel="path of both, m", ylabel="error of place, m")
    right.xaxis.set_minor_formatter("")
    right.legend(fontsize="small")


STUDY: Final = Study(
    "two-robots", "two robots that watch each other (Rekleitis et al.)", jobs, trial, conclude
)
