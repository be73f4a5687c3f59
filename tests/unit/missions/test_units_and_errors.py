"""The vocabulary: neighbours, rotations, and the tree of errors."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions import errors
from missions.units import Cell, Quaternion
from vision.camera import rotation

FAST = settings(max_examples=150, deadline=None)
angles = st.floats(-math.pi, math.pi)


def test_neighbours_go_round_with_the_clock_from_north():
    assert Cell(3, -2).neighbours() == (Cell(3, -1), Cell(4, -2), Cell(3, -3), Cell(2, -2))


# --- rotations -------------------------------------------------------------------------------
def turned(axis: int, angle: float) -> np.ndarray:
    """Return the matrix of a turn about one axis of forward, right, down, written out."""
    cos, sin = math.cos(angle), math.sin(angle)
    matrix = np.eye(3)
    first, second = [(1, 2), (2, 0), (0, 1)][axis]
    matrix[first, first] = matrix[second, second] = cos
    matrix[first, second], matrix[second, first] = -sin, sin
    return matrix


@FAST
@given(angles, angles, angles)
def test_angles_are_applied_yaw_first_then_pitch_then_roll(roll, pitch, yaw):
    expected = turned(2, yaw) @ turned(1, pitch) @ turned(0, roll)
    assert rotation(Quaternion.from_euler(roll, pitch, yaw)) == pytest.approx(expected, abs=1e-12)


# --- errors ----------------------------------------------------------------------------------
ALL = [
    value
    for value in vars(errors).values()
    if isinstance(value, type) and issubclass(value, Exception) and value is not Exception
]


def test_every_error_of_a_user_is_of_one_tree():
    assert len(ALL) >= 11
    assert all(issubclass(kind, errors.UavmapError) for kind in ALL)


def test_leaves_keep_exceptions_of_others():
    interrupt = KeyboardInterrupt()
    assert errors.leaves(BaseExceptionGroup("", [interrupt])) == [interrupt]
