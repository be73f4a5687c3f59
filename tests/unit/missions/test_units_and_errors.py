"""The vocabulary: cells, points, rotations, and the tree of errors."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions import errors
from missions.units import Cell, GridPoint, LatLon, Quaternion
from vision.camera import rotation

FAST = settings(max_examples=150, deadline=None)
cells = st.builds(Cell, st.integers(-99, 99), st.integers(-99, 99))
points = st.builds(GridPoint, st.floats(-999, 999), st.floats(-999, 999))
angles = st.floats(-math.pi, math.pi)


# --- cells -----------------------------------------------------------------------------------
@FAST
@given(cells)
def test_neighbours_are_a_step_away_and_say_the_same_of_each_other(cell: Cell) -> None:
    for near in cell.neighbours():
        assert abs(near.east - cell.east) + abs(near.north - cell.north) == 1
        assert cell in near.neighbours()
    assert len(set(cell.neighbours())) == 4


def test_neighbours_go_round_with_the_clock_from_north() -> None:
    assert Cell(3, -2).neighbours() == (Cell(3, -1), Cell(4, -2), Cell(3, -3), Cell(2, -2))


def test_cells_are_ordered_by_column_and_then_by_row() -> None:
    assert sorted([Cell(1, -5), Cell(0, 9), Cell(1, -6)]) == [Cell(0, 9), Cell(1, -6), Cell(1, -5)]


# --- points ----------------------------------------------------------------------------------
@FAST
@given(points, points, points)
def test_distance_is_one(a: GridPoint, b: GridPoint, c: GridPoint) -> None:
    assert a.distance_to(b) == b.distance_to(a) >= 0.0
    assert a.distance_to(a) == 0.0
    assert a.distance_to(c) <= a.distance_to(b) + b.distance_to(c) + 1e-9


def test_a_position_cannot_be_changed() -> None:
    place = LatLon(48.0, 11.0)
    with pytest.raises(AttributeError):
        place.lat_deg = 0.0  # type: ignore[misc]


# --- rotations -------------------------------------------------------------------------------
@FAST
@given(angles, angles, angles)
def test_rotations_have_unit_length(roll: float, pitch: float, yaw: float) -> None:
    assert math.hypot(*Quaternion.from_euler(roll, pitch, yaw)) == pytest.approx(1.0)


def turned(axis: int, angle: float) -> np.ndarray:
    """A turn about one axis of forward, right, down, written out."""
    cos, sin = math.cos(angle), math.sin(angle)
    matrix = np.eye(3)
    first, second = [(1, 2), (2, 0), (0, 1)][axis]
    matrix[first, first] = matrix[second, second] = cos
    matrix[first, second], matrix[second, first] = -sin, sin
    return matrix


@FAST
@given(angles, angles, angles)
def test_angles_are_applied_yaw_first_then_pitch_then_roll(
    roll: float, pitch: float, yaw: float
) -> None:
    expected = turned(2, yaw) @ turned(1, pitch) @ turned(0, roll)
    assert rotation(Quaternion.from_euler(roll, pitch, yaw)) == pytest.approx(expected, abs=1e-12)


# --- errors ----------------------------------------------------------------------------------
ALL = [
    value
    for value in vars(errors).values()
    if isinstance(value, type) and issubclass(value, Exception) and value is not Exception
]


def test_every_error_of_a_user_is_of_one_tree() -> None:
    assert len(ALL) >= 11
    assert all(issubclass(kind, errors.UavmapError) for kind in ALL)


def test_a_refusal_is_an_error_of_the_link() -> None:
    assert issubclass(errors.CommandRefusedError, errors.LinkError)
    assert not issubclass(errors.ImageError, errors.LinkError)


def test_leaves_of_nested_groups_come_in_order() -> None:
    one, two, three = errors.LinkError("1"), ValueError("2"), errors.ImageError("3")
    group = BaseExceptionGroup("", [one, BaseExceptionGroup("", [two, three])])
    assert errors.leaves(group) == [one, two, three]


def test_leaves_keep_what_is_no_exception_of_ours() -> None:
    interrupt = KeyboardInterrupt()
    assert errors.leaves(BaseExceptionGroup("", [interrupt])) == [interrupt]
