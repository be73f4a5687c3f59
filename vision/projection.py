"""From a picture to verdicts: the cells that it shows, and the ROI's share of each.

The detector works on the raw picture, as in the paper. The camera's homography resamples its marks
onto the grid, which takes out yaw, meridian convergence, tilt and height in one step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import starmap
from typing import Final, Literal, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.errors import ImageError
from missions.geo.footprint import TOUCH_M
from missions.geo.grid import Grid
from missions.geo.terrain import Terrain
from missions.units import Cell, Pose
from vision.camera import Camera, edges, project
from vision.cell_shares import MAX_SAMPLES, OUTSIDE, seen_shares
from vision.detectors.interface import UNSURE, Detector, Judgement, Marks, judged

SEEN_SHARE: Final = 0.9
"""Minimum share of a cell inside the picture for a verdict."""

OBLIQUE_LIMIT: Final = 3.0
"""Maximum distance of a cell with a verdict from the point below the camera, in heights.

It applies to the view "all". Beyond it the line of sight is below 18 degrees, where a metre of
height hides three metres of ground.
"""

ENOUGH_PX: Final = 64.0
"""Number of pixels at which a cell weighs half of a perfectly resolved one."""
HALF_SEEN: Final = 0.5
"""Minimum share of a cell in a picture for a vote."""

_SAMPLES_A_PIXEL: Final = 0.8  # of 25 px some 400 samples: a share is good to a hundredth
_SAMPLES_A_PLACE: Final = 1.2  # the same of marks that are coarser than the picture
_TERRAIN_SAMPLES: Final = 32  # the same over a terrain: a share is good to some hundredths
_CORNERS: Final = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])

Floats = NDArray[np.float64]
Cells = NDArray[np.intp]
"""Columns and rows of cells, shape (n, 2)."""


@dataclass(frozen=True)
class Projection:
    """A picture on flat ground, or over a terrain; `pose.height_m` is above the ground below.

    Over a terrain a cell's corners are projected with the height of the ground at each; between
    them a cell is a plane. So slopes and rises do not displace the cells. Hidden ground is not
    detected: near the nadir, ground that is flatter than the rays are steep hides nothing.
    """

    camera: Camera
    pose: Pose
    t_s: float
    grid: Grid
    terrain: Terrain | None

    @cached_property
    def matrix(self) -> Floats:
        """The homography from the plane at the height of the ground below to pixels, 3 x 3."""
        return self.camera.homography(self.pose, self.grid, self.t_s)

    def cells(
        self,
        view: Literal["cross", "all"],
        margin_m: float,
        vantage: Cell | None = None,
        *,
        partly: bool = False,
    ) -> Cells:
        """Return the cells for verdicts; see `vision.projection.judge_frame`.

        `partly`: under the view "all", include cells that reach up to half a cell over its rim.
        """
        if self.pose.height_m <= 0.0:
            return np.empty((0, 2), np.intp)  # at ground level no ground is visible
        below = self.grid.cell_at(self.pose.position, self.t_s)
        if view == "cross":
            cross = (vantage or below).cross()
            _, depth = self.project(np.array([self.grid.corners_of(cell) for cell in cross]))
            return np.array(cross, np.intp)[(depth > 0.0).all(axis=1)]
        if partly:
            margin_m -= self.grid.cell_m / 2.0
        return self._on_plane(margin_m) if self.terrain is None else self._on_terrain(margin_m)

    def shares(self, marks: Marks, cells: Cells, *, finely: bool = False) -> Floats:
        """Return the part of each cell that is marked; -1 for one that is not in the picture.

        `finely`: sample cells at the full rate, however few pixels they have.
        """
        shares, seen = self._seen(marks, cells, finely=finely)
        return np.where(seen >= SEEN_SHARE, shares, -1.0)

    def unsure(self, unfamiliar: NDArray[np.uint8] | None, cells: Cells) -> NDArray[np.bool_]:
        """Return for each cell whether most of it is unlike all that the detector knows."""
        if unfamiliar is None or not len(cells) or not unfamiliar.any():
            return np.zeros(len(cells), np.bool_)
        return self._seen(unfamiliar, cells)[0] >= UNSURE

    def by_class(
        self, classes: NDArray[np.uint8] | None, cells: Cells
    ) -> tuple[tuple[int, ...], Floats]:
        """Return the numbers of the classes in a picture, and their shares of cells, (n, classes).

        `classes`: the number of each pixel's class; 0 for none.
        """
        if classes is None or not len(cells):
            return (), np.zeros((len(cells), 0))
        there = np.flatnonzero(np.bincount(classes.ravel(), minlength=2)[1:]) + 1
        shares = [self._seen(_mask_of(classes, number), cells)[0] for number in there.tolist()]
        return tuple(there.tolist()), np.array(shares).reshape(len(there), len(cells)).T

    def weighed(self, marks: Marks, cells: Cells) -> tuple[Floats, Floats]:
        """Return the part of each cell that is marked, and its weight (`weights`).

        The share is -1 for a cell with less than half in the picture.
        """
        _, seen = found = self._seen(marks, cells)
        middle = cells * self.grid.cell_m
        corners = middle[:, None] + _CORNERS * self.grid.cell_m
        below = self.grid.to_moving(self.grid.fixed(self.pose.position), self.t_s)
        away_m = np.hypot(middle[:, 0] - below.east_m, middle[:, 1] - below.north_m)
        heavy = weights(seen, self.project(corners)[0], away_m / self.pose.height_m)
        return _weighty(*found, heavy), heavy

    def shares_of(self, marks: Marks, cells: Cells, heavy: Floats) -> Floats:
        """Return the shares of other marks on the same picture, whose weights are known."""
        return _weighty(*self._seen(marks, cells), heavy)

    def project(self, points: Floats) -> tuple[Floats, Floats]:
        """Return pixels (..., 2), NaN behind the camera, and depths (...) of ground points."""
        if self.terrain is None:
            return project(self.matrix, points)
        # the rise of the ground over that below the camera has a column of its own
        rows = np.column_stack([self.matrix, -self.camera.pixels_of_ned(self.pose)[:, 2]])
        below_m = self.terrain.height_m(self.grid.fixed(self.pose.position))
        east, north = points[..., 0], points[..., 1]
        drift_east_m = self.grid.drift_east_m_s * self.t_s
        drift_north_m = self.grid.drift_north_m_s * self.t_s
        rise = self.terrain.at(east + drift_east_m, north + drift_north_m) - below_m
        homogeneous = np.stack([east, north, np.ones_like(east), rise], axis=-1) @ rows.T
        depth = homogeneous[..., 2]
        in_front = np.where(depth > 0.0, depth, np.nan)
        return homogeneous[..., :2] / in_front[..., None], depth

    def pixels(self, points: Floats) -> Floats:
        """Return pixels of ground points in the grid's moving frame; NaN behind the camera."""
        return self.project(points)[0]

    def _seen(self, marks: Marks, cells: Cells, *, finely: bool = False) -> tuple[Floats, Floats]:
        """Return for each cell the ROI's share of its visible part, and the visible share."""
        if self.terrain is not None:
            return self._seen_cell_by_cell(marks, cells)
        cell_px = self.camera.pixels_per_cell(self.pose.height_m, self.grid.cell_m)
        right, down = self._places_a_pixel(marks)
        rate = min(_SAMPLES_A_PIXEL, _SAMPLES_A_PLACE * right)
        samples = MAX_SAMPLES if finely and right == 1.0 else math.ceil(rate * cell_px)
        places = np.array(
            [[right, 0.0, (right - 1.0) / 2.0], [0.0, down, (down - 1.0) / 2.0], [0.0, 0.0, 1.0]]
        )
        return seen_shares(marks, places @ self.matrix, self.grid, cells, samples)

    def _places_a_pixel(self, marks: Marks) -> Floats:
        """Return how many places the marks have to a pixel, across and down: 1, or less."""
        return np.divide(marks.shape[::-1], (self.camera.width_px, self.camera.height_px))

    def _seen_cell_by_cell(self, marks: Marks, cells: Cells) -> tuple[Floats, Floats]:
        """Return these shares over a terrain, for cells in front of the camera."""
        corners = np.array([self.grid.corners_of(Cell(*cell)) for cell in cells.tolist()])
        square = ((_CORNERS + 0.5) * _TERRAIN_SAMPLES - 0.5).astype(np.float32)
        shares, parts = np.zeros(len(cells)), np.zeros(len(cells))
        times = self._places_a_pixel(marks)
        quads = self.project(corners)[0] * times + (times - 1.0) / 2.0
        for number, quad in enumerate(quads.astype(np.float32)):
            part = cv2.warpPerspective(
                marks,
                cv2.getPerspectiveTransform(square, quad),
                (_TERRAIN_SAMPLES, _TERRAIN_SAMPLES),
                flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP,
                borderMode=cv2.BORDER_CONSTANT,
                borderValue=(OUTSIDE,),
            )
            inside = part != OUTSIDE
            seen = int(np.count_nonzero(inside))
            if marks.dtype == np.uint8:
                roi = float(np.count_nonzero(part == 255))
            else:
                roi = float(part.sum(where=inside, dtype=np.float64))
            shares[number] = roi / max(seen, 1)
            parts[number] = seen / _TERRAIN_SAMPLES**2
        return shares, parts

    def _on_plane(self, margin_m: float) -> Cells:
        """Return the cells, sorted, at least `margin_m` inside the rim."""
        low, high = self._window()
        normals, offsets = edges(self.camera, self.matrix)
        least_m = (_lattice(low, high) * self.grid.cell_m @ normals.T + offsets).min(axis=-1)
        return _whole(least_m >= margin_m - TOUCH_M) + low

    def _on_terrain(self, margin_m: float) -> Cells:
        """Return these cells over a terrain, with the margin at the depth of each corner."""
        low, high = self._around()
        pixels, depth = self.project(_lattice(low, high) * self.grid.cell_m)
        with np.errstate(divide="ignore", invalid="ignore"):
            margin = margin_m * self.camera.focal_px / depth
            limit = (self.camera.width_px - 0.5, self.camera.height_px - 0.5)
            rim = np.minimum(pixels + 0.5, limit - pixels).min(axis=-1)
            return _whole((depth > 0.0) & (rim >= margin)) + low

    def _around(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return the first and last column and row within `OBLIQUE_LIMIT`."""
        below = np.array(self.grid.cell_at(self.pose.position, self.t_s), dtype=np.intp)
        reach = math.ceil(OBLIQUE_LIMIT * self.pose.height_m / self.grid.cell_m)
        return below - reach, below + reach

    def _window(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return those columns and rows that a picture of a plane may show."""
        first, last = self._around()
        right, lower = self.camera.width_px - 0.5, self.camera.height_px - 0.5
        corners = np.array(
            [[-0.5, -0.5, 1], [right, -0.5, 1], [right, lower, 1], [-0.5, lower, 1.0]]
        )
        ground = corners @ np.linalg.inv(self.matrix).T
        scale = ground[:, 2:]
        if not bool((scale > 0.0).all() or (scale < 0.0).all()):
            return first, last  # a corner shows the sky
        places = np.clip(ground[:, :2] / scale / self.grid.cell_m, first - 1.0, last + 1.0)
        low = np.maximum(np.floor(places.min(axis=0)).astype(np.intp), first)
        high = np.minimum(np.ceil(places.max(axis=0)).astype(np.intp), last)
        return low, np.maximum(high, low)


def _mask_of(classes: NDArray[np.uint8], number: int) -> NDArray[np.uint8]:
    found: NDArray[np.uint8] = (classes == number).view(np.uint8) * np.uint8(255)
    return found


def _lattice(low: NDArray[np.intp], high: NDArray[np.intp]) -> Floats:
    """Return the corners of the cells of a window, (columns + 1, rows + 1, 2), in cells."""
    columns, rows = (np.arange(low[k], high[k] + 2) - 0.5 for k in (0, 1))
    return np.stack(np.meshgrid(columns, rows, indexing="ij"), axis=-1)


def _whole(inside: NDArray[np.bool_]) -> Cells:
    """Return the cells of a lattice of which all corners are inside."""
    return np.argwhere(inside[:-1, :-1] & inside[1:, :-1] & inside[:-1, 1:] & inside[1:, 1:])


def _weighty(shares: Floats, seen: Floats, heavy: Floats) -> Floats:
    """Return shares; -1 for a cell that is less than half visible, or has no weight."""
    return np.where((seen >= HALF_SEEN) & (heavy > 0.0), shares, -1.0)


def weights(seen: Floats, corners_px: Floats, slant: Floats) -> Floats:
    """Return the weight of each cell's vote, shape (n,), a product of three factors, 0 to 1.

    * coverage: the part of the cell that is in the picture;
    * resolution: `n / (n + ENOUGH_PX)` with the cell's `n` pixels; errors of a detector are alike
      in neighbouring pixels, so many pixels add little;
    * obliqueness: the fourth power of the cosine of the angle from straight down. Objects on a cell
      hide it from the side, and each metre of their height displaces it by the angle's tangent.

    Args:
        seen: Part of each cell in the picture, 0 to 1.
        corners_px: Its corners in the picture, shape (n, 4, 2), around it; NaN behind the camera,
            which weighs 0.
        slant: Tangent of the line of sight's angle from straight down.

    >>> square = np.array([[[0, 0], [8, 0], [8, 8], [0, 8]]], float)
    >>> weights(np.array([1.0]), square, np.array([0.0])).tolist()
    [0.5]
    >>> weights(np.array([0.5]), square, np.array([1.0])).tolist()
    [0.0625]
    """
    x, y = corners_px[..., 0], corners_px[..., 1]
    twice = x * np.roll(y, -1, axis=-1) - y * np.roll(x, -1, axis=-1)
    pixels = np.abs(twice.sum(axis=-1)) / 2.0
    resolved = np.where(np.isfinite(pixels), pixels / (pixels + ENOUGH_PX), 0.0)
    found: Floats = seen * resolved / (1.0 + slant * slant) ** 2
    return found


@dataclass(frozen=True, slots=True)
class Frame:
    """A picture with its pose, time and camera.

    `image` is (rows, columns, 3) uint8, blue-green-red, of the camera's size; `t_s` is the mission
    time of the exposure.
    """

    image: NDArray[np.uint8]
    pose: Pose
    t_s: float
    camera: Camera


class Verdict(NamedTuple):
    """The verdict of one frame on one cell.

    `share` is the part of the cell that is ROI, 0 to 1: the share of its pixels in the mask. For a
    calibrated detector it is their mean probability. `unsure`: most of the cell is unlike all that
    the detector knows. `classes`: number and share of each class in it.
    """

    cell: Cell
    positive: bool
    share: float
    unsure: bool = False
    classes: tuple[tuple[int, float], ...] = ()


def judge_frame(
    frame: Frame,
    grid: Grid,
    detector: Detector,
    *,
    share: float,
    view: Literal["cross", "all"],
    vantage: Cell | None = None,
    margin_m: float = 0.0,
    terrain: Terrain | None = None,
) -> tuple[Verdict, ...]:
    """Return the verdicts of a frame.

    Args:
        grid: The grid; if it drifts, at `frame.t_s`.
        share: Minimum part of a cell's pixels that makes it positive, 0 to 1.
        view: `"cross"`: the cell under the camera's *position* and its four neighbours, in the
            order of `Cell.cross` (the paper's). `"all"`: every cell wholly inside the polygon of
            ground that the picture shows, sorted, within `OBLIQUE_LIMIT`. It is for pictures taken
            without a stop, and for recorded ones from high up.
        vantage: The cell over which a frame of the view `"cross"` was ordered; by default the one
            under the camera. The pose decides where that cell lies in the picture.
        margin_m: Minimum distance of a cell from the rim of that polygon under the view `"all"`, at
            least 0. It keeps cells wholly in the picture despite such an error of the pose. It does
            not correct the verdict. A cell at the border of the ROI may gain or lose a strip as
            wide as the error.
        terrain: The ground, where it is not flat. Heights of poses are above the ground below.

    Returns:
        One verdict per cell of which at least `SEEN_SHARE` is inside the picture.

    Raises:
        ImageError: The picture is not of the camera's size.
    """
    rows, columns = frame.image.shape[:2]
    if (columns, rows) != (frame.camera.width_px, frame.camera.height_px):
        raise ImageError(
            f"the picture is {columns} x {rows} px, the camera "
            f"{frame.camera.width_px} x {frame.camera.height_px} px"
        )
    projection = Projection(frame.camera, frame.pose, frame.t_s, grid, terrain)
    wanted = projection.cells(view, margin_m, vantage)
    if not len(wanted):
        return ()
    found = judged(detector, frame.image)
    shares = projection.shares(found.marks, wanted, finely=True)
    return verdicts(projection, found, wanted, shares, share)


def verdicts(
    projection: Projection, found: Judgement, cells: Cells, shares: Floats, least: float
) -> tuple[Verdict, ...]:
    """Return the verdicts on cells, of those that are in the picture.

    Args:
        shares: Share of each cell; -1 for one that is not in the picture.
        least: Share that makes a cell positive.
    """
    unsure = projection.unsure(found.unfamiliar, cells)
    numbers, parts = projection.by_class(found.classes, cells)
    seen = np.flatnonzero(shares >= 0.0)
    classes: list[tuple[tuple[int, float], ...]] = [()] * len(seen)
    if numbers:
        classes = [
            tuple((n, p) for n, p in zip(numbers, part, strict=True) if p > 0.0)
            for part in parts[seen].tolist()
        ]
    return tuple(
        map(
            Verdict, starmap(Cell, cells[seen].tolist()), (shares >= least)[seen].tolist(),
            shares[seen].tolist(), unsure[seen].tolist(), classes,
        )
    )  # fmt: skip
