"""A recorded picture laid on the ground: which cells it shows, and how much of each is region."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from missions.geo.grid import Grid
from missions.geo.terrain import Terrain
from missions.units import Cell, Pose
from vision.camera import Camera, project
from vision.detectors.interface import Marks
from vision.look import OBLIQUE_LIMIT, SEEN_SHARE, cells_shown, cells_shown_whole, seen_shares
from vision.over_terrain import OverTerrain
from vision.weighing import HALF_SEEN, weights

_SAMPLES_A_PIXEL: Final = 0.8  # of 25 px some 400 samples: a share is good to a hundredth
_CORNERS: Final = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
Cells = NDArray[np.intp]
"""Columns and rows of cells, shape (n, 2)."""


@dataclass(frozen=True, slots=True)
class Laid:
    """A picture on flat ground, or over a terrain; `pose.height_m` is above the ground below."""

    camera: Camera
    pose: Pose
    t_s: float
    grid: Grid
    terrain: Terrain | None

    def cells(
        self, view: Literal["cross", "all"], margin_m: float, *, partly: bool = False
    ) -> Cells:
        """The cells on which the picture is asked, as `vision.look.look` asks a frame.

        `partly`: under the view "all" also those that reach up to half a cell over its rim.
        """
        if partly and view == "all":
            margin_m -= self.grid.cell_m / 2.0
        if self.terrain is None and view == "all":
            return cells_shown_whole(self.camera, self.pose, self.t_s, self.grid, margin_m)
        if self.terrain is None or self.pose.height_m <= 0.0:
            shown = cells_shown(self.camera, self.pose, self.t_s, self.grid, view, None, margin_m)
            return _array(shown)
        over = self._over(self.terrain)
        below = self.grid.cell_at(self.pose.position, self.t_s)
        if view == "cross":
            return _array(tuple(cell for cell in below.cross() if over.in_front(cell)))
        reach = math.ceil(OBLIQUE_LIMIT * self.pose.height_m / self.grid.cell_m)
        return _array(over.shown_whole(below, reach, margin_m))

    def shares(self, marks: Marks, cells: Cells) -> NDArray[np.float64]:
        """The part of each cell that is marked; -1 for one that is not in the picture."""
        shares, seen = self._seen(marks, cells)
        return np.where(seen >= SEEN_SHARE, shares, -1.0)

    def weighed(
        self, marks: Marks, cells: Cells
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The part of each cell that is marked, and what that weighs (`vision.weighing`).

        -1 for a cell of which not half is in the picture.
        """
        _, seen = found = self._seen(marks, cells)
        middle = cells * self.grid.cell_m
        corners = middle[:, None] + _CORNERS * self.grid.cell_m
        below = self.grid.to_moving(self.grid.fixed(self.pose.position), self.t_s)
        away_m = np.hypot(middle[:, 0] - below.east_m, middle[:, 1] - below.north_m)
        heavy = weights(seen, self.pixels(corners), away_m / self.pose.height_m)
        return _told(*found, heavy), heavy

    def shares_of(
        self, marks: Marks, cells: Cells, heavy: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """The shares of other marks on the same picture, of which the weights are known."""
        return _told(*self._seen(marks, cells), heavy)

    def _seen(self, marks: Marks, cells: Cells) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The part of each cell that is marked, and that is seen."""
        if self.terrain is not None:
            named = tuple(Cell(*cell) for cell in cells.tolist())
            return self._over(self.terrain).seen_shares(marks, named)
        matrix = self.camera.homography(self.pose, self.grid, self.t_s)
        cell_px = self.camera.pixels_per_cell(self.pose.height_m, self.grid.cell_m)
        samples = math.ceil(_SAMPLES_A_PIXEL * cell_px)
        return seen_shares(marks, matrix, self.grid, cells, samples)

    def pixels(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Pixels of ground points in the grid's moving frame; NaN behind the camera."""
        if self.terrain is not None:
            return self._over(self.terrain).project(points)[0]
        return project(self.camera.homography(self.pose, self.grid, self.t_s), points)[0]

    def _over(self, terrain: Terrain) -> OverTerrain:
        return OverTerrain(self.camera, self.pose, self.grid, self.t_s, terrain)


def _told(
    shares: NDArray[np.float64], seen: NDArray[np.float64], heavy: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Shares, and -1 where not half of a cell is seen, or what is seen weighs nothing."""
    return np.where((seen >= HALF_SEEN) & (heavy > 0.0), shares, -1.0)


def _array(cells: tuple[Cell, ...]) -> Cells:
    return np.array(cells, dtype=np.intp).reshape(-1, 2)
