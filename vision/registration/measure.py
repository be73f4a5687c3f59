"""How well pictures agree, by tie points that no fit has seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vision.registration.ground_plane import Cameras, to_ground, to_pixels
from vision.registration.matching import Pair
from vision.registration.views import Floats


def apart_m(cameras: Cameras, pair: Pair) -> Floats:
    """How far apart on the ground two pictures show the held tie points of a pair, metres."""
    return _lengths(
        to_ground(cameras, np.full(len(pair.held), pair.first), pair.held[:, :2])
        - to_ground(cameras, np.full(len(pair.held), pair.second), pair.held[:, 2:])
    )


def transfer_px(cameras: Cameras, pair: Pair) -> Floats:
    """How far from its match a held tie point of the first picture falls in the second, pixels."""
    ground = to_ground(cameras, np.full(len(pair.held), pair.first), pair.held[:, :2])
    return _lengths(
        to_pixels(cameras, np.full(len(pair.held), pair.second), ground) - pair.held[:, 2:]
    )


def joined(parts: Sequence[Floats]) -> Floats:
    """All of the parts, what lies beyond the horizon counted as infinitely far."""
    values = np.concatenate([np.zeros(0), *parts])
    return np.where(np.isfinite(values), values, np.inf)


def _lengths(offsets: Floats) -> Floats:
    lengths: Floats = np.sqrt(np.square(offsets).sum(axis=1))
    return lengths


def pair_medians_px(cameras: Cameras, pairs: Sequence[Pair]) -> Floats:
    """For each pair the median transfer error of all its tie points, pixels."""
    medians = []
    for pair in pairs:
        ground = to_ground(cameras, np.full(len(pair.in_first), pair.first), pair.in_first)
        there = to_pixels(cameras, np.full(len(ground), pair.second), ground)
        medians.append(float(np.median(joined([_lengths(there - pair.in_second)]))))
    return np.array(medians)
