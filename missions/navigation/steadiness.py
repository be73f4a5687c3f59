"""How much satellites wander while nothing is wrong with them, by what pictures say of the way."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import takewhile
from typing import Final

import numpy as np

from missions.navigation.network import solve
from missions.navigation.position_error import ToldErrors
from missions.navigation.rows import Key, Tie, knots_of, links_of, sparse_steps_of, turns_of

LATEST_S: Final = 30.0
"""What is newer than this may be a lie that nobody has noticed yet."""

_RATIOS: Final = (0.3, 0.45, 0.7, 1.0, 1.45)  # to what is assumed; without a word said, about 1
_EVERY_S: Final = 10.0  # filters smooth: within seconds all satellites look steady
_SPREAD: Final = 0.7  # of the logarithm of what a receiver may be off from that
_FEWEST: Final = 10
_MOST: Final = 80  # keyframes, the newest of those that count


def learned_m(keys: dict[int, Key], ties: Sequence[Tie], errors: ToldErrors) -> float:
    """The standard deviation of satellites in one direction: at most what is assumed.

    The mean over several that may be, each weighted by how probable it makes what pictures and
    satellites have said. What is too new is left out: else a slow lie would be taken for wander.

    Args:
        keys: Keyframes in their order; those count that come before the first untrusted one.
        ties: Links between them that are believed.
        errors: What is assumed.
    """
    until_s = keys[next(reversed(keys))].t_s - LATEST_S if keys else 0.0
    calm = list(takewhile(lambda item: item[1].trusted and item[1].t_s <= until_s, keys.items()))
    if len(calm) < _FEWEST:
        return errors.satellites_m
    some = dict(calm[-_MOST:])
    among = [tie for tie in ties if tie.begin in some and tie.to in some]
    chain = list(some.values())
    knots = knots_of(chain, errors)
    links, turns = links_of(among, some, knots), turns_of(among, some, knots)
    sigmas_m = np.array(_RATIOS) * errors.satellites_m
    weights = []
    for ratio, sigma_m in zip(_RATIOS, sigmas_m.tolist(), strict=True):
        steps = sparse_steps_of(chain, replace(errors, satellites_m=sigma_m), _EVERY_S)
        found = solve(len(chain), steps, links, turns, weighed=True)
        weights.append(found.evidence - (math.log(ratio) / _SPREAD) ** 2 / 2.0)
    shares = np.exp(np.array(weights) - max(weights))
    sigma_m = math.sqrt(float(shares @ sigmas_m**2) / float(shares.sum()))
    return min(sigma_m, errors.satellites_m)
