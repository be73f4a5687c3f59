"""From a picture to verdicts on cells: the eyes of the straight path.

The detector works on the raw picture, as in the paper. Its mask is then resampled onto the grid
through the camera's homography, which turns it by the vehicle's yaw (and the meridian convergence)
and takes out tilt and height in one step; what is left is to count pixels, cell by cell.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.errors import ImageError
from missions.ground.footprint import TOUCH_M
from missions.ground.grid import Grid
from missions.ground.terrain import Terrain
from missions.units import Cell, Pose
from vision.camera import Camera, edges, project
from vision.detectors.interface import Detector
from vision.over_terrain import OverTerrain

SEEN_SHARE = 0.9
"""A cell of which less than this is inside the picture gets no verdict."""

OBLIQUE_LIMIT = 3.0
"""Under the view "all", cells farther from below the camera than this many heights get no verdict:
they are seen at less than 18 degrees, where a metre of height is three metres of ground."""

_SAMPLES = 48  # a cell's side in samples: a share is good to about a hundredth
_BLOCK_SAMPLES = 3072  # the most samples along a side of what is resampled at once
_OUTSIDE = 127  # marks samples past the picture's edge; a mask holds only 0 and 255


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
    matrix = frame.camera.homography(frame.pose, grid, frame.t_s)
    below = grid.cell_at(frame.pose.position, frame.t_s)
    if view == "cross":
        wanted = tuple(c for c in (vantage or below).cross() if _in_front(matrix, grid, c))
    else:
        wanted = _shown_whole(matrix, grid, frame, below, margin_m)
    if not wanted:
        return ()
    shares = _shares(_marks(detector, frame), matrix, grid, wanted)
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
    shares = seen.shares(_marks(detector, frame), wanted, SEEN_SHARE)
    return tuple(Verdict(c, s >= share, s) for c, s in zip(wanted, shares, strict=True) if s >= 0.0)


def _marks(detector: Detector, frame: Frame) -> NDArray[np.uint8] | NDArray[np.float32]:
    """What a cell's share is counted from: a calibrated probability, else the mask."""
    return detector.probability(frame.image) if detector.calibrated else detector.mask(frame.image)


def _in_front(matrix: NDArray[np.float64], grid: Grid, cell: Cell) -> bool:
    _, depth = project(matrix, np.array(grid.corners_of(cell)))
    return bool((depth > 0.0).all())


def _shown_whole(
    matrix: NDArray[np.float64], grid: Grid, frame: Frame, below: Cell, margin_m: float
) -> tuple[Cell, ...]:
    """The cells around `below`, sorted, that lie in the picture, so far from its rim."""
    reach = math.ceil(OBLIQUE_LIMIT * frame.pose.height_m / grid.cell_m)
    steps = np.arange(-reach, reach + 2) - 0.5
    lattice = np.stack(np.meshgrid(steps + below.east, steps + below.north, indexing="ij"), axis=-1)
    normals, offsets = edges(frame.camera, matrix)
    least_m = (lattice * grid.cell_m @ normals.T + offsets).min(axis=-1)
    inside: NDArray[np.bool_] = least_m >= margin_m - TOUCH_M
    whole = inside[:-1, :-1] & inside[1:, :-1] & inside[:-1, 1:] & inside[1:, 1:]
    return tuple(
        Cell(below.east - reach + int(i), below.north - reach + int(j))
        for i, j in np.argwhere(whole)
    )


def _shares(
    marks: NDArray[np.uint8] | NDArray[np.float32],
    matrix: NDArray[np.float64],
    grid: Grid,
    cells: tuple[Cell, ...],
) -> list[float]:
    """The part of each cell that is ROI; -1 for a cell too little of which is in the picture.

    `marks` is a mask (uint8) or a probability (float32).
    """
    west, east = min(c.east for c in cells), max(c.east for c in cells)
    south, north = min(c.north for c in cells), max(c.north for c in cells)
    across, along = east - west + 1, north - south + 1
    samples = max(1, min(_SAMPLES, _BLOCK_SAMPLES // max(across, along)))
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
    by_cell = block.reshape(along, samples, across, samples)
    inside = by_cell != _OUTSIDE
    seen = np.count_nonzero(inside, axis=(1, 3))
    if marks.dtype == np.uint8:
        roi = np.count_nonzero(by_cell == 255, axis=(1, 3)).astype(np.float64)
    else:
        roi = by_cell.sum(axis=(1, 3), where=inside, dtype=np.float64)
    shares = []
    for cell in cells:
        at = (north - cell.north, cell.east - west)
        enough = seen[at] >= SEEN_SHARE * samples * samples
        shares.append(float(roi[at]) / float(seen[at]) if enough else -1.0)
    return shares
