"""Judging pictures of a mission: frame -> plausible -> judge_frame -> FrameSeen."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from missions.classes import ClassShare
from missions.errors import ImageError
from missions.events import FrameLost, FrameSeen, Vote
from missions.geo.grid import Grid
from missions.geo.terrain import Terrain
from missions.mission.schema import Mission
from missions.units import Cell, Pose
from uavmap.aircraft.cameras.source import Loaded
from uavmap.base.image_files import decoded
from uavmap.base.printable import printable
from uavmap.journal.kept_frames import Keeper, KeptFrame
from uavmap.load.detector_source import detector_of_section
from vision.camera import Camera
from vision.detectors import Detector
from vision.plausible import Image, implausible
from vision.projection import Frame, Verdict, judge_frame

Verdicts = tuple[Verdict, ...]


@dataclass(slots=True)
class Classifier:
    """The judge of one vehicle's pictures: camera, detector, minimum share of an ROI cell.

    It keeps the vehicle's last picture, by which it detects a stalled camera.
    """

    mission: Mission
    grid: Grid
    camera: Camera
    detector: Detector
    from_above: Detector | None = None
    """Detector for pictures from search height, if that has layers of its own.

    Its verdicts are suspicions: from there all ground differs from the marks made from below.
    """
    overview_above_m: float | None = None
    """Height above which a frame is from search height, m; None without one."""
    ground: Terrain | None = None
    """Ground below the frames; None: flat."""
    _last: Image | None = field(default=None, repr=False)

    @classmethod
    def for_mission(
        cls,
        mission: Mission,
        grid: Grid,
        height_m: float | None = None,
        detector: Detector | None = None,
    ) -> Classifier:
        """Return the classifier of a mission file, for a vehicle at a height.

        `detector` replaces the mission's. Raises `MissionFileError` for a model that cannot be
        read, or is another one.
        """
        camera = camera_of(mission)
        lowest_m, search_m = mission.altitude_m(0), mission.search_altitude_m(0)
        ratio = (height_m or lowest_m) / lowest_m
        above = None
        if search_m is not None:
            higher_m = search_m + (height_m or lowest_m) - lowest_m
            above = detector or detector_of(mission, higher_m / lowest_m)
        at_height = detector or detector_of(mission, ratio)
        over = mission.overview_above_m
        return cls(mission, grid, camera, at_height, above, over, mission.ground)

    def is_overview(self, frame: Frame) -> bool:
        """Return whether a frame is from the height of a search that has layers of its own."""
        above_m = self.overview_above_m
        return above_m is not None and frame.pose.height_m > above_m

    def votes(self, frame: Frame, vantage: Cell | None) -> tuple[Cell, Verdicts]:
        """Return the vantage of a frame, by default the cell below, and its verdicts.

        Raises `ImageError` for a picture that is no evidence (`vision.plausible`), or of another
        size.
        """
        here = vantage or self.grid.cell_at(frame.pose.position, frame.t_s)
        return here, self._judge(frame, self.mission.detector.view, here)

    def votes_anywhere(self, frame: Frame) -> Verdicts:
        """Return a frame's verdicts on every whole cell, `camera.pose_error_m` from its edge.

        It does not depend on `detector.view`. Raises `ImageError` as `votes`.
        """
        return self._judge(frame, "all", None)

    def doubt(self, frame: Frame) -> str | None:
        """Return why a frame is no evidence, beside the last judged one; None if it may be."""
        return implausible(frame.image, self._last, noiseless=self.mission.camera.noiseless)

    def _judge(self, frame: Frame, view: Literal["cross", "all"], vantage: Cell | None) -> Verdicts:
        reason = self.doubt(frame)
        self._last = frame.image
        if reason:
            raise ImageError(reason)
        above = self.from_above if self.is_overview(frame) else None
        return judge_frame(
            frame,
            self.grid,
            above or self.detector,
            share=self.mission.detector.share,
            view=view,
            vantage=vantage,
            margin_m=self.mission.camera.pose_error_m,
            terrain=self.ground,
        )


@dataclass(frozen=True, slots=True)
class Blind:
    """A substitute for a missing detector, if vehicles only fly home."""

    name: ClassVar[str] = "none"
    calibrated: ClassVar[bool] = False

    def probability(self, image: Image) -> NDArray[np.float32]:
        """Raise `ImageError`."""
        raise ImageError("there is no detector: the aircraft only return home")

    def mask(self, image: Image) -> NDArray[np.uint8]:
        """Raise `ImageError`."""
        raise ImageError("there is no detector: the aircraft only return home")


def camera_of(mission: Mission) -> Camera:
    """Return the optics of a mission's camera."""
    optics = mission.camera.optics
    return Camera(optics.hfov_rad, optics.width_px, optics.height_px)


def detector_of(mission: Mission, height_ratio: float = 1.0) -> Detector:
    """Return the detector of a mission file (`uavmap.load.detector_source`)."""
    return detector_of_section(mission.detector, height_ratio)


class PosedPicture(NamedTuple):
    """A picture, its pose, and the cell that it was ordered for (`vantage`, by default that below).

    `anywhere`: it is evidence of all that it shows.
    """

    vehicle: int
    t_s: float
    """Mission time of the exposure, s."""
    pose: Pose
    vantage: Cell | None
    anywhere: bool
    name: str
    data: Loaded


class PictureJudge:
    """The judge of the pictures of every vehicle of a service, each by its own classifier."""

    def __init__(
        self, classifiers: Mapping[int, Classifier], keepers: Sequence[Keeper] = ()
    ) -> None:
        self._classifiers = classifiers
        self._keepers = keepers

    def verdict(self, taken: PosedPicture) -> FrameSeen | FrameLost:
        """Return a picture's verdict on the cells around its vantage, or on all whole cells."""
        classifier = self._classifiers[taken.vehicle]
        camera = classifier.camera
        try:
            image = decoded(taken.data, taken.name, (camera.width_px, camera.height_px))
            hfov_deg = math.degrees(camera.hfov_rad)
            kept = KeptFrame("", taken.vehicle, taken.t_s, taken.pose, hfov_deg)
            for keeper in self._keepers:
                keeper.keep(kept, taken.data)
            frame = Frame(image, taken.pose, taken.t_s, camera)
            if taken.anywhere:
                here, verdicts = None, classifier.votes_anywhere(frame)
                overview: Literal[True] | None = True if classifier.is_overview(frame) else None
            else:
                here, verdicts = classifier.votes(frame, taken.vantage)
                overview = None
        except ImageError as error:
            return FrameLost(taken.vehicle, taken.t_s, printable(str(error)))
        votes = tuple(Vote(v.cell, v.positive, round(v.share, 3)) for v in verdicts)
        unsure = tuple(v.cell for v in verdicts if v.unsure) or None
        classes = tuple(
            ClassShare(v.cell, number, round(share, 3))
            for v in verdicts
            for number, share in v.classes
        )
        return FrameSeen(
            taken.vehicle, taken.t_s, here, votes,
            overview=overview, unsure=unsure, classes=classes or None,
        )  # fmt: skip
