"""What a bundle adjustment works on: tags, tie points, and a solution."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from vision.registration.ground_plane import Cameras
from vision.registration.matching import Pair
from vision.registration.normal_equations import Normal
from vision.registration.views import Floats, Ints

TIE_SIGMA_PX: Final = 1.0

INDEPENDENT: Final = 12.0
"""Most independent tie points of a pair: all share the errors of relief and lens."""

HEIGHT, YAW, SLOPE = 0, 1, slice(2, 4)
"""The shared unknowns after the focal lengths."""

SHARED: Final = 4
"""How many these are."""


@dataclass
class Tags:
    """What tags say of the views of a net; NaN where nothing."""

    place_m: Floats
    place_sigma_m: Floats
    height_m: Floats
    height_sigma_m: Floats
    yaw_rad: Floats
    yaw_sigma_rad: Floats
    tilt: Floats
    tilt_sigma: Floats
    focal_px: Floats
    focal_sigma: Floats


@dataclass
class Ties:
    """Tie points of all pairs: half of them from first to second, half back."""

    source: Ints
    target: Ints
    in_source: Floats
    in_target: Floats
    pair: Ints
    weight: Floats
    pairs: Ints

    @classmethod
    def of(cls, pairs: Sequence[Pair]) -> Ties:
        """Return the tie points of pairs that are not held apart."""
        source, weight, forth = [], [], []
        for p in pairs:
            count = len(p.in_first)
            first = np.arange(count) % 2 == 0
            forth.append(first)
            source.append(np.where(first, p.first, p.second))
            weight.append(np.full(count, min(1.0, INDEPENDENT / max(count, 1)) / TIE_SIGMA_PX**2))
        ends = np.array([[p.first, p.second] for p in pairs])
        number = np.repeat(np.arange(len(pairs)), [len(p.in_first) for p in pairs])
        swap = np.concatenate(forth)[:, None]
        one = np.concatenate([p.in_first for p in pairs])
        other = np.concatenate([p.in_second for p in pairs])
        begins = np.concatenate(source)
        return cls(
            begins,
            ends.sum(axis=1)[number] - begins,
            np.where(swap, one, other),
            np.where(swap, other, one),
            number,
            np.concatenate(weight),
            ends,
        )


@dataclass
class Solution:
    """The adjusted cameras, and what all of a net have in common.

    Attributes:
        cameras: Over ground that is level in their frame.
        shared: The bias of height tags (a share), of headings (radians), and how steeply the ground
            falls towards east and north (tangents). Sloping ground leans the whole net: a camera
            above `(x, y)` at height `h` has its geotag at `(x, y) + h slope`.
        middle_m: (east, north) around which the net leans.
        cost: The minimised sum, without unit.
        normal: The normal equations at the end.
    """

    cameras: Cameras
    shared: Floats
    middle_m: Floats
    cost: float
    normal: Normal | None = None

    @property
    def slope(self) -> Floats:
        """Of the ground, towards east and north, tangents; positive where it falls."""
        return self.shared[SLOPE]


def huber(size: Floats, limit: float) -> tuple[Floats, Floats]:
    """Return weights and costs of residuals of these sizes."""
    inside = size <= limit
    safe = np.maximum(size, 1e-12)
    weight = np.where(inside, 1.0, limit / safe)
    cost = np.where(inside, 0.5 * size**2, limit * (size - 0.5 * limit))
    return weight, cost
