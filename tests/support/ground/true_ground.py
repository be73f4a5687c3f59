"""The ground as the simulator paints it, from straight above, and the offsets of a mosaic."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.flight.state import Setting
from missions.units import GridPoint
from sitl.camera.pinhole import CameraSpec, Shot, ground_to_pixel
from sitl.camera.render import render
from uavmap.runner.simulation import Simulation
from vision.raster import Raster

PATCH_M = 8.0
MIN_RESPONSE = 0.2
"""Minimum response of a match of two patches; below it the match is chance."""
_HFOV_DEG = 40.0
_NODES = 33


def true_ground(setting: Setting, seed: int, raster: Raster) -> NDArray[np.uint8]:
    """Take one picture from far above; return it on a raster, without any code under test."""
    world = Simulation(setting, seed).vehicles[0].world
    side_px = 2 * max(raster.rows, raster.columns)
    camera = CameraSpec(_HFOV_DEG, side_px, side_px, fixed=False)
    side_m = 1.2 * raster.pitch_m * max(raster.rows, raster.columns)
    east = raster.west_m + np.linspace(0.0, raster.columns, _NODES) * raster.pitch_m
    north = raster.north_m - np.linspace(0.0, raster.rows, _NODES) * raster.pitch_m
    plane = np.array(
        [
            [world.plane.to_plane(setting.grid.position(GridPoint(e, n))) for e in east.tolist()]
            for n in north.tolist()
        ]
    )
    middle = plane[_NODES // 2, _NODES // 2]
    height_m = side_m / 2.0 / math.tan(math.radians(_HFOV_DEG) / 2.0)
    shot = Shot(*middle.tolist(), height_m, camera.attitude(0.0, 0.0, 0.0), 0.0, 0)
    image: Any = cv2.imdecode(np.frombuffer(render(world, camera, shot), np.uint8), 1)
    ones = np.ones((*plane.shape[:2], 1))
    seen = np.concatenate([plane - middle, ones], axis=-1) @ ground_to_pixel(camera, shot).T
    pixels = (seen[..., :2] / seen[..., 2:]).astype(np.float32)
    maps = [_between(pixels[..., i], raster) for i in (0, 1)]
    return np.asarray(cv2.remap(image, *maps, cv2.INTER_AREA), np.uint8)


def _between(nodes: NDArray[np.float32], raster: Raster) -> NDArray[np.float32]:
    """Interpolate between the corners of the raster to the middle of each pixel."""
    rows, columns = (
        ((np.arange(side) + 0.5) / side * (_NODES - 1)).astype(np.float32)
        for side in (raster.rows, raster.columns)
    )
    across, down = np.meshgrid(columns, rows)
    return np.asarray(cv2.remap(nodes, across, down, cv2.INTER_LINEAR), np.float32)


def shifts_m(
    image: NDArray[np.uint8], truth: NDArray[np.uint8], pitch_m: float
) -> NDArray[np.float64]:
    """Return the offset of each patch of a mosaic, (rows, columns, 2) east and north, m.

    It is NaN if a part of the patch is unseen, or if the patch has no features. `image` has red,
    green, blue, and 255 for seen pixels.
    """
    side = round(PATCH_M / pitch_m)
    window = cv2.createHanningWindow((side, side), cv2.CV_32F)
    gray = cv2.cvtColor(image, cv2.COLOR_RGBA2GRAY).astype(np.float32)
    true = cv2.cvtColor(truth, cv2.COLOR_BGR2GRAY).astype(np.float32)
    found = np.full((gray.shape[0] // side, gray.shape[1] // side, 2), np.nan)
    for row, column in np.ndindex(found.shape[:2]):
        at = slice(row * side, (row + 1) * side), slice(column * side, (column + 1) * side)
        if (image[at][..., 3] < 255).any():
            continue
        (right, down), response = cv2.phaseCorrelate(
            true[at] - true[at].mean(), gray[at] - gray[at].mean(), window
        )
        if response >= MIN_RESPONSE:
            found[row, column] = right * pitch_m, -down * pitch_m
    return found


def seams_m(shifts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the offsets between neighbouring patches."""
    steps = [np.diff(shifts, axis=axis).reshape(-1, 2) for axis in (0, 1)]
    lengths = np.hypot(*np.concatenate(steps).T)
    return np.asarray(lengths[np.isfinite(lengths)])
