"""Volumes of air by hand: columns, layers, legs, and the stray of a braking vehicle."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.geo.volumes import Volume
from missions.units import GridPoint

FAST = settings(max_examples=120, deadline=None)
APART_M = 6.0


def volume(*path: tuple[float, float], low_m: float = 12.0, high_m: float | None = None,
          stray_m: float = 0.0) -> Volume:  # fmt: skip
    """Return the volume of a path over ground, by default at one height."""
    places = tuple(GridPoint(*place) for place in path)
    return Volume(places, low_m, low_m if high_m is None else high_m, stray_m)


def column(east_m: float, north_m: float, high_m: float = 18.0) -> Volume:
    return volume((east_m, north_m), low_m=0.0, high_m=high_m)


LEG = volume((-20, 0), (20, 0))
CORNER = volume((-50, 50), (0, 0), (50, 50))
HERE = volume((0, 0))
TWICE = volume((0, 0), (0, 0))
"""A vehicle that hovers at the end of its leg has a path of two equal points."""


@pytest.mark.parametrize(
    ("one", "other", "meets"),
    [
        # a column and a leg: by the distance over ground, also from the ends
        (column(0, 0), LEG, True), (column(0, 5.9), LEG, True), (column(0, 6.1), LEG, False),
        (column(25.9, 0), LEG, True), (column(26.1, 0), LEG, False),
        (column(24.3, 4.3), LEG, False), (column(24.2, 4.2), LEG, True),
        # a column that ends below a layer leaves it free
        (column(0, 0, high_m=6.0), LEG, False), (column(0, 0, high_m=6.1), LEG, True),
        # a leg over another keeps its distance by height
        (volume((0, -20), (0, 20)), LEG, True),
        (volume((0, -20), (0, 20), low_m=6.1), LEG, True),
        (volume((0, -20), (0, 20), low_m=6.0), LEG, False),
        (volume((0, -20), (0, 20), low_m=17.9), LEG, True),
        (volume((0, -20), (0, 20), low_m=18.0), LEG, False),
        # either is enough alone; the diagonal is not taken, which is on the safe side
        (volume((5, 0), low_m=0.0), volume((0, 0), low_m=5.0), True),
        # legs side by side, and legs that cross
        (volume((-20, 7), (20, 7)), LEG, False), (volume((-20, 7), (20, 5)), LEG, True),
        (volume((30, -9), (30, 9)), LEG, False),
        # the whole route is reserved and not its ends only
        (CORNER, volume((0, 5)), True), (CORNER, volume((0, 50)), False),
        (TWICE, volume((5, 0)), True), (TWICE, volume((7, 0)), False),
        # stray adds distance around the path, and no height
        (HERE, volume((8, 0)), False), (volume((0, 0), stray_m=3.0), volume((8, 0)), True),
        (HERE, volume((8, 0), stray_m=3.0), True),
        (volume((0, 0), stray_m=1.5), volume((8, 0), stray_m=1.5), True),
        (volume((0, 0), stray_m=9.0), volume((0, 0), low_m=18.0, stray_m=9.0), False),
    ],
)  # fmt: skip
def test_volumes_nearer_than_a_distance_meet(one, other, meets):
    assert one.meets(other, APART_M) is meets
    assert other.meets(one, APART_M) is meets


def test_low_layers_keep_the_distance_over_ground():
    """A column is 5 m beside a leg, in layers 4.5 m apart: 6 m over ground are still needed."""
    assert column(0.0, 5.0).meets(LEG, 6.0, 4.5)
    assert not HERE.meets(volume((0, 0), low_m=16.5), 6.0, 4.5)
    assert HERE.meets(volume((0, 0), low_m=16.0), 6.0, 4.5)


points = st.builds(GridPoint, st.floats(-40, 40), st.floats(-40, 40))
paths = st.lists(points, min_size=1, max_size=4).map(tuple)
reservations = st.builds(
    lambda path, low, thick, stray: Volume(path, low, low + thick, stray),
    paths, st.floats(0, 30), st.floats(0, 12), st.floats(0, 4),
)  # fmt: skip


@FAST
@given(
    reservations, reservations, st.floats(1, 8), st.floats(0, 6), st.floats(0, 5), st.floats(0, 5)
)
def test_more_distance_or_a_larger_volume_never_releases_air(
    one, other, distance_m, more_m, wider_m, higher_m
):
    larger = Volume(one.path, one.low_m - higher_m, one.high_m + higher_m, one.stray_m + wider_m)
    if one.meets(other, distance_m):
        assert one.meets(other, distance_m + more_m)
        assert larger.meets(other, distance_m)


@FAST
@given(reservations, reservations, st.floats(1, 8), points)
def test_moving_both_changes_nothing(one, other, distance_m, by):
    def moved(volume: Volume) -> Volume:
        path = tuple(GridPoint(p.east_m + by.east_m, p.north_m + by.north_m) for p in volume.path)
        return Volume(path, volume.low_m, volume.high_m, volume.stray_m)

    # away from the edge of the volume, where a rounding may decide
    near = one.meets(other, distance_m - 1e-6)
    if near == one.meets(other, distance_m + 1e-6):
        assert moved(one).meets(moved(other), distance_m) == near


@FAST
@given(st.integers(1, 6), st.floats(4.5, 20), st.floats(2, 40))
def test_layers_a_distance_apart_never_meet(vehicles, layer_m, lowest_m):
    """Vehicles may fly across each other: their layers are apart for any legs."""
    legs = [volume((-50, 0), (50, 0), low_m=lowest_m + i * layer_m) for i in range(vehicles)]
    least_m = min(layer_m, APART_M)
    assert not any(one.meets(other, least_m) for one, other in itertools.combinations(legs, 2))
