"""The judgement of one recorded picture: decoded, checked for plausibility, and classified.

A `Judge` needs no order and keeps nothing, so any number of threads may use it. Results that depend
on other pictures (repeated, upside down, blurred) are returned as numbers. `inspect_picture` judges
a single picture, with its place on the grid.
"""

from __future__ import annotations

import hashlib
import math
import zlib
from dataclasses import dataclass, replace
from struct import Struct
from typing import Any, Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.errors import ImageError
from missions.flight.setting_of import setting_of
from missions.geo.grid import Grid
from missions.mission.schema import Mission
from missions.units import Cell, GridPoint, LatLon
from uavmap.aircraft.imaging.classifier import detector_of
from uavmap.photos.registration.calibration import Lenses
from uavmap.photos.scratch_file import StoredJudgement
from uavmap.photos.sources.photo_file import eight_bits
from uavmap.photos.sources.picture_record import Picture, Placed, above_ground, credible
from vision.camera import Camera, Lens, project
from vision.detectors import Detector
from vision.detectors.interface import Marks, judged
from vision.plausible import implausible
from vision.projection import Cells, Frame, Projection, Verdict, verdicts
from vision.upright import Patch, UprightSearch

MIN_WIDTH_PX: Final = 64
MIN_PIXELS_A_CELL: Final = 8.0
"""Minimum pixels along a cell's edge for a vote."""
WHITE_SHARE: Final = 0.6
"""Minimum share of white pixels of an over-exposed picture."""
DARK_SHARE: Final = 0.95
_WHITE, _DARK = 250, 12
_EVERY = 12  # measures of a whole picture use one row out of this number

_SHAPE: Final = Struct("<II")  # rows and columns of packed marks

MINIATURE_PX: Final = 250
"""Columns of the picture that is kept for the background of the map."""

WHOLE_AREA: Final = Cell(0, 0)
"""Vantage of all pictures under the view "all": one observation of the whole area."""


@dataclass(frozen=True, slots=True)
class JudgedPicture:
    """The judgement of a picture as it is stored; `stored` goes to the spool.

    Equal pictures have equal `fingerprint`s. `sharpness` is the finest detail relative to the
    contrast, at the judged size.
    """

    stored: StoredJudgement
    camera: Camera
    patch: Patch | None
    fingerprint: bytes
    sharpness: float


class Task(NamedTuple):
    """A picture to be judged, and the mission time of its exposure."""

    placed: Placed
    t_s: float


@dataclass(frozen=True, slots=True)
class Judge:
    """Judges the pictures of a replay; with `compare` it also searches for upside-down ones."""

    mission: Mission
    grid: Grid
    detector: Detector
    search: UprightSearch
    lenses: Lenses
    compare: bool = True

    @classmethod
    def for_mission(
        cls, mission: Mission, grid: Grid, search: UprightSearch, lens: Lens | None
    ) -> Judge:
        """Return the judge for a mission file; `lens` is a calibration."""
        lenses = Lenses(mission.camera.hfov_deg, lens)
        return cls(mission, grid, detector_of(mission), search, lenses)

    def __reduce__(self) -> tuple[object, ...]:
        search = UprightSearch(self.grid, self.search.pitch_m)
        made = (self.mission, self.grid, self.detector, search, self.lenses, self.compare)
        return Judge, made

    def judge(self, task: Task) -> JudgedPicture | str:
        """Return a picture's judgement, or the reason why it is no evidence."""
        try:
            return self._judged(*task)
        except ImageError as error:
            return str(error)

    def _judged(self, placed: Placed, t_s: float) -> JudgedPicture:
        frame = self.frame(placed, t_s)
        projection = self.projection(frame.camera, placed, t_s)
        vantage, cells = self._visible_cells(projection)
        some = np.ascontiguousarray(frame.image[::_EVERY])  # noise is in every row
        self._refuse_implausible(some)
        found = judged(self.detector, frame.image)
        unfamiliar = found.unfamiliar
        if self.mission.by_evidence:
            shares, weights = projection.weighed(found.marks, cells)
        else:
            shares, weights = projection.shares(found.marks, cells), np.ones(len(cells))
        stored = StoredJudgement(
            vantage, cells, shares, packed(found.marks), weights, miniature(frame.image),
            projection.unsure(unfamiliar, cells), b"" if unfamiliar is None else packed(unfamiliar),
            found.unlike, *projection.by_class(found.classes, cells),
            b"" if found.classes is None else packed_levels(found.classes),
        )  # fmt: skip
        return JudgedPicture(
            stored,
            frame.camera,
            self.search.patch(frame) if self.compare else None,
            hashlib.blake2b(some.data, digest_size=16).digest(),
            sharpness(frame.image),
        )

    def turned(
        self, placed: Placed, t_s: float, camera: Camera, stored: StoredJudgement
    ) -> StoredJudgement:
        """Return the judgement of a picture that is stored upside down; its weights stay."""
        upright = unpacked(stored.marks, upside_down=True)
        projection = self.projection(camera, placed, t_s)
        if self.mission.by_evidence:
            shares = projection.shares_of(upright, stored.cells, stored.weights)
        else:
            shares = projection.shares(upright, stored.cells)
        if stored.class_marks:
            classes = unpacked_levels(stored.class_marks, upside_down=True)
            numbers, parts = projection.by_class(classes, stored.cells)
            stored = stored._replace(numbers=numbers, classes=parts)
        if not stored.unfamiliar:
            return stored._replace(shares=shares)
        unfamiliar = unpacked(stored.unfamiliar, upside_down=True)
        unsure = projection.unsure(np.asarray(unfamiliar, np.uint8), stored.cells)
        return stored._replace(shares=shares, unsure=unsure)

    def projection(self, camera: Camera, placed: Placed, t_s: float) -> Projection:
        """Return the projection of the picture onto the mission's ground."""
        return Projection(camera, placed.pose, t_s, self.grid, self.mission.ground)

    def frame(self, placed: Placed, t_s: float, most_width_px: int | None = None) -> Frame:
        """Return a picture as a pinhole shows it, at the mission's or another width at most."""
        picture, width_px = placed.picture, most_width_px or self.mission.camera.width_px
        if min(picture.width_px, picture.height_px) < MIN_WIDTH_PX // 2 or (
            picture.width_px < MIN_WIDTH_PX
        ):
            raise ImageError(f"{picture.width_px} x {picture.height_px} px are too few")
        image = eight_bits(picture.content.decode(width_px))
        image, camera = self.lenses.straightened(image, self.lenses.lens(picture))
        return Frame(image, placed.pose, t_s, camera)

    def _visible_cells(self, projection: Projection) -> tuple[Cell, Cells]:
        """Return the vantage, and the cells in the picture."""
        pose = projection.pose
        cell_px = projection.camera.pixels_per_cell(pose.height_m, self.grid.cell_m)
        if cell_px < MIN_PIXELS_A_CELL:
            raise ImageError(
                f"a cell of {self.grid.cell_m:g} m has {cell_px:.1f} px from "
                f"{pose.height_m:.0f} m; {MIN_PIXELS_A_CELL:g} are needed"
            )
        view, margin_m = self.mission.detector.view, self.mission.camera.pose_error_m
        cells = projection.cells(view, margin_m, partly=self.mission.by_evidence)
        vantage = WHOLE_AREA
        if view == "cross":
            vantage = self.grid.cell_at(pose.position, projection.t_s)
        if not len(cells):
            raise ImageError("shows no cell whole within three heights")
        return vantage, cells

    def _refuse_implausible(self, image: NDArray[np.uint8]) -> None:
        if reason := implausible(image, noiseless=self.mission.camera.noiseless):
            raise ImageError(reason)
        if self.mission.camera.noiseless:
            return
        gray = cv2.extractChannel(image, 1)
        white = float(np.count_nonzero(gray >= _WHITE)) / gray.size
        if white > WHITE_SHARE:
            raise ImageError(f"over-exposed: {white:.0%} of it are white")
        dark = float(np.count_nonzero(gray <= _DARK)) / gray.size
        if dark > DARK_SHARE:
            raise ImageError(f"under-exposed: {dark:.0%} of it are black")


def sharpness(image: NDArray[np.uint8]) -> float:
    """Return the share of a picture's contrast, in its middle, in details of a pixel or two."""
    rows, columns = image.shape[:2]
    middle = image[rows // 4 : rows - rows // 4, columns // 4 : columns - columns // 4]
    gray = cv2.cvtColor(middle, cv2.COLOR_BGR2GRAY)
    _, spread = cv2.meanStdDev(gray)
    _, detail = cv2.meanStdDev(cv2.Laplacian(gray, cv2.CV_16S, ksize=1))
    return float(detail[0, 0]) / max(float(spread[0, 0]), 1.0)


def miniature(image: NDArray[np.uint8]) -> bytes:
    """Return a JPEG of about `MINIATURE_PX` columns, for the background of a map."""
    factor = max(1, image.shape[1] // MINIATURE_PX)
    rows, columns = (max(1, side // factor) for side in image.shape[:2])
    small = cv2.resize(image, (columns, rows), interpolation=cv2.INTER_LINEAR)
    return cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes()


def packed(marks: Marks) -> bytes:
    """Compress marks to a few kilobytes: a mask as a bit a place, a probability in 255 steps."""
    if marks.dtype == np.uint8:
        return b"m" + _compressed(marks.shape, np.packbits(marks > 0))
    return b"p" + packed_levels(np.round(marks * np.float32(255.0)).astype(np.uint8))


def packed_levels(levels: NDArray[np.uint8]) -> bytes:
    """Compress a byte a place."""
    return _compressed(levels.shape, levels)


def class_mask(stored: StoredJudgement, number: int) -> bytes:
    """Return the mask of a class in a picture, packed, without unfamiliar places."""
    there = unpacked_levels(stored.class_marks) == number
    if stored.unfamiliar:
        there &= unpacked(stored.unfamiliar) == 0
    return packed(there.view(np.uint8) * np.uint8(255))


def unpacked_levels(data: bytes, *, upside_down: bool = False) -> NDArray[np.uint8]:
    """Invert `packed_levels`; turn them by 180 degrees if they are `upside_down`."""
    shape, levels = _decompressed(data)
    return (levels[::-1] if upside_down else levels).reshape(shape)


def unpacked(data: bytes, *, upside_down: bool = False) -> Marks:
    """Invert `packed`; turn the marks by 180 degrees if they are `upside_down`.

    >>> mask = np.array([[255, 0, 255]], np.uint8)
    >>> unpacked(packed(mask)).tolist()
    [[255, 0, 255]]
    >>> unpacked(packed(np.array([[0.0, 0.2, 1.0]], np.float32))).round(3).tolist()
    [[0.0, 0.20000000298023224, 1.0]]
    """
    if data[:1] == b"p":
        levels = unpacked_levels(data[1:], upside_down=upside_down)
        return levels.astype(np.float32) / np.float32(255.0)
    shape, bits = _decompressed(data[1:])
    mask = np.unpackbits(bits, count=math.prod(shape)) * np.uint8(255)
    return np.ascontiguousarray(mask[::-1] if upside_down else mask).reshape(shape)


def _compressed(shape: tuple[int, ...], values: NDArray[np.uint8]) -> bytes:
    return _SHAPE.pack(*shape) + zlib.compress(values.tobytes(), 1)


def _decompressed(data: bytes) -> tuple[tuple[int, ...], NDArray[np.uint8]]:
    """Return the shape, and values in one row."""
    values = np.frombuffer(zlib.decompress(data[_SHAPE.size :]), np.uint8)
    return _SHAPE.unpack(data[: _SHAPE.size]), values


# --- a single picture ----------------------------------------------------------------------------
_ROI: Final = (60, 200, 60)
_NOT_ROI: Final = (200, 200, 200)
_MASK: Final = (255, 120, 0)
_BELOW: Final = (0, 0, 255)
_LETTER_PX: Final = 34  # minimum edge of a cell with a number, pixels


@dataclass(frozen=True, slots=True)
class PictureReport:
    """The judgement of one picture.

    Attributes:
        verdicts: Verdicts by cell, sorted.
        footprint: The ground at its corners, from the upper left clockwise; none if one shows the
            sky.
        doubt: Reason why a mission would not count it; empty if it would.
    """

    placed: Placed
    frame: Frame
    projection: Projection
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
                    "unsure": verdict.unsure,
                    **({"classes": dict(verdict.classes)} if verdict.classes else {}),
                }
                for verdict in self.verdicts
            ],
        }


def inspect_picture(picture: Picture, mission: Mission, lens: Lens | None = None) -> PictureReport:
    """Return a mission's verdicts on a picture. Raises `ImageError` with the reason for none."""
    (placed,) = credible([picture], mission)
    if isinstance(placed, str):
        raise ImageError(f"{picture.name}: {placed}")
    setting = setting_of(mission)
    placed, grid = replace(placed, pose=above_ground(placed.pose, setting)), setting.grid
    search = UprightSearch(grid, UprightSearch.pitch_for([placed.pose.height_m]))
    judge = Judge.for_mission(mission, grid, search, lens)
    try:
        frame = judge.frame(placed, 0.0)
    except ImageError as error:
        raise ImageError(f"{picture.name}: {error}") from None
    section, projection = mission.detector, judge.projection(frame.camera, placed, 0.0)
    cells = projection.cells(section.view, mission.camera.pose_error_m)
    mask, found = judge.detector.mask(frame.image), judged(judge.detector, frame.image)
    shares = projection.shares(found.marks, cells) if len(cells) else np.zeros(0)
    seen = verdicts(projection, found, cells, shares, section.share)
    doubt = implausible(frame.image, noiseless=mission.camera.noiseless) or ""
    return PictureReport(placed, frame, projection, mask, seen, _footprint(projection), doubt)


def annotated(report: PictureReport) -> NDArray[np.uint8]:
    """Draw the detector's mask as a line, the cells, and the share of each in per cent.

    Shape (rows, columns, 3), blue-green-red.
    """
    image = report.frame.image.copy()
    edges, _ = cv2.findContours(report.mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_SIMPLE)
    cv2.drawContours(image, edges, -1, _MASK, 1, cv2.LINE_AA)
    for positive in (False, True):  # the region's cells over their neighbours
        for verdict in report.verdicts:
            if verdict.positive == positive:
                _draw_cell(image, verdict, report.projection)
    below = report.projection.grid.fixed(report.placed.pose.position)
    (middle,) = report.projection.pixels(np.array([[below.east_m, below.north_m]]))
    if np.isfinite(middle).all():
        at = (round(float(middle[0])), round(float(middle[1])))
        cv2.drawMarker(image, at, _BELOW, cv2.MARKER_CROSS, 16, 2)
    return image


def _draw_cell(image: NDArray[np.uint8], verdict: Verdict, projection: Projection) -> None:
    pixels = projection.pixels(np.array(projection.grid.corners_of(verdict.cell), dtype=np.float64))
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


def _footprint(projection: Projection) -> tuple[LatLon, ...]:
    """Return the points where the corners' rays meet the level of the ground below the camera."""
    grid, matrix = projection.grid, projection.matrix
    right, low = projection.camera.width_px - 0.5, projection.camera.height_px - 0.5
    corners = np.array([[-0.5, -0.5, 1.0], [right, -0.5, 1.0], [right, low, 1.0], [-0.5, low, 1.0]])
    ground = corners @ np.linalg.inv(matrix).T
    with np.errstate(divide="ignore", invalid="ignore"):
        points = ground[:, :2] / ground[:, 2:]
    _, depth = project(matrix, points)
    if not (np.isfinite(points).all() and (depth > 0.0).all()):
        return ()
    return tuple(grid.position(GridPoint(*point)) for point in points.tolist())
