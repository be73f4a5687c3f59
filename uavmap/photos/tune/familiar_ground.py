"""The painted ground as mixtures of Gaussians, and its density in the pictures left out of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavmap.photos.tune.selection import Choice, Picture, by_cell, dealt
from uavmap.photos.tune.training import Scale, clear, seven_digits
from vision.detectors.familiarity import (
    NAMES,
    QUANTILES,
    Comparison,
    Familiarity,
    Gaussian,
    Kind,
)
from vision.detectors.interface import UNFAMILIAR, UNSURE
from vision.detectors.pixel_features import FEATURES

_PARTS: Final = (4, 8)
"""Minimum and maximum number of Gaussians of each kind of ground."""
_PARTS_A_PICTURE: Final = 2
"""Additional Gaussians for each picture after the third, which is painted for its new ground."""
_SMOOTH: Final = 0.02
"""Addition to each variance of the standardised features: few pictures vary too little."""
_A_PICTURE: Final = 6000
_MOST: Final = 12_000
_FEW: Final = 50
_FLAT: Final = (0.0,) * len(QUANTILES)

Array = NDArray[np.float32]
_ROWS: Final = [FEATURES.index(name) for name in NAMES]


@dataclass(frozen=True, slots=True)
class FamiliarGround:
    """The painted ground.

    `left_out` has for each picture the familiarity of its places to a detector that has not seen
    it. There are two: one if they are taken for region, one for surround; each (places,).
    """

    familiarity: Familiarity
    left_out: tuple[tuple[Array, Array], ...]


def familiar_ground(pictures: Sequence[Picture], scale: Scale, seed: int) -> FamiliarGround:
    """Describe the painted ground; measure on each picture the density of the others."""
    rng = np.random.default_rng([seed, 3])
    samples = [_samples(picture, rng) for picture in pictures]
    scaled = (scale[0][_ROWS].astype(np.float32), scale[1][_ROWS].astype(np.float32))
    parts = int(np.clip(_PARTS[0] + _PARTS_A_PICTURE * (len(pictures) - 3), *_PARTS))

    def compared(chosen: Sequence[int], number: int) -> Comparison:
        some = [samples[i][number] for i in chosen if len(samples[i][number]) >= _FEW]
        some = some or [samples[i][number] for i in chosen]
        gaussians = _mixture((np.concatenate(some) - scaled[0]) / scaled[1], parts, rng, seed)
        return Comparison(Kind(gaussians=gaussians, densities=_FLAT), *scaled)

    quantiles: tuple[list[Array], list[Array]] = ([], [])
    places: dict[int, tuple[Array, Array]] = {}
    for learned_from, judged in dealt(pictures):
        kinds = [compared(learned_from, number) for number in (0, 1)]
        for i in judged:
            values = np.ascontiguousarray(pictures[i][0].values[_ROWS])
            places[i] = (kinds[0].density(values), kinds[1].density(values))
            for number, kind in enumerate(kinds):
                if len(samples[i][number]) >= _FEW:
                    found = kind.density(np.ascontiguousarray(samples[i][number].T))
                    quantiles[number].append(np.quantile(found, QUANTILES).astype(np.float32))
    everything = range(len(pictures))
    region, surround = (
        Kind(
            gaussians=compared(everything, number).kind.gaussians,
            densities=_rising(np.median(np.stack(quantiles[number]), axis=0)),
        )
        for number in (0, 1)
    )
    left_out = tuple(
        (
            np.interp(places[i][0], region.densities, QUANTILES).astype(np.float32),
            np.interp(places[i][1], surround.densities, QUANTILES).astype(np.float32),
        )
        for i in everything
    )
    familiarity = Familiarity(
        mean=seven_digits(scaled[0]),
        scale=seven_digits(scaled[1]),
        region=region,
        surround=surround,
    )
    return FamiliarGround(familiarity, left_out)


class Sure(NamedTuple):
    """The share of a left-out picture's cells that is familiar, and the wrong share of these."""

    share: float
    wrong: float


def sure_cells(
    pictures: Sequence[Picture], choice: Choice, ground: FamiliarGround, cell: float
) -> tuple[Sure, ...]:
    """Return the sure share of each unseen picture, and the wrong share of it.

    Args:
        cell: Side of a cell, in places.
    """
    found = []
    for (plain, *_), share, familiarity in zip(
        pictures, choice.shares, ground.left_out, strict=True
    ):
        taken = np.where(share >= choice.threshold, *familiarity)
        shape = (plain.rows, plain.columns)
        unfamiliar = (taken < UNFAMILIAR).astype(np.float32).reshape(shape)
        known = plain.known.reshape(shape)
        region = plain.region.reshape(shape)
        seen = by_cell(known.astype(np.float32), cell)
        weight = np.maximum(seen, 1e-6)
        is_sure = (by_cell(unfamiliar * known, cell) / weight < UNSURE) & (seen >= 0.5)
        there = by_cell(region * known, cell) / weight >= 0.5
        judged = by_cell(share.reshape(shape) * known, cell) / weight >= choice.share
        count = int(np.count_nonzero(is_sure))
        wrong = int(np.count_nonzero(is_sure & (there != judged)))
        cells = max(1, int(np.count_nonzero(seen >= 0.5)))
        found.append(Sure(round(count / cells, 4), round(wrong / max(1, count), 4)))
    return tuple(found)


def wrong_at_most(sure: Sequence[Sure]) -> float:
    """Return a bound on the wrong share of the sure cells to expect in a new picture.

    Conformal risk control (Angelopoulos and others, 2022) counts one more picture, all wrong. So
    three pictures bound it by a quarter at best, and nine by a tenth.
    """
    return round((sum(one.wrong for one in sure) + 1.0) / (len(sure) + 1), 4)


def _samples(picture: Picture, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return features, (samples, `NAMES`), of places of region, and of surround.

    They are of the picture as it is: among its variants, other ground would seem familiar.
    """
    plain = picture[0]
    chosen = [np.flatnonzero(which) for which in clear(plain)]
    chosen = [rng.choice(some, min(len(some), _A_PICTURE), replace=False) for some in chosen]
    region, surround = (plain.values[_ROWS][:, np.sort(some)].T for some in chosen)
    return region, surround


def _mixture(
    values: Array, parts: int, rng: np.random.Generator, seed: int
) -> tuple[Gaussian, ...]:
    from sklearn.mixture import GaussianMixture  # noqa: PLC0415 - an extra
    from threadpoolctl import threadpool_limits  # noqa: PLC0415

    if len(values) > _MOST:
        values = values[np.sort(rng.choice(len(values), _MOST, replace=False))]
    learner = GaussianMixture(
        min(parts, max(1, len(values) // _FEW)),
        reg_covar=_SMOOTH, max_iter=100, tol=0.02, random_state=seed % 2**32,
    )  # fmt: skip
    with threadpool_limits(1):  # sums in one order: the same seed gives the same bytes
        learner.fit(values.astype(np.float64))
    return tuple(
        Gaussian(
            weight=seven_digits([weight])[0],
            mean=seven_digits(mean),
            whitening=tuple(seven_digits(column) for column in factor.T),
        )
        for weight, mean, factor in zip(
            learner.weights_, learner.means_, learner.precisions_cholesky_, strict=True
        )
    )


def _rising(densities: NDArray[np.float64]) -> tuple[float, ...]:
    return seven_digits(np.maximum.accumulate(densities))
