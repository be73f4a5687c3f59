"""Least squares over errors that hang together: what each is alone, step by step, and by links.

East and north are one complex number, for all noise is alike in both; a scale and a rotation that
all links have in common are one, too. So the normal equations are real, but for one border.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Numbers = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Steps:
    """`e[of] - keep * e[of - 1]` is 0, with a variance; `keep` = 0 says what `e[of]` is alone."""

    of: Numbers
    keep: Reals
    variance_m2: Reals


@dataclass(frozen=True, slots=True)
class Links:
    """`excess + e[to] - e[begin] - common * moved` is 0, with a variance.

    `moved` is the movement that the ground shows, `excess` what it is more than the told one.
    """

    begin: Numbers
    to: Numbers
    moved_m: Complexes
    excess_m: Complexes
    variance_m2: Reals

    def chosen(self, which: NDArray[np.bool_]) -> Links:
        """Some of them."""
        return Links(
            self.begin[which], self.to[which], self.moved_m[which], self.excess_m[which],
            self.variance_m2[which],
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Solution:
    """The errors, metres; `common` is scale + i rotation (radians, counter-clockwise).

    `inverse` is that of the normal matrix without the common unknown, `lean` how each error changes
    with it, `common_variance` its variance. Variances are those of one component.
    """

    errors_m: Complexes
    common: complex
    inverse: Reals
    lean: Complexes
    common_variance: float

    def variance_of(self, number: int) -> float:
        """Of one error, m^2."""
        of = abs(self.lean[number]) ** 2 * self.common_variance
        return float(self.inverse[number, number] + of)

    def misfits(self, links: Links) -> tuple[Complexes, Reals]:
        """By how much links miss what is expected, and its variance, their own included."""
        i, j = links.begin, links.to
        off = links.excess_m + self.errors_m[j] - self.errors_m[i] - self.common * links.moved_m
        inverse = self.inverse
        own = inverse[j, j] + inverse[i, i] - 2.0 * inverse[i, j]
        lean = links.moved_m + self.lean[j] - self.lean[i]
        spread = links.variance_m2 + own + np.abs(lean) ** 2 * self.common_variance
        return off, np.asarray(spread, dtype=np.float64)


def solve(count: int, steps: Steps, links: Links, common_sigma: float) -> Solution:
    """The most probable errors, and how certain they are.

    Args:
        count: How many errors there are; each has a step, so that none is without any hold.
        steps: What holds them one by one.
        links: What ties them together.
        common_sigma: Prior standard deviation of scale and of rotation (radians), above 0.
    """
    matrix = np.zeros((count, count))
    weight = 1.0 / steps.variance_m2
    matrix[steps.of, steps.of] += weight
    chained = steps.keep > 0.0
    of, keep, tie = steps.of[chained], steps.keep[chained], weight[chained]
    matrix[of - 1, of - 1] += keep * keep * tie
    matrix[of, of - 1] -= keep * tie
    matrix[of - 1, of] -= keep * tie
    i, j, tie = links.begin, links.to, 1.0 / links.variance_m2
    np.add.at(matrix, (i, i), tie)
    np.add.at(matrix, (j, j), tie)
    np.add.at(matrix, (i, j), -tie)
    np.add.at(matrix, (j, i), -tie)
    pull, border = np.zeros(count, np.complex128), np.zeros(count, np.complex128)
    np.add.at(pull, j, -tie * links.excess_m)
    np.add.at(pull, i, tie * links.excess_m)
    np.add.at(border, j, -tie * links.moved_m)
    np.add.at(border, i, tie * links.moved_m)

    inverse: Reals = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
    alone, lean = inverse @ pull, inverse @ border
    stiffness = 1.0 / common_sigma**2 + float((tie * np.abs(links.moved_m) ** 2).sum())
    stiffness -= float(np.vdot(border, lean).real)
    turned = complex((tie * np.conj(links.moved_m) * links.excess_m).sum())
    common = (turned - complex(np.vdot(border, alone))) / stiffness
    return Solution(alone - lean * common, common, inverse, lean, 1.0 / stiffness)
