"""From a picture to verdicts on cells: the eyes of the straight path.

The detector works on the raw picture, as in the paper. Its mask is then resampled onto the grid
through the camera's homography, which turns it by the vehicle's yaw (and the meridian convergence)
and takes out tilt and height in one step; what is left is to count pixels, cell by cell.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

from missions.errors import ImageError
from missions.geo.footprint import TOUCH_M
from missions.geo.grid import Grid
from missions.geo.terrain import Terrain
from missions.units import Cell, Pose
from vision.camera import Camera, edges, project
from vision.detectors.interface import Detector, Marks
from vision.over_terrain import OverTerrain

SEEN_SHARE = 0.9
"""A cell of which less than this is inside the picture gets no verdict."""

OBLIQUE_LIMIT = 3.0
"""Under the view "all", cells farther from below the camera than this many heights get no verdict:
they are seen at less than 18 degrees, where a metre of height is three metres of ground."""

_SAMPLES = 48  # a cell's side in samples: a share is good to about a hundredth
_BLOCK_SAMPLES = 3072  # the most samples along a side of what is resampled at once
_OUTSIDE = 127  # marks samples past the picture's edge; a mask holds only 0 and 255
_PACKED = 64  # more than the samples along a cell's side
_MARKS = np.zeros(256, np.uint8)
_MARKS[255], _MARKS[_OUTSIDE] = 1, _PACKED


@dataclass(frozen=True, slots=True)
class Frame:
    """A picture with where, when and with what it was taken.

    `image` is (rows, columns, 3) uint8, blue-green-red, of the size that `camera` says; `t_s` is
    the mission time at which it was taken.
    """

    image: NDArray[np.uint8]
    pose: Pose
    t_s: float
    camera: Camera


@dataclass(frozen=True, slots=True)
class Verdict:
    """What one frame says of one cell; `share` is the part of it that is ROI, 0 to 1: of its
    pixels, those in the mask; of a calibrated detector, their mean probability."""

    cell: Cell
    positive: bool
    share: float


def look(
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
    """The verdicts of a frame.

    Args:
        frame: The picture and its pose.
        grid: The grid; where it drifts, `frame.t_s` says where it is.
        detector: Marks the ROI in the picture.
        share: A cell is positive when at least this part of its pixels is ROI, 0 to 1.
        view: `"cross"`: the cell under the camera's *position* and its four neighbours, in the
            order of `Cell.cross` (the paper's). `"all"`: every cell that lies wholly inside the
            polygon of ground that the picture shows, sorted, within `OBLIQUE_LIMIT`; for pictures
            that are taken without a stop, and recorded ones from high up.
        vantage: Of the view `"cross"`, the cell over which the vehicle was told to take the frame;
            by default the one under the camera. Where that cell lies in the picture, the pose
            says. The view `"all"` goes by the pose alone.
        margin_m: Of the view `"all"`, how far a cell must stay from the rim of that polygon, at
            least 0. With an error of the pose that moves the polygon by no more than this, every
            cell that gets a verdict is in the picture wholly. It does not make the verdict itself
            right: the pixels that are counted for the cell still are those of ground as far off
            as the error, so a cell at the border of the ROI may gain or lose a strip of that
            width, a share of up to error / cell edge of its pixels for each of two directions.
        terrain: The ground, where it is not flat. Heights of poses are above the ground below.

    Returns:
        One verdict a cell. A cell of which less than `SEEN_SHARE` is inside the picture is absent.

    Raises:
        ImageError: the picture is not of the camera's size.
    """
    rows, columns = frame.image.shape[:2]
    if (columns, rows) != (frame.camera.width_px, frame.camera.height_px):
        raise ImageError(
            f"the picture is {columns} x {rows} px, the camera "
            f"{frame.camera.width_px} x {frame.camera.height_px} px"
        )
    if frame.pose.height_m <= 0.0:
        return ()  # from the ground nothing of the ground is seen
    if terrain is not None:
        return _look_over(terrain, frame, grid, detector, share, view, vantage, margin_m)
    wanted = cells_shown(frame.camera, frame.pose, frame.t_s, grid, view, vantage, margin_m)
    if not wanted:
        return ()
    matrix = frame.camera.homography(frame.pose, grid, frame.t_s)
    shares = shares_of(marks_of(detector, frame.image), matrix, grid, wanted)
    return tuple(Verdict(c, s >= share, s) for c, s in zip(wanted, shares, strict=True) if s >= 0.0)


def _look_over(
    terrain: Terrain,
    frame: Frame,
    grid: Grid,
    detector: Detector,
    share: float,
    view: Literal["cross", "all"],
    vantage: Cell | None,
    margin_m: float,
) -> tuple[Verdict, ...]:
    """The verdicts of a frame over ground that is not flat."""
    seen = OverTerrain(frame.camera, frame.pose, grid, frame.t_s, terrain)
    below = grid.cell_at(frame.pose.position, frame.t_s)
    if view == "cross":
        wanted = tuple(c for c in (vantage or below).cross() if seen.in_front(c))
    else:
        reach = math.ceil(OBLIQUE_LIMIT * frame.pose.height_m / grid.cell_m)
        wanted = seen.shown_whole(below, reach, margin_m)
    if not wanted:
        return ()
    shares = seen.shares(marks_of(detector, frame.image), wanted, SEEN_SHARE)
    return tuple(Verdict(c, s >= share, s) for c, s in zip(wanted, shares, strict=True) if s >= 0.0)


def cells_shown(
    camera: Camera,
    pose: Pose,
    t_s: float,
    grid: Grid,
    view: Literal["cross", "all"],
    vantage: Cell | None = None,
    margin_m: float = 0.0,
) -> tuple[Cell, ...]:
    """The cells on which a picture is asked, which its pose alone decides; see `look`."""
    if view == "all":
        shown = cells_shown_whole(camera, pose, t_s, grid, margin_m)
        return tuple(Cell(east, north) for east, north in shown.tolist())
    if pose.height_m <= 0.0:
        return ()  # from the ground nothing of the ground is seen
    matrix = camera.homography(pose, grid, t_s)
    below = grid.cell_at(pose.position, t_s)
    return tuple(c for c in (vantage or below).cross() if _in_front(matrix, grid, c))


def marks_of(detector: Detector, image: NDArray[np.uint8]) -> Marks:
    """What a cell's share is counted from: a calibrated probability, else the mask."""
    return detector.probability(image) if detector.calibrated else detector.mask(image)


def _in_front(matrix: NDArray[np.float64], grid: Grid, cell: Cell) -> bool:
    _, depth = project(matrix, np.array(grid.corners_of(cell)))
    return bool((depth > 0.0).all())


def cells_shown_whole(
    camera: Camera, pose: Pose, t_s: float, grid: Grid, margin_m: float = 0.0
) -> NDArray[np.intp]:
    """The cells of the view "all", sorted, that lie in the picture, so far from its rim.

    Shape (n, 2): columns and rows.
    """
    if pose.height_m <= 0.0:
        return np.empty((0, 2), np.intp)
    matrix = camera.homography(pose, grid, t_s)
    low, high = _window(camera, matrix, grid, pose, t_s)
    columns, rows = (np.arange(low[k], high[k] + 2) - 0.5 for k in (0, 1))
    lattice = np.stack(np.meshgrid(columns, rows, indexing="ij"), axis=-1)
    normals, offsets = edges(camera, matrix)
    least_m = (lattice * grid.cell_m @ normals.T + offsets).min(axis=-1)
    inside: NDArray[np.bool_] = least_m >= margin_m - TOUCH_M
    whole = inside[:-1, :-1] & inside[1:, :-1] & inside[:-1, 1:] & inside[1:, 1:]
    shown: NDArray[np.intp] = np.argwhere(whole) + low
    return shown


def _window(
    camera: Camera, matrix: NDArray[np.float64], grid: Grid, pose: Pose, t_s: float
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The first and last column and row that may be in the picture within `OBLIQUE_LIMIT`."""
    below = np.array(grid.cell_at(pose.position, t_s), dtype=np.intp)
    reach = math.ceil(OBLIQUE_LIMIT * pose.height_m / grid.cell_m)
    right, lower = camera.width_px - 0.5, camera.height_px - 0.5
    corners = np.array([[-0.5, -0.5, 1], [right, -0.5, 1], [right, lower, 1], [-0.5, lower, 1.0]])
    ground = corners @ np.linalg.inv(matrix).T
    scale = ground[:, 2:]
    if not bool((scale > 0.0).all() or (scale < 0.0).all()):
        return below - reach, below + reach  # a corner shows the sky
    places = np.clip(ground[:, :2] / scale / grid.cell_m, below - reach - 1.0, below + reach + 1.0)
    low = np.maximum(np.floor(places.min(axis=0)).astype(np.intp), below - reach)
    high = np.minimum(np.ceil(places.max(axis=0)).astype(np.intp), below + reach)
    return low, np.maximum(high, low)


def shares_of(
    marks: Marks,
    matrix: NDArray[np.float64],
    grid: Grid,
    cells: Sequence[Cell] | NDArray[np.intp],
    most_samples: int = _SAMPLES,
) -> list[float]:
    """The part of each cell that is ROI; -1 for a cell too little of which is in the picture.

    The arguments are those of `seen_shares`.
    """
    shares, seen = seen_shares(marks, matrix, grid, cells, most_samples)
    found: list[float] = np.where(seen >= SEEN_SHARE, shares, -1.0).tolist()
    return found


def seen_shares(
    marks: Marks,
    matrix: NDArray[np.float64],
    grid: Grid,
    cells: Sequence[Cell] | NDArray[np.intp],
    most_samples: int = _SAMPLES,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Of each cell the part that is ROI, of what is seen of it, and the part that is seen.

    Args:
        marks: Of a detector, shape (rows, columns): uint8, 255 where it sees ROI, else 0; or
            float32, a probability from 0 to 1, whose mean is the share.
        matrix: 3 x 3, from `Camera.homography`.
        grid: The grid.
        cells: One at least, or an array of their columns and rows, shape (n, 2).
        most_samples: Along a cell's side. More than it has pixels tell no more.
    """
    columns_rows = np.array(cells, dtype=np.intp).reshape(-1, 2)
    west, south = (int(n) for n in columns_rows.min(axis=0))
    east, north = (int(n) for n in columns_rows.max(axis=0))
    across, along = east - west + 1, north - south + 1
    samples = max(1, min(most_samples, _SAMPLES, _BLOCK_SAMPLES // max(across, along)))
    step_m = grid.cell_m / samples
    ground_of_sample = np.array(
        [
            [step_m, 0.0, (west - 0.5) * grid.cell_m + step_m / 2],
            [0.0, -step_m, (north + 0.5) * grid.cell_m - step_m / 2],
            [0.0, 0.0, 1.0],
        ]
    )
    block = cv2.warpPerspective(
        marks,
        matrix @ ground_of_sample,
        (across * samples, along * samples),
        flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=(_OUTSIDE,),  # no mask and no probability has this value
    )
    roi, outside = _counted(block, samples) if marks.dtype == np.uint8 else _summed(block, samples)
    seen = samples * samples - outside
    at = (north - columns_rows[:, 1], columns_rows[:, 0] - west)
    return roi[at] / np.maximum(seen[at], 1), seen[at] / (samples * samples)


def _counted(block: MatLike, samples: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """How many samples of each cell are ROI, and how many lie past the picture's edge.

    Both in one sum over the rows, which lie side by side in memory: a column of a cell has fewer
    samples than `_PACKED`.
    """
    rows, columns = block.shape[0] // samples, block.shape[1] // samples
    marks = np.asarray(cv2.LUT(block, _MARKS), dtype=np.uint8).reshape(rows, samples, -1)
    tall = np.add.reduce(marks, axis=1, dtype=np.uint16).reshape(rows, columns, samples)
    roi: NDArray[np.intp] = (tall % _PACKED).sum(axis=2, dtype=np.intp)
    outside: NDArray[np.intp] = (tall // _PACKED).sum(axis=2, dtype=np.intp)
    return roi, outside


def _summed(block: MatLike, samples: int) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """The sum of the probabilities in each cell, and how many samples lie past the edge."""
    rows, columns = block.shape[0] // samples, block.shape[1] // samples
    by_cell = np.asarray(block, dtype=np.float32).reshape(rows, samples, columns, samples)
    inside = by_cell != _OUTSIDE
    roi: NDArray[np.float64] = by_cell.sum(axis=(1, 3), where=inside, dtype=np.float64)
    return roi, np.count_nonzero(~inside, axis=(1, 3))
