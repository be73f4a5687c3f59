"""The level ground that a picture shows, north up, in gray levels without light and shade."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.geo.footprint import Optics
from vision.projection import Frame

NOTHING: Final = -128
"""Value of a pixel that the picture does not show."""
STEPS: Final = 40.0
"""Stored values in one unit of contrast."""

_RESOLUTIONS_M: Final = (0.05, 0.1, 0.2, 0.4)
_WANTED_PX: Final = 75.0  # along the shorter side of a footprint
_REACH_HEIGHTS: Final = 2.0  # maximum distance from below the camera: beyond, the view is too flat
_WINDOW_PX: Final = 15  # light changes over more pixels of the raster than these
_MIN_CONTRAST: Final = 2.0  # gray levels; a smaller difference counts as noise
_FEW: Final = 4  # one pixel in a row out of this number gives the shading


@dataclass(frozen=True, slots=True)
class Patch:
    """Level ground of one picture, as a raster around the place below the camera.

    `values` are int8, row by row from the north: contrast to the surroundings in 1/40 of the local
    deviation, or `NOTHING`. The centre of the first pixel lies `west_px` pixels east (a negative
    number) and `north_px` pixels north of the place below the camera.
    """

    values: NDArray[np.int8]
    west_px: int
    north_px: int
    metres_per_pixel: float


def resolution_m(camera: Optics, height_m: float) -> float:
    """Return the pixel size of a patch, metres, for this height: fine enough, and not finer.

    >>> resolution_m(Optics(math.radians(80.0), 640, 480), 12.0)
    0.2
    """
    wanted = camera.footprint(max(height_m, 0.1)).short_m / _WANTED_PX
    return min(_RESOLUTIONS_M, key=lambda m: abs(math.log(m / wanted)))


def patch(
    frame: Frame, *, metres_per_pixel: float | None = None, up_rad: float = 0.0
) -> Patch | None:
    """Return the ground that a picture shows; None on the ground, or near the horizon.

    Args:
        metres_per_pixel: Pixel size of the raster, above 0; by default `resolution_m` of the
            height. Patches match only with equal pixels.
        up_rad: True bearing of the raster's upper edge: 0, or `Grid.convergence_rad` for a grid's
            axes.
    """
    pose, camera = frame.pose, frame.camera
    if pose.height_m <= 0.0:
        return None
    pitch_m = metres_per_pixel or resolution_m(camera, pose.height_m)
    cos, sin = math.cos(up_rad), math.sin(up_rad)
    ned_of_ground = np.array([[-sin, cos, 0.0], [cos, sin, 0.0], [0.0, 0.0, pose.height_m]])
    matrix = camera.pixels_of_ned(pose) @ ned_of_ground
    box = _box(camera, matrix, pose.height_m, pitch_m)
    if box is None:
        return None
    west, south, east, north = box
    small, pixels_of_raster = _shrunk(frame, pitch_m)
    to_ground = np.array(
        [[pitch_m, 0.0, west * pitch_m], [0.0, -pitch_m, north * pitch_m], [0.0, 0.0, 1.0]]
    )
    size = (east - west + 1, north - south + 1)
    to_pixel = pixels_of_raster @ matrix @ to_ground
    inverse = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    gray = cv2.warpPerspective(small, to_pixel, size, flags=inverse).astype(np.float32)
    whole = np.full(small.shape, 255, np.uint8)
    seen = cv2.warpPerspective(whole, to_pixel, size, flags=inverse) == 255
    return Patch(_without_light(gray, seen), west, north, pitch_m)


def _box(
    camera: Optics, matrix: NDArray[np.float64], height_m: float, pitch_m: float
) -> tuple[int, int, int, int] | None:
    """Return west, south, east and north of the visible ground, in pixels of the raster."""
    right, low = camera.width_px - 1.0, camera.height_px - 1.0
    corners = np.array([[0.0, right, right, 0.0], [0.0, 0.0, low, low], [1.0] * 4])
    ground = np.linalg.solve(matrix, corners)
    if not bool((ground[2] > 0.0).all()):
        return None  # a corner shows the sky
    places = np.clip(ground[:2] / ground[2], -_REACH_HEIGHTS * height_m, _REACH_HEIGHTS * height_m)
    west, south = (math.ceil(c) for c in places.min(axis=1) / pitch_m)
    east, north = (math.floor(c) for c in places.max(axis=1) / pitch_m)
    return (west, south, east, north) if east > west and north > south else None


def _shrunk(frame: Frame, pitch_m: float) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """Return the gray picture, as small as the raster allows, and the matrix to its pixels."""
    camera = frame.camera
    factor = max(1, math.floor(pitch_m / camera.gsd_m(frame.pose.height_m)))
    rows, columns = camera.height_px // factor, camera.width_px // factor
    image = frame.image[: rows * factor, : columns * factor]
    gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    small = cv2.resize(gray, (columns, rows), interpolation=cv2.INTER_AREA)
    offset = (1.0 / factor - 1.0) / 2.0  # pixel 0 is a centre in both
    scaled = np.array([[1 / factor, 0.0, offset], [0.0, 1 / factor, offset], [0.0, 0.0, 1.0]])
    return np.asarray(small, dtype=np.uint8), scaled


def _without_light(gray: NDArray[np.float32], seen: NDArray[np.bool_]) -> NDArray[np.int8]:
    """Return the contrast to the surroundings, divided by its deviation there."""
    window = (_WINDOW_PX, _WINDOW_PX)

    def around(values: NDArray[np.floating]) -> NDArray[np.float32]:
        mean = cv2.boxFilter(values, cv2.CV_32F, window, borderType=cv2.BORDER_CONSTANT)
        return np.asarray(mean, dtype=np.float32)

    gray = gray - _shading(gray, seen)
    there = seen.astype(np.float32)
    share = np.maximum(around(there), np.float32(1e-3))
    contrast = (gray - around(gray * there) / share) * there
    spread = np.sqrt(np.maximum(around(contrast * contrast) / share, np.float32(0.0)))
    steps = contrast * (np.float32(STEPS) / (spread + np.float32(_MIN_CONTRAST)))
    values = np.clip(np.rint(steps), NOTHING + 1, 127).astype(np.int8)
    values[~seen] = NOTHING
    return values


def _shading(gray: NDArray[np.float32], seen: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Fit a paraboloid: local means at the rim of the picture would leave the lens's shading."""
    rows, columns = gray.shape
    y = np.linspace(-1.0, 1.0, rows, dtype=np.float32)[:, None]
    x = np.linspace(-1.0, 1.0, columns, dtype=np.float32)[None, :]
    few = (slice(None, None, _FEW), slice(None, None, _FEW))
    there = seen[few]
    terms = [np.broadcast_to(t, gray.shape)[few][there] for t in (x, y, x * x, x * y, y * y)]
    terms.append(np.ones_like(terms[0]))
    if len(terms[0]) < 2 * len(terms):
        return np.zeros_like(gray)
    basis = np.stack(terms, axis=1)
    a, b, c, d, e, f = np.linalg.lstsq(basis, gray[few][there], rcond=None)[0]
    return np.asarray((a + c * x + d * y) * x + (b + e * y) * y + f, dtype=np.float32)


def side_m(patch: Patch) -> float:
    """Return the side of a square with the area of a patch's visible ground.

    >>> side_m(Patch(np.ones((30, 30), np.int8), 0, 0, 0.5))
    15.0
    """
    return math.sqrt(np.count_nonzero(patch.values != NOTHING)) * patch.metres_per_pixel


def overlaps(
    patch: Patch, others: Iterable[Patch], sides_m: Iterable[float], away_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the share of a patch that each of the others covers, as squares, 0 to 1.

    Args:
        others: Other patches; those with different pixels cover nothing.
        sides_m: Their `side_m`.
        away_m: Offsets of their cameras from the patch's, east and north, shape (n, 2).
    """
    side = np.minimum(np.array(list(sides_m)), side_m(patch))
    alike = np.array([other.metres_per_pixel == patch.metres_per_pixel for other in others])
    free = np.maximum(0.0, 1.0 - np.abs(away_m) / side[:, None])
    return np.asarray(free[:, 0] * free[:, 1] * alike, dtype=np.float64)


def mosaic(
    patches: Iterable[tuple[Patch, tuple[float, float]]], reach_m: float, metres_per_pixel: float
) -> Patch:
    """Return one patch of many; the first patch that shows a place gives its value.

    Args:
        patches: Patches with the positions of their cameras, metres east and north of the
            mosaic's middle.
        reach_m: Distance of each edge from its middle, above 0.
        metres_per_pixel: Pixel size of all patches.
    """
    reach = math.ceil(reach_m / metres_per_pixel)
    size = 2 * reach + 1
    values = np.full((size, size), NOTHING, np.int8)
    for patch, (east_m, north_m) in patches:
        left = reach + patch.west_px + round(east_m / metres_per_pixel)
        top = reach - patch.north_px - round(north_m / metres_per_pixel)
        rows, columns = patch.values.shape
        inside = (
            slice(max(0, top), max(0, top + rows)),
            slice(max(0, left), max(0, left + columns)),
        )
        under = values[inside]
        if under.size == 0:
            continue
        first = max(0, -top), max(0, -left)
        upper = patch.values[
            first[0] : first[0] + under.shape[0], first[1] : first[1] + under.shape[1]
        ]
        values[inside] = np.where(under == NOTHING, upper, under)
    return Patch(values, -reach, reach, metres_per_pixel)


def coarser(patch: Patch) -> Patch:
    """Return the same ground with pixels twice as large.

    >>> fine = Patch(np.ones((7, 9), np.int8), -3, 2, 0.2)
    >>> half = coarser(fine)
    >>> half.values.shape, half.west_px, half.north_px, half.metres_per_pixel
    ((4, 4), -1, 1, 0.4)
    """
    seen = (patch.values != NOTHING).astype(np.float32)
    around = cv2.boxFilter(seen, cv2.CV_32F, (3, 3), borderType=cv2.BORDER_CONSTANT)
    mean = cv2.boxFilter(
        patch.values * seen, cv2.CV_32F, (3, 3), borderType=cv2.BORDER_CONSTANT
    ) / np.maximum(around, np.float32(1e-3))
    # means have less contrast: they are stretched to the contrast of the values
    mean = mean * np.float32(_spread(patch.values[seen > 0]) / max(_spread(mean[seen > 0]), 1.0))
    values = np.clip(np.rint(mean), NOTHING + 1, 127).astype(np.int8)
    values[seen == 0.0] = NOTHING
    # the place below the camera stays the centre of a pixel
    top, left = patch.north_px % 2, patch.west_px % 2
    return Patch(
        np.ascontiguousarray(values[top::2, left::2]),
        (patch.west_px + left) // 2,
        (patch.north_px - top) // 2,
        2.0 * patch.metres_per_pixel,
    )


def _spread(values: NDArray[np.generic]) -> float:
    return float(np.std(values.astype(np.float32))) if values.size else 0.0
