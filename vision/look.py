"""From a picture to verdicts on cells.

The detector works on the raw picture, as in the paper. The camera's homography resamples its mask
onto the grid, which takes out yaw, meridian convergence, tilt and height in one step. Then the
pixels of each cell are counted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from missions.errors import ImageError
from missions.geo.grid import Grid
from missions.geo.terrain import Terrain
from missions.units import Cell, Pose
from vision.camera import Camera
from vision.detectors.interface import Detector, Marks
from vision.projection import Projection


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


@dataclass(frozen=True, slots=True)
class Verdict:
    """The verdict of one frame on one cell.

    `share` is the part of the cell that is ROI, 0 to 1: of its pixels, those in the mask; of a
    calibrated detector, their mean probability.
    """

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
    """Return the verdicts of a frame.

    Args:
        grid: The grid; if it drifts, at `frame.t_s`.
        share: Least part of a cell's pixels that makes it positive, 0 to 1.
        view: `"cross"`: the cell under the camera's *position* and its four neighbours, in the
            order of `Cell.cross` (the paper's). `"all"`: every cell wholly inside the polygon of
            ground that the picture shows, sorted, within `OBLIQUE_LIMIT`; for pictures taken
            without a stop, and recorded ones from high up.
        vantage: Of the view `"cross"`, the cell over which the frame was ordered; by default the
            one under the camera. The pose decides where that cell lies in the picture.
        margin_m: Of the view `"all"`, the least distance of a cell from the rim of that polygon, at
            least 0. It keeps cells wholly in the picture despite such an error of the pose. It does
            not correct the verdict: a cell at the border of the ROI may gain or lose a strip as
            wide as the error, up to error / cell edge of its pixels in each direction.
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
    shares = projection.shares(marks_of(detector, frame.image), wanted, finely=True)
    found = zip(wanted.tolist(), shares.tolist(), strict=True)
    return tuple(Verdict(Cell(*cell), s >= share, s) for cell, s in found if s >= 0.0)


def marks_of(detector: Detector, image: NDArray[np.uint8]) -> Marks:
    """Return what cells' shares are counted from: a calibrated probability, else the mask."""
    return detector.probability(image) if detector.calibrated else detector.mask(image)
