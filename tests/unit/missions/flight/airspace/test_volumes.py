"""Claims of air by hand: columns, layers, legs, and what a braking vehicle strays."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.flight.airspace.volumes import Volume, is_free
from missions.units import GridPoint

FAST = settings(max_examples=120, deadline=None)
APART_M = 6.0

ORIGIN = GridPoint(0.0, 0.0)
LEG = Volume((GridPoint(-20.0, 0.0), GridPoint(20.0, 0.0)), 12.0, 12.0)


def column(east_m: float, north_m: float, high_m: float = 18.0) -> Volume:
    return Volume((GridPoint(east_m, north_m),), 0.0, high_m)


def spot(east_m: float, north_m: float, height_m: float, stray_m: float = 0.0) -> Volume:
    return Volume((GridPoint(east_m, north_m),), height_m, height_m, stray_m)


@pytest.mark.parametrize(
    ("east_m", "north_m", "meets"),
    [(0, 0, True), (0, 5.9, True), (0, 6.1, False), (25.9, 0, True), (26.1, 0, False),
     (24.3, 4.3, False), (24.2, 4.2, True)],
)  # fmt: skip
def test_a_column_and_a_leg_meet_by_the_distance_over_ground(
    east_m: float, north_m: float, meets: bool
) -> None:
    assert column(east_m, north_m).meets(LEG, APART_M) is meets


@pytest.mark.parametrize(
    ("height_m", "meets"), [(12, True), (6.1, True), (6.0, False), (17.9, True), (18.0, False)]
)
def test_a_leg_over_another_keeps_its_distance_by_height(height_m: float, meets: bool) -> None:
    over = Volume((GridPoint(0.0, -20.0), GridPoint(0.0, 20.0)), height_m, height_m)
    assert over.meets(LEG, APART_M) is meets


def test_height_and_distance_do_not_add_up() -> None:
    """Either is enough alone; the diagonal is not taken, which is on the safe side."""
    assert spot(5.0, 0.0, 0.0).meets(spot(0.0, 0.0, 5.0), APART_M)
    assert math.hypot(5.0, 5.0) > APART_M


def test_a_column_that_ends_below_a_layer_leaves_it_free() -> None:
    assert not column(0.0, 0.0, high_m=6.0).meets(LEG, APART_M)
    assert column(0.0, 0.0, high_m=6.1).meets(LEG, APART_M)


def test_legs_side_by_side_and_legs_that_cross() -> None:
    def leg(a: tuple[float, float], b: tuple[float, float]) -> Volume:
        return Volume((GridPoint(*a), GridPoint(*b)), 12.0, 12.0)

    assert leg((0, -9), (0, 9)).meets(LEG, APART_M)
    assert not leg((-20, 7), (20, 7)).meets(LEG, APART_M)
    assert leg((-20, 7), (20, 5)).meets(LEG, APART_M)
    assert not leg((30, -9), (30, 9)).meets(LEG, APART_M)


def test_the_whole_route_is_claimed_and_not_its_ends_only() -> None:
    round_a_corner = Volume(
        (GridPoint(-50.0, 50.0), GridPoint(0.0, 0.0), GridPoint(50.0, 50.0)), 12.0, 12.0
    )
    assert round_a_corner.meets(spot(0.0, 5.0, 12.0), APART_M)
    assert not round_a_corner.meets(spot(0.0, 50.0, 12.0), APART_M)


@pytest.mark.parametrize(("one_m", "other_m"), [(3.0, 0.0), (0.0, 3.0), (1.5, 1.5)])
def test_who_strays_claims_more_around_it(one_m: float, other_m: float) -> None:
    gap_m = 8.0
    assert not spot(0, 0, 12).meets(spot(gap_m, 0, 12), APART_M)
    assert spot(0, 0, 12, one_m).meets(spot(gap_m, 0, 12, other_m), APART_M)


def test_straying_does_not_change_heights() -> None:
    assert not spot(0, 0, 12, 9.0).meets(spot(0, 0, 18, 9.0), APART_M)


def test_low_layers_bring_nobody_nearer_over_ground() -> None:
    """A column 5 m beside a leg, layers 4.5 m apart: the claims lie 6 m apart over ground still."""
    assert column(0.0, 5.0).meets(LEG, 6.0, 4.5)
    assert not is_free(LEG, [column(0.0, 5.0)], 6.0, 4.5)
    assert not spot(0.0, 0.0, 12.0).meets(spot(0.0, 0.0, 16.5), 6.0, 4.5)
    assert spot(0.0, 0.0, 12.0).meets(spot(0.0, 0.0, 16.0), 6.0, 4.5)


def test_a_repeated_point_is_a_claim_like_any_other() -> None:
    """Who hovers at the end of its leg has a path of two equal points."""
    twice = Volume((ORIGIN, ORIGIN), 12.0, 12.0)
    assert twice.meets(spot(5.0, 0.0, 12.0), APART_M)
    assert not twice.meets(spot(7.0, 0.0, 12.0), APART_M)


def test_free_is_free_of_all() -> None:
    far, near = column(40.0, 0.0), column(0.0, 3.0)
    assert is_free(LEG, [far], APART_M)
    assert not is_free(LEG, [far, near], APART_M)


points = st.builds(GridPoint, st.floats(-40, 40), st.floats(-40, 40))
paths = st.lists(points, min_size=1, max_size=4).map(tuple)
claims = st.builds(
    lambda path, low, thick, stray: Volume(path, low, low + thick, stray),
    paths, st.floats(0, 30), st.floats(0, 12), st.floats(0, 4),
)  # fmt: skip


@FAST
@given(claims, claims, st.floats(1, 8), st.floats(0, 6))
def test_asking_for_more_distance_never_frees_air(
    one: Volume, other: Volume, distance_m: float, more_m: float
) -> None:
    if one.meets(other, distance_m):
        assert one.meets(other, distance_m + more_m)


@FAST
@given(claims, claims, st.floats(1, 8), st.floats(0, 5), st.floats(0, 5))
def test_a_larger_claim_meets_whatever_the_smaller_did(
    one: Volume, other: Volume, distance_m: float, wider_m: float, higher_m: float
) -> None:
    larger = Volume(one.path, one.low_m - higher_m, one.high_m + higher_m, one.stray_m + wider_m)
    if one.meets(other, distance_m):
        assert larger.meets(other, distance_m)


@FAST
@given(claims, claims, st.floats(1, 8), points)
def test_moving_both_changes_nothing(
    one: Volume, other: Volume, distance_m: float, by: GridPoint
) -> None:
    def moved(volume: Volume) -> Volume:
        path = tuple(GridPoint(p.east_m + by.east_m, p.north_m + by.north_m) for p in volume.path)
        return Volume(path, volume.low_m, volume.high_m, volume.stray_m)

    # away from the edge of the claim, where a rounding may decide
    near = one.meets(other, distance_m - 1e-6)
    if near == one.meets(other, distance_m + 1e-6):
        assert moved(one).meets(moved(other), distance_m) == near


@FAST
@given(st.integers(1, 6), st.floats(4.5, 20), st.floats(2, 40))
def test_layers_a_distance_apart_never_meet(vehicles: int, layer_m: float, lowest_m: float) -> None:
    """What lets vehicles fly across each other: whatever their legs, their layers keep apart."""
    legs = [
        Volume((GridPoint(-50, 0), GridPoint(50, 0)), h, h)
        for h in (lowest_m + i * layer_m for i in range(vehicles))
    ]
    for i, leg in enumerate(legs):
        assert is_free(leg, legs[:i] + legs[i + 1 :], min(layer_m, APART_M))
