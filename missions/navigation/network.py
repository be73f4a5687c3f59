"""Least squares over correlated errors: each alone, step by step, and by links.

East and north are one complex number, for noise is alike in both. Scale and rotation of pictures
are one number as well, and change slowly: they are known at a few knots in time. So the normal
equations are real, but for a border of one column per knot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

UNSUPPORTED_STEP_ERROR_M: Final = 0.3
"""Error of an unsupported step beyond that of dead reckoning, m."""


@dataclass(frozen=True, slots=True)
class ReportedErrors:
    """Errors of reported positions; standard deviations in one direction.

    Attributes:
        satellites_m: Error of a position by satellites, above 0.
        satellites_s: Time over which such an error stays alike, above 0.
        reckoned_share: Error of dead reckoning, as a share of the way.
        reckoned_over_m: Way over which that share stays alike.
        reckoned_m_sqrt_s: Its drift in a second, at rest as well; it grows with the root.
        common: Error of the scale of pictures (heights), as a share, and of their rotation in
            radians (headings); above 0.
        common_s: Time over which both stay alike, above 0.
        pointing_m: Error of the place below the camera in each picture, by its attitude.
    """

    satellites_m: float = 0.7
    satellites_s: float = 60.0
    reckoned_share: float = 0.03
    reckoned_over_m: float = 50.0
    reckoned_m_sqrt_s: float = 0.1
    common: float = 0.04
    common_s: float = 80.0
    pointing_m: float = 0.05

    def __post_init__(self) -> None:
        """Raise `ValueError` for a value that is no standard deviation."""
        for name in ("satellites_m", "satellites_s", "reckoned_m_sqrt_s", "common", "common_s"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} is {getattr(self, name):g}, expected above 0")


@dataclass(frozen=True, slots=True)
class Estimate:
    """The estimate at the newest keyframe.

    Attributes:
        error_m: Reported minus true position, east and north.
        sigma_m: Its standard deviation in one direction.
        scale: Excess of ways in its picture, as a share.
        rotation_rad: Rotation of its picture, counter-clockwise.
    """

    error_m: tuple[float, float]
    sigma_m: float
    scale: float
    rotation_rad: float


@dataclass(frozen=True, slots=True)
class Disagreement:
    """The error of satellites, if they began to be false at `since_s`.

    Attributes:
        error_m: Reported minus true position of the newest keyframe, east and north.
        sigma_m: Its standard deviation in one direction.
        since_s: Beginning of the false positions, as far as known: rather too early.
        leap_m: Largest jump of the reported position between two pictures in the last minute;
            0 without one.
    """

    error_m: tuple[float, float]
    sigma_m: float
    since_s: float
    leap_m: float = 0.0

    @property
    def least_m(self) -> float:
        """The error less 2.5 standard deviations; may be negative."""
        return math.hypot(*self.error_m) - 2.5 * self.sigma_m

    def wrong(self, tolerated_m: float) -> bool:
        """Return whether satellites are certainly off, or have jumped, by more than `tolerated_m`.

        A jump is known far better than the error: it does not depend on the quality of the map.
        """
        return max(self.least_m, self.leap_m - 2.5 * UNSUPPORTED_STEP_ERROR_M) > tolerated_m


Reals = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Numbers = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Steps:
    """`e[of] - keep * e[after]` is 0, with a variance; with `keep` = 0 it is `e[of]` alone."""

    of: Numbers
    after: Numbers
    keep: Reals
    variance_m2: Reals


@dataclass(frozen=True, slots=True)
class Links:
    """`excess + e[to] - e[begin] - c * moved` is 0, with a variance.

    `moved` is the movement that the ground shows, `excess` its excess over the reported one. `c` is
    the sum of `share` times the turns at `knots` (both of shape (links, 4)).
    """

    begin: Numbers
    to: Numbers
    moved_m: Complexes
    excess_m: Complexes
    variance_m2: Reals
    knots: Numbers
    share: Reals

    def turns(self, turns: Complexes) -> Complexes:
        """Return the scale and rotation of each, by the knots."""
        return np.asarray((self.share * turns[self.knots]).sum(axis=1), dtype=np.complex128)


@dataclass(frozen=True, slots=True)
class Turns:
    """Constraints of scale + i rotation at the knots: a process around 0, and pictures' zooms.

    `prior` is the inverse covariance of all knots, shape (knots, knots). A zoom constrains the sum
    of `share` times the turns at `knots` (both of shape (zooms, 4)) to `zoom`, with a variance.
    """

    prior: Reals
    knots: Numbers
    share: Reals
    zoom: Complexes
    variance: Reals


@dataclass(frozen=True, slots=True)
class Solution:
    """The errors, metres; `turns` are scale + i rotation (radians, counter-clockwise) at the knots.

    `inverse` is that of the normal matrix without the turns. `lean` is the change of each error
    with each turn (negative), `turns_variance` the covariance of turns. Variances are of one
    component. `evidence` is the logarithm of the probability of all observations by the steps, but
    for a constant that is the same for all steps.
    """

    errors_m: Complexes
    turns: Complexes
    inverse: Reals
    lean: Complexes
    turns_variance: Complexes
    evidence: float = math.nan

    def variance_of(self, number: int) -> float:
        """Return the variance of one error, m^2."""
        of = self._by_turns(self.lean[number][None])[0]
        return float(self.inverse[number, number] + of)

    def misfits(self, links: Links) -> tuple[Complexes, Reals]:
        """Return the misfits of links, and their variance, their own included."""
        i, j = links.begin, links.to
        turned = links.turns(self.turns) * links.moved_m
        off = links.excess_m + self.errors_m[j] - self.errors_m[i] - turned
        inverse = self.inverse
        own = inverse[j, j] + inverse[i, i] - 2.0 * inverse[i, j]
        lean = self.lean[j] - self.lean[i]
        rows = np.arange(len(i))[:, None]
        np.add.at(lean, (rows, links.knots), links.share * links.moved_m[:, None])
        return off, np.asarray(links.variance_m2 + own + self._by_turns(lean), dtype=np.float64)

    def zoom_misfits(self, turns: Turns) -> tuple[Complexes, Reals]:
        """Return the misfits of zooms, and their variance, their own included."""
        off = turns.zoom - (turns.share * self.turns[turns.knots]).sum(axis=1)
        weights = np.zeros((len(off), len(self.turns)), np.complex128)
        np.add.at(weights, (np.arange(len(off))[:, None], turns.knots), turns.share)
        return off, np.asarray(turns.variance + self._by_turns(weights), dtype=np.float64)

    def _by_turns(self, lean: Complexes) -> Reals:
        """Return the variance of sums of turns."""
        return np.asarray(((lean @ self.turns_variance) * lean.conj()).sum(axis=1).real)


def solve(
    count: int, steps: Steps, links: Links, turns: Turns, *, weighed: bool = False
) -> Solution:
    """Return the most probable errors and their certainty, with the evidence if `weighed`.

    Each of the `count` errors has a step, so that none is unconstrained.
    """
    matrix = np.zeros((count, count))
    weight = 1.0 / steps.variance_m2
    np.add.at(matrix, (steps.of, steps.of), weight)
    chained = steps.keep > 0.0
    of, after, keep = steps.of[chained], steps.after[chained], steps.keep[chained]
    tie = weight[chained]
    np.add.at(matrix, (after, after), keep * keep * tie)
    np.add.at(matrix, (of, after), -keep * tie)
    np.add.at(matrix, (after, of), -keep * tie)
    i, j, tie = links.begin, links.to, 1.0 / links.variance_m2
    np.add.at(matrix, (i, i), tie)
    np.add.at(matrix, (j, j), tie)
    np.add.at(matrix, (i, j), -tie)
    np.add.at(matrix, (j, i), -tie)
    knots = len(turns.prior)
    pull, border = np.zeros(count, np.complex128), np.zeros((count, knots), np.complex128)
    np.add.at(pull, j, -tie * links.excess_m)
    np.add.at(pull, i, tie * links.excess_m)
    turned = (tie * links.moved_m)[:, None] * links.share
    np.add.at(border, (j[:, None], links.knots), -turned)
    np.add.at(border, (i[:, None], links.knots), turned)

    inverse: Reals = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
    sides = np.column_stack([border, pull])
    solved = (inverse @ sides.view(np.float64)).view(np.complex128)  # all real but the sides
    lean, alone = solved[:, :-1], solved[:, -1]
    stiffness, known = _turn_constraints(links, turns)
    stiffness = stiffness - border.conj().T @ lean
    turns_variance: Complexes = np.asarray(np.linalg.inv(stiffness), dtype=np.complex128)
    found = turns_variance @ (known - border.conj().T @ alone)
    errors = alone - lean @ found
    if not weighed:
        return Solution(errors, found, inverse, lean, turns_variance)
    explained = float((np.vdot(pull, errors) + np.vdot(known, found)).real)
    volume = float(np.linalg.slogdet(matrix)[1] + np.linalg.slogdet(stiffness)[1])
    evidence = explained / 2.0 - volume - float(np.log(steps.variance_m2).sum())
    return Solution(errors, found, inverse, lean, turns_variance, evidence)


def _turn_constraints(links: Links, turns: Turns) -> tuple[Complexes, Complexes]:
    """Return the constraints of the turns if no error changes: a matrix, and a right side."""
    knots = len(turns.prior)
    matrix = turns.prior.copy()
    right = np.zeros(knots, np.complex128)
    stiff = np.abs(links.moved_m) ** 2 / links.variance_m2
    said = links.moved_m.conj() * links.excess_m / links.variance_m2
    for at, share, weight, side in (
        (links.knots, links.share, stiff, said),
        (turns.knots, turns.share, 1.0 / turns.variance, turns.zoom / turns.variance),
    ):
        pairs = share[:, :, None] * share[:, None, :] * weight[:, None, None]
        np.add.at(matrix, (at[:, :, None], at[:, None, :]), pairs)
        np.add.at(right, at, share * side[:, None])
    return matrix.astype(np.complex128), right
