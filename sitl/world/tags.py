"""Markers on top of vehicles, and where all of them are at an instant.

A marker is a square of a dictionary of OpenCV's ArUco module. It lies flat on the vehicle, its
upper edge towards the nose, with a white margin of one module around its black border.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from missions.units import Quaternion

TAG_OVER_FEET_M: Final = 0.3
"""Height of the marker over the vehicle's feet, m."""
DICTIONARIES: Final = (
    "DICT_4X4_50", "DICT_4X4_100", "DICT_4X4_250", "DICT_5X5_50", "DICT_5X5_100",
    "DICT_6X6_50", "DICT_APRILTAG_36h11",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class TagPose:
    """A marker at an instant: its middle in the world's plane, in metres.

    `attitude` turns the vehicle's axes (forward, right, down) to NED; `velocity_m_s` is (east,
    north, up).
    """

    number: int
    east_m: float
    north_m: float
    up_m: float
    attitude: Quaternion
    velocity_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)


class Carriers:
    """The vehicles of a world that carry a marker."""

    def __init__(self) -> None:
        self._where: dict[int, Callable[[float], TagPose]] = {}

    def join(self, number: int, where: Callable[[float], TagPose]) -> None:
        """Add a vehicle; `where(t_s)` gives its marker, at most a step from its own time."""
        self._where[number] = where

    def others(self, number: int, t_s: float) -> tuple[TagPose, ...]:
        """Return the markers of all vehicles but one."""
        return tuple(where(t_s) for other, where in self._where.items() if other != number)


def check_number(dictionary: str, number: int) -> None:
    """Raise `ValueError` for an unknown dictionary, or one without a marker of that number."""
    if dictionary not in DICTIONARIES:
        raise ValueError(f"tag_dictionary {dictionary!r}: there is {', '.join(DICTIONARIES)}")
    last = len(_dictionary(dictionary).bytesList) - 1
    if number > last:
        raise ValueError(
            f"vehicle {number}: {dictionary} has markers up to {last}; take a tag_dictionary with "
            "more, such as DICT_4X4_250"
        )


@lru_cache(maxsize=64)
def modules(dictionary: str, number: int) -> npt.NDArray[np.uint8]:
    """Return a marker with its margin: 1 where a module is white; the first row is the top."""
    check_number(dictionary, number)
    known = _dictionary(dictionary)
    picture = cv2.aruco.generateImageMarker(known, number, known.markerSize + 2)
    return np.pad(np.asarray(picture, dtype=np.uint8) // 255, 1, constant_values=1)


@lru_cache(maxsize=8)
def _dictionary(name: str) -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
