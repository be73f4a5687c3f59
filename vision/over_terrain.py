"""From pixels to cells over ground that is not flat: each cell by its own corners.

A cell's corners are projected with the height of the ground at each; between them a cell is a
plane. So slopes and rises do not move what is seen. Hidden ground is not detected: near the nadir
nothing is hidden that is flatter than the rays are steep.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.geo.grid import Grid
from missions.geo.terrain import Terrain
from missions.units import Cell, Pose
from vision.camera import Camera, pixel_rows
from vision.detectors.interface import Marks

SAMPLES: Final = 32
"""Samples along a cell's side: a share is good to some hundredths."""
_CORNERS: Final = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
_OUTSIDE: Final = 127

Floats = NDArray[np.float64]


class OverTerrain:
    """One picture over a terrain, in the grid's moving frame at the time of its exposure."""

    def __init__(
        self, camera: Camera, pose: Pose, grid: Grid, t_s: float, terrain: Terrain
    ) -> None:
        self._camera, self._grid, self._terrain = camera, grid, terrain
        self._drift = grid.drift_east_m_s * t_s, grid.drift_north_m_s * t_s
        below = grid.fixed(pose.position)
        self._below_m = terrain.height_m(below)
        self._rows = pixel_rows(camera, pose, grid, t_s)

    def project(self, places: Floats) -> tuple[Floats, Floats]:
        """Project ground points (..., 2); as `vision.camera.project`."""
        east, north = places[..., 0], places[..., 1]
        rise = self._terrain.at(east + self._drift[0], north + self._drift[1]) - self._below_m
        # the height of the camera above a point is a column of its own
        homogeneous = np.stack([east, north, np.ones_like(east), rise], axis=-1) @ self._rows.T
        depth = homogeneous[..., 2]
        in_front = np.where(depth > 0.0, depth, np.nan)
        return homogeneous[..., :2] / in_front[..., None], depth

    def shown_whole(self, below: Cell, reach: int, margin_m: float) -> NDArray[np.intp]:
        """Return the cells around `below`, sorted, that lie `margin_m` inside the picture.

        The margin holds at the depth of each corner: seen aslant it is fewer pixels.
        """
        steps = np.arange(-reach, reach + 2) - 0.5
        lattice = np.stack(
            np.meshgrid(steps + below.east, steps + below.north, indexing="ij"), axis=-1
        )
        pixels, depth = self.project(lattice * self._grid.cell_m)
        with np.errstate(divide="ignore", invalid="ignore"):
            margin = margin_m * self._camera.focal_px / depth
            limit = (self._camera.width_px - 0.5, self._camera.height_px - 0.5)
            rim = np.minimum(pixels + 0.5, limit - pixels).min(axis=-1)
            inside = (depth > 0.0) & (rim >= margin)
        whole = inside[:-1, :-1] & inside[1:, :-1] & inside[:-1, 1:] & inside[1:, 1:]
        shown: NDArray[np.intp] = np.argwhere(whole) + (np.array(below) - reach)
        return shown

    def seen_shares(self, marks: Marks, cells: NDArray[np.intp]) -> tuple[Floats, Floats]:
        """Return of each cell the part of what is seen that is ROI, and the part that is seen.

        `marks` is a mask (uint8, 0 and 255) or a probability (float32, 0 to 1). All cells lie in
        front of the camera.
        """
        corners = np.array([self._grid.corners_of(Cell(*cell)) for cell in cells.tolist()])
        pixels, _ = self.project(corners)
        square = (_CORNERS * SAMPLES - 0.5).astype(np.float32)
        shares, parts = np.zeros(len(cells)), np.zeros(len(cells))
        for number, quad in enumerate(pixels.astype(np.float32)):
            to_pixel = cv2.getPerspectiveTransform(square, quad)
            part = cv2.warpPerspective(
                marks,
                to_pixel,
                (SAMPLES, SAMPLES),
                flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP,
                borderMode=cv2.BORDER_CONSTANT,
                borderValue=(_OUTSIDE,),
            )
            inside = part != _OUTSIDE
            seen = int(np.count_nonzero(inside))
            if marks.dtype == np.uint8:
                roi = float(np.count_nonzero(part == 255))
            else:
                roi = float(part.sum(where=inside, dtype=np.float64))
            shares[number] = roi / max(seen, 1)
            parts[number] = seen / (SAMPLES * SAMPLES)
        return shares, parts
