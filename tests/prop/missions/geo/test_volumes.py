"""Volumes of air: any places in two volumes that do not meet are apart."""

from __future__ import annotations

import itertools
import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.geo.volumes import Volume
from missions.units import GridPoint

FAST = settings(max_examples=150, deadline=None)

points = st.builds(GridPoint, st.floats(-30, 30), st.floats(-30, 30))
heights = st.tuples(st.floats(0, 30), st.floats(0, 12))
volumes = st.builds(
    lambda path, low, stray: Volume(tuple(path), low[0], low[0] + low[1], stray),
    st.lists(points, min_size=1, max_size=4),
    heights,
    st.sampled_from([0.0, 0.0, 3.0]),
)


def sample(volume: Volume, rng: np.random.Generator) -> tuple[float, float, float]:
    legs = list(itertools.pairwise(volume.path)) or [(volume.path[0], volume.path[0])]
    a, b = legs[int(rng.integers(len(legs)))]
    along, turn = float(rng.uniform()), float(rng.uniform(0, math.tau))
    stray_m = volume.stray_m * float(rng.uniform())
    return (
        a.east_m + along * (b.east_m - a.east_m) + stray_m * math.cos(turn),
        a.north_m + along * (b.north_m - a.north_m) + stray_m * math.sin(turn),
        float(rng.uniform(volume.low_m, volume.high_m)),
    )


@FAST
@given(volumes, volumes, st.floats(1, 8), st.integers(0, 2**16))
def test_volumes_that_do_not_meet_hold_no_two_near_places(one, other, distance_m, seed):
    assert one.meets(other, distance_m) == other.meets(one, distance_m)
    if one.meets(other, distance_m):
        return
    rng = np.random.default_rng(seed)
    for _ in range(40):
        assert math.dist(sample(one, rng), sample(other, rng)) >= distance_m - 2e-6


@FAST
@given(volumes, st.floats(0.5, 8))
def test_a_volume_meets_itself(volume, distance_m):
    assert volume.meets(volume, distance_m)
