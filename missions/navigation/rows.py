"""Keyframes and links as rows of least squares."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from missions.navigation.network import Links, Steps
from missions.navigation.values import UNEASE_M, ToldErrors

_ANYWHERE_M: Final = 1000.0  # the error of a first keyframe whose satellites are not trusted
_LEAP_M: Final = 100.0  # how far a told position may leap, once links have shown that it did


@dataclass(slots=True)
class Key:
    """A keyframe; `way_m` is along all that was told, from the first one on.

    `leapt`: the told position leapt on the way here, as links have shown.
    """

    t_s: float
    told: complex
    trusted: bool
    way_m: float
    leapt: bool = False


@dataclass(slots=True)
class Tie:
    """A link between two keyframes: new, believed (held), or one that does not fit (suspect)."""

    begin: int
    to: int
    moved: complex
    sigma_m: float
    state: Literal["new", "held", "suspect"] = "new"


def links_of(ties: Sequence[Tie], keys: Mapping[int, Key]) -> Links:
    """The rows of links between keyframes, which are counted in their order."""
    index = {number: k for k, number in enumerate(keys)}
    begin = np.array([index[tie.begin] for tie in ties], np.intp)
    to = np.array([index[tie.to] for tie in ties], np.intp)
    moved = np.array([tie.moved for tie in ties], np.complex128)
    told = np.array([key.told for key in keys.values()], np.complex128)
    variance = np.array([tie.sigma_m**2 for tie in ties], np.float64)
    return Links(begin, to, moved, moved - (told[to] - told[begin]), variance)


def steps_of(keys: Sequence[Key], errors: ToldErrors, trusted_until_s: float) -> Steps:
    """What each error is by itself, or after the one before it.

    Satellites are trusted before `trusted_until_s` at most.
    """
    satellites_m2 = errors.satellites_m**2
    keep, variance = np.zeros(len(keys)), np.full(len(keys), satellites_m2)
    before: Key | None = None
    for k, key in enumerate(keys):
        trusted = key.trusted and key.t_s < trusted_until_s
        if before is None:
            variance[k] = satellites_m2 if trusted else _ANYWHERE_M**2
        elif not trusted:
            keep[k], variance[k] = 1.0, _wander_m2(before, key, errors)
        elif before.trusted and not key.leapt:
            keep[k] = math.exp((before.t_s - key.t_s) / errors.satellites_s)
            variance[k] = satellites_m2 * (1.0 - keep[k] ** 2) + errors.pointing_m**2
        before = key
    return Steps(np.arange(len(keys)), keep, variance)


def _wander_m2(before: Key, key: Key, errors: ToldErrors) -> float:
    """How far the error may go from one keyframe to the next, nobody vouching for it."""
    if key.leapt:
        return _LEAP_M**2
    way_m = key.way_m - before.way_m  # of those in between, which were removed, too
    share = errors.reckoned_share**2 * way_m * max(way_m, errors.reckoned_over_m)
    at_rest = errors.reckoned_m_sqrt_s**2 * (key.t_s - before.t_s)
    return share + at_rest + UNEASE_M**2
