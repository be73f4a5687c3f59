"""Familiarity of a pixel: its likeness to the painted examples.

A classifier divides the whole space of features, also where no example lies, and is sure of itself
there. So a mixture of Gaussians of colour and texture describes the painted places of each kind,
region and surround. A pixel is compared with the kind that the classifier assigns to it. Bare soil
may be unlike every painted road, and yet less unlike road than lawn.

The density at a pixel becomes a familiarity between 0 and 1: the share of places of *other* painted
pictures that are less dense. It is measured on each picture by mixtures that have not seen it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from vision.detectors.pixel_features import GROUPS

NAMES: Final = GROUPS["color"] + GROUPS["texture"]
"""The features that are compared; surroundings differ too much from picture to picture."""
QUANTILES: Final = (0.0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0)
"""Familiarities at which the density is stored."""

Array = NDArray[np.float32]
_Number = Annotated[float, Field(allow_inf_nan=False)]
_Row = Annotated[tuple[_Number, ...], Field(min_length=len(NAMES), max_length=len(NAMES))]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Gaussian(_Part):
    """A normal distribution of standardised features, with its weight in the mixture.

    `whitening` is the factor W of the inverse covariance W W^T, column by column.
    """

    weight: Annotated[_Number, Field(gt=0, le=1)]
    mean: _Row
    whitening: Annotated[tuple[_Row, ...], Field(min_length=len(NAMES), max_length=len(NAMES))]


class Kind(_Part):
    """One kind of ground, region or surround: its places, and the density of others' places.

    `densities` are the logarithms at `QUANTILES`, rising.
    """

    gaussians: Annotated[tuple[Gaussian, ...], Field(min_length=1, max_length=16)]
    densities: Annotated[
        tuple[_Number, ...], Field(min_length=len(QUANTILES), max_length=len(QUANTILES))
    ]


class Familiarity(_Part):
    """The painted ground: mean and scale of the features `NAMES`, and both kinds."""

    mean: _Row
    scale: Annotated[tuple[Annotated[_Number, Field(gt=0)], ...], Field(min_length=len(NAMES))]
    region: Kind
    surround: Kind

    @model_validator(mode="after")
    def _rises(self) -> Familiarity:
        for kind in (self.region, self.surround):
            if list(kind.densities) != sorted(kind.densities):
                raise ValueError("the densities of familiar places do not rise")
        return self


@dataclass(frozen=True, slots=True)
class Comparison:
    """Comparison of places with one kind of ground; `mean` and `scale` standardise features."""

    kind: Kind
    mean: Array
    scale: Array
    _whitening: Array = field(init=False, repr=False)
    """Factors of all Gaussians side by side, (`NAMES`, Gaussians * `NAMES`), for raw features."""
    _middle: Array = field(init=False, repr=False)
    _peak: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        parts = self.kind.gaussians
        factors = [np.array(part.whitening, np.float64).T for part in parts]
        raw = np.hstack([factor / self.scale[:, None] for factor in factors])
        means = [self.scale * np.array(part.mean) + self.mean for part in parts]
        middle = np.hstack(
            [mean @ (f / self.scale[:, None]) for mean, f in zip(means, factors, strict=True)]
        )
        peak = [
            math.log(part.weight) + float(np.log(np.abs(np.diag(factor))).sum())
            for part, factor in zip(parts, factors, strict=True)
        ]
        for name, value in (("_whitening", raw), ("_middle", middle), ("_peak", np.array(peak))):
            object.__setattr__(self, name, value.astype(np.float32))

    def density(self, values: Array) -> Array:
        """Return the logarithm of the density of the nearest Gaussian at features (`NAMES`, n)."""
        away = self._whitening.T @ values
        away -= self._middle[:, None]
        away *= away
        squares = away.reshape(len(self._peak), len(NAMES), -1).sum(axis=1)
        return np.asarray((self._peak[:, None] - 0.5 * squares).max(axis=0), np.float32)

    def familiarity(self, values: Array) -> Array:
        """Return the familiarity, (n,), 0 to 1, of features (`NAMES`, n)."""
        found = np.interp(self.density(values), self.kind.densities, QUANTILES)
        return np.asarray(found, np.float32)


@dataclass(frozen=True, slots=True)
class Familiar:
    """A familiarity with its tables."""

    region: Comparison
    surround: Comparison

    @classmethod
    def from_model(cls, familiarity: Familiarity) -> Familiar:
        """Make it from the familiarity of a model's file."""
        scaled = (np.array(familiarity.mean, np.float32), np.array(familiarity.scale, np.float32))
        return cls(
            Comparison(familiarity.region, *scaled), Comparison(familiarity.surround, *scaled)
        )

    def standardised(self, values: Array) -> Array:
        """Return features (`NAMES`, n) in units of their usual spread, (n, `NAMES`)."""
        return (values.T - self.region.mean) / self.region.scale

    def familiarity(self, values: Array, region: NDArray[np.bool_]) -> Array:
        """Return the familiarity of places, (n,), 0 to 1.

        Args:
            values: Features, (`NAMES`, n).
            region: True for places that are taken for region, (n,).
        """
        found = np.empty(len(region), np.float32)
        for kind, places in ((self.region, region), (self.surround, ~region)):
            found[places] = kind.familiarity(values[:, places])
        return found
