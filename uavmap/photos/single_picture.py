"""One picture: where it lies on the grid, and a mission's detector on it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.errors import ImageError
from missions.flight.setting_of import setting_of
from missions.mission.schema import Mission
from missions.units import Cell, GridPoint, LatLon
from uavmap.photos.ground.judging import Judge
from uavmap.photos.sources.picture_record import Picture, Placed, above_ground, credible
from vision.camera import Lens, project
from vision.plausible import implausible
from vision.projection import Frame, Projection, Verdict, marks_of
from vision.upright import UprightSearch

_ROI: Final = (60, 200, 60)
_NOT_ROI: Final = (200, 200, 200)
_MASK: Final = (255, 120, 0)
_BELOW: Final = (0, 0, 255)
_LETTER_PX: Final = 34  # a cell whose edge has fewer pixels gets no number


@dataclass(frozen=True, slots=True)
class Looked:
    """The judgement of one picture.

    Attributes:
        verdicts: By cell, sorted.
        footprint: The ground at its corners, from the upper left clockwise; none if one shows the
            sky.
        doubt: Why a mission would not count it; empty where it would.
    """

    placed: Placed
    frame: Frame
    laid: Projection
    mask: NDArray[np.uint8]
    verdicts: tuple[Verdict, ...]
    footprint: tuple[LatLon, ...]
    doubt: str

    def figures(self) -> dict[str, Any]:
        """Return the figures for programs."""
        picture, pose = self.placed.picture, self.placed.pose
        return {
            "picture": picture.name,
            "position": [pose.position.lat_deg, pose.position.lon_deg],
            "height_m": pose.height_m,
            "yaw_deg": None if picture.yaw_deg is None else picture.yaw_deg.value,
            "pitch_deg": None if picture.pitch_deg is None else picture.pitch_deg.value,
            "hfov_deg": round(float(np.degrees(self.frame.camera.hfov_rad)), 2),
            "gsd_m": round(self.frame.camera.gsd_m(pose.height_m), 4),
            "footprint": [[place.lat_deg, place.lon_deg] for place in self.footprint],
            "roi_share": round(float(np.count_nonzero(self.mask)) / self.mask.size, 4),
            "doubt": self.doubt,
            "cells": [
                {
                    "column": verdict.cell.east,
                    "row": verdict.cell.north,
                    "share": round(verdict.share, 3),
                    "roi": verdict.positive,
                }
                for verdict in self.verdicts
            ],
        }


def look_at(picture: Picture, mission: Mission, lens: Lens | None = None) -> Looked:
    """Return what a mission sees in a picture. Raises `ImageError`: why it can see nothing."""
    (placed,) = credible([picture], mission)
    if isinstance(placed, str):
        raise ImageError(f"{picture.name}: {placed}")
    setting = setting_of(mission)
    placed, grid = replace(placed, pose=above_ground(placed.pose, setting)), setting.grid
    search = UprightSearch(grid, UprightSearch.pitch_for([placed.pose.height_m]))
    judge = Judge.of(mission, grid, search, lens)
    try:
        frame = judge.frame(placed, 0.0)
    except ImageError as error:
        raise ImageError(f"{picture.name}: {error}") from None
    section, laid = mission.detector, judge.laid(frame.camera, placed, 0.0)
    cells = laid.cells(section.view, mission.camera.pose_error_m)
    mask = judge.detector.mask(frame.image)
    marks = marks_of(judge.detector, frame.image) if judge.detector.calibrated else mask
    shares = laid.shares(marks, cells).tolist() if len(cells) else []
    verdicts = tuple(
        Verdict(Cell(*cell), share >= section.share, share)
        for cell, share in zip(cells.tolist(), shares, strict=True)
        if share >= 0.0
    )
    doubt = implausible(frame.image, noiseless=mission.camera.noiseless) or ""
    return Looked(placed, frame, laid, mask, verdicts, _footprint(laid), doubt)


def annotated(looked: Looked) -> NDArray[np.uint8]:
    """Draw the detector's mask as a line, the cells, and each one's share in per cent.

    Shape (rows, columns, 3), blue-green-red.
    """
    image = looked.frame.image.copy()
    edges, _ = cv2.findContours(looked.mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_SIMPLE)
    cv2.drawContours(image, edges, -1, _MASK, 1, cv2.LINE_AA)
    for positive in (False, True):  # the region's cells over their neighbours
        for verdict in looked.verdicts:
            if verdict.positive == positive:
                _draw_cell(image, verdict, looked.laid)
    below = looked.laid.grid.fixed(looked.placed.pose.position)
    (middle,) = looked.laid.pixels(np.array([[below.east_m, below.north_m]]))
    if np.isfinite(middle).all():
        at = (round(float(middle[0])), round(float(middle[1])))
        cv2.drawMarker(image, at, _BELOW, cv2.MARKER_CROSS, 16, 2)
    return image


def _draw_cell(image: NDArray[np.uint8], verdict: Verdict, laid: Projection) -> None:
    pixels = laid.pixels(np.array(laid.grid.corners_of(verdict.cell), dtype=np.float64))
    corners = np.round(pixels).astype(np.int32)
    colour = _ROI if verdict.positive else _NOT_ROI
    cv2.polylines(image, [corners], True, colour, 2 if verdict.positive else 1, cv2.LINE_AA)
    if float(np.hypot(*(pixels[1] - pixels[0]))) >= _LETTER_PX:
        x, y = (round(float(part)) for part in pixels.mean(axis=0))
        text = f"{100 * verdict.share:.0f}"
        cv2.putText(
            image, text, (x - 5 * len(text), y + 5), cv2.FONT_HERSHEY_SIMPLEX, 0.42, colour, 1,
            cv2.LINE_AA,
        )  # fmt: skip


def _footprint(laid: Projection) -> tuple[LatLon, ...]:
    """Return where the corners' rays meet the level of the ground below the camera."""
    grid, matrix = laid.grid, laid.camera.homography(laid.pose, laid.grid, laid.t_s)
    right, low = laid.camera.width_px - 0.5, laid.camera.height_px - 0.5
    corners = np.array([[-0.5, -0.5, 1.0], [right, -0.5, 1.0], [right, low, 1.0], [-0.5, low, 1.0]])
    ground = corners @ np.linalg.inv(matrix).T
    with np.errstate(divide="ignore", invalid="ignore"):
        points = ground[:, :2] / ground[:, 2:]
    _, depth = project(matrix, points)
    if not (np.isfinite(points).all() and (depth > 0.0).all()):
        return ()
    return tuple(grid.position(GridPoint(*point)) for point in points.tolist())
