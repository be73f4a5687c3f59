"""From pixels to cells over ground that is not flat: each cell by its own corners.

A cell's corners are projected with the height of the ground at each of them, and between its
corners a cell is taken for a plane. So a slope in a picture, or a rise of the ground from one cell
to the next, does not move what is seen. What a hill hides is not found out: near the nadir nothing
is hidden that is flatter than the rays are steep.
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
"""A cell's side in samples: a share is good to some hundredths."""
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
        """Pixels and depths of ground points, (..., 2) and (...); see `vision.camera.project`."""
        east, north = places[..., 0], places[..., 1]
        rise = self._terrain.at(east + self._drift[0], north + self._drift[1]) - self._below_m
        # the height of the camera above a point is a column of its own
        homogeneous = np.stack([east, north, np.ones_like(east), rise], axis=-1) @ self._rows.T
        depth = homogeneous[..., 2]
        in_front = np.where(depth > 0.0, depth, np.nan)
        return homogeneous[..., :2] / in_front[..., None], depth

    def in_front(self, cell: Cell) -> bool:
        """Whether all of a cell lies in front of the camera."""
        _, depth = self.project(np.array(self._grid.corners_of(cell)))
        return bool((depth > 0.0).all())

    def shown_whole(self, below: Cell, reach: int, margin_m: float) -> tuple[Cell, ...]:
        """The cells around `below`, sorted, all of whose corners are so far inside the picture.

        The margin is reckoned at the depth of each corner: seen aslant it is fewer pixels.
        """
        steps = np.arange(-reach, reach + 2) - 0.5
        lattice = np.stack(
            np.meshgrid(steps + below.east, steps + below.north, indexing="ij"), axis=-1
        )
        pixels, depth = self.project(lattice * self._grid.cell_m)
        with np.errstate(divide="ignore", invalid="ignore"):
            margin = margin_m * self._camera.focal_px / depth
            inside = (depth > 0.0) & (
                np.minimum(
                    np.minimum(pixels[..., 0] + 0.5, self._camera.width_px - 0.5 - pixels[..., 0]),
                    np.minimum(pixels[..., 1] + 0.5, self._camera.height_px - 0.5 - pixels[..., 1]),
                )
                >= margin
            )
        whole = inside[:-1, :-1] & inside[1:, :-1] & inside[:-1, 1:] & inside[1:, 1:]
        return tuple(
            Cell(below.east - reach + int(i), below.north - reach + int(j))
            for i, j in np.argwhere(whole)
        )

    def shares(
        self,
        marks: Marks,
        cells: tuple[Cell, ...],
        seen_share: float,
    ) -> list[float]:
        """The part of each cell that is ROI; -1 for a cell too little of which is in the picture.

        The arguments are those of `seen_shares`.
        """
        shares, seen = self.seen_shares(marks, cells)
        found: list[float] = np.where(seen >= seen_share, shares, -1.0).tolist()
        return found

    def seen_shares(self, marks: Marks, cells: tuple[Cell, ...]) -> tuple[Floats, Floats]:
        """Of each cell the part that is ROI, of what is seen of it, and the part that is seen.

        `marks` is a mask (uint8, 0 and 255) or a probability (float32, 0 to 1). All cells lie
        in front of the camera.
        """
        corners = np.array([self._grid.corners_of(cell) for cell in cells], dtype=np.float64)
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
