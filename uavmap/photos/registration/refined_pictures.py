"""Pictures of a source, refined by their overlaps: what tags lack is filled in.

    Gathered -> (decoded small, straightened) -> Refinement -> Gathered with refined poses

It comes before anybody asks whether a picture's tags do, so pictures without heading or height can
be used where they overlap others.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.errors import ImageError
from missions.flight.setting import Setting
from missions.mission.schema import Mission
from uavmap.base.printable import printable
from uavmap.output import summary
from uavmap.photos.registration.feature_file import FeatureFile
from uavmap.photos.registration.refinement import (
    FOCAL_SIGMA,
    TILT_SIGMA_RAD,
    UNKNOWN_FOCAL_SIGMA,
    Found,
    Refinement,
    Tags,
)
from uavmap.photos.registration.registration_report import FILE, lines, report
from uavmap.photos.sources.inventory import Gathered
from uavmap.photos.sources.photo_file import eight_bits
from uavmap.photos.sources.picture_record import Measured, Picture
from uavmap.photos.workers import Crew, Threads, in_order, worker_count
from vision.camera import euler
from vision.lens import Lens
from vision.registration import WIDTH_PX, Features, Registration, extract, thumbnail
from vision.straighten import Straightening, straightening

_LOG: Final = logging.getLogger("uavmap.photos")
HFOV_DEG: Final = 75.0
"""The angle of view of pictures of which neither tags nor a mission file tell one."""

_CALIBRATED_SIGMA = 0.002  # of a calibration's focal length, as a share
_OVERLAPS_A_LINE = 500
_NOWHERE_DEG = 1e-3  # a geotag nearer to 0, 0 is none


@dataclass(frozen=True, slots=True)
class RefinedSet:
    """A set of pictures after registration.

    Attributes:
        gathered: the set, with refined poses in `Gathered.refined`.
        tags: what went in.
        result: what came out.
        found: the refined poses, by name.
    """

    gathered: Gathered
    tags: tuple[Tags, ...]
    result: Registration
    found: Mapping[str, Found]

    def log(self) -> None:
        """A few lines on what was done."""
        for line in lines(self.tags, self.result, self.found):
            _LOG.info(line)

    def write(self, folder: Path) -> None:
        """Write registration.json."""
        summary.write(report(self.tags, self.result, self.found), folder / FILE)


def refined(
    gathered: Gathered,
    mission: Mission | None = None,
    *,
    lens: Lens | None = None,
    crew: Crew | None = None,
) -> RefinedSet:
    """Register the pictures of a set, over the ground of the mission where it is not flat.

    Args:
        gathered: The set, as tagged.
        mission: What is to be mapped, where that is known: it tells the ground, and the angle of
            view of pictures that do not.
        lens: A calibration for all pictures.
        crew: Who looks at the pictures; None: threads here, one a core. The result is the same.
    """
    lenses = _Lenses(lens, HFOV_DEG if mission is None else mission.camera.hfov_deg)
    placed = [p for p in gathered.pictures if _has_place(p)]
    with FeatureFile() as kept:
        refinement = _looked_at(placed, lenses, mission, crew or Threads(), kept)
        threads = crew.count if isinstance(crew, Threads) else None
        many = partial(in_order, workers=threads or worker_count())
        result, found = refinement.run(_log_overlaps, many)
    by_name = {p.name: p for p in placed}
    poses = {name: _filled(by_name[name], pose, lenses) for name, pose in found.items()}
    turned = frozenset(name for name, pose in found.items() if pose.refined.turned)
    better = RefinedSet(
        replace(gathered, refined=poses, upside_down=turned), tuple(refinement.tags), result, found
    )
    better.log()
    return better


def _looked_at(
    placed: Sequence[Picture],
    lenses: _Lenses,
    mission: Mission | None,
    crew: Crew,
    kept: FeatureFile,
) -> Refinement:
    """All pictures that can be decoded, on their way into a registration."""
    every = max(1, len(placed) // 10)
    refinement = Refinement()
    if mission is not None and mission.ground is not None:
        refinement.grid, refinement.terrain = Setting.of(mission).grid, mission.ground
    sent = (crew.sent(picture, WIDTH_PX) for picture in placed)
    answers = crew.in_order(lenses.features, sent)
    for number, (picture, looked) in enumerate(zip(placed, answers, strict=True), start=1):
        if looked is not None:
            features, hfov_rad = looked
            refinement.tags.append(lenses.tags(picture, hfov_rad))
            refinement.features.append(kept.put(features))
        if number % every == 0 or number == len(placed):
            _LOG.info(f"compared {number} of {len(placed)}: {printable(picture.name)}")
    return refinement


def _log_overlaps(done: int, all_: int) -> None:
    """Log how many possible overlaps were examined, now and then."""
    if done % _OVERLAPS_A_LINE == 0 and done < all_:
        _LOG.info(f"looked for overlaps: {done} of {all_}")


def _has_place(picture: Picture) -> bool:
    place = picture.position
    return place is not None and max(abs(place.lat_deg), abs(place.lon_deg)) >= _NOWHERE_DEG


@dataclass(slots=True)
class _Lenses:
    """Which lens took a picture, as a pinhole at the size that is registered."""

    given: Lens | None
    hfov_deg: float
    plans: dict[Lens, Straightening] = field(default_factory=dict)

    def lens(self, picture: Picture) -> Lens:
        """The calibration given, or what the tags tell, or what is usual."""
        lens = self.given or picture.lens
        if lens is None:
            hfov_rad = math.radians(self.hfov_deg)
            return Lens.pinhole(hfov_rad, picture.width_px, picture.height_px)
        return lens

    def features(self, picture: Picture) -> tuple[Features, float] | None:
        """Of a picture, and its angle of view; None for one that cannot be decoded."""
        try:
            image = eight_bits(picture.decode(WIDTH_PX))
        except ImageError:
            return None  # whoever judges it says why
        small, hfov_rad = self._straight(thumbnail(image), picture)
        return extract(small), hfov_rad

    def _straight(
        self, small: NDArray[np.uint8], picture: Picture
    ) -> tuple[NDArray[np.uint8], float]:
        rows, columns = small.shape
        lens = self.lens(picture).scaled(columns, rows)
        if lens.is_pinhole:
            return small, lens.hfov_rad
        # the focal length of a tag is not quite the same in each picture; a plan of its own is dear
        alike = replace(lens, fx_px=round(lens.fx_px, 1), fy_px=round(lens.fy_px, 1))
        plan = self.plans.get(alike) or self.plans.setdefault(alike, straightening(alike))
        return plan.applied(small), plan.camera.hfov_rad

    def tags(self, picture: Picture, hfov_rad: float) -> Tags:
        """What is known of a picture that was taken with this angle of view."""
        position = picture.position
        assert position is not None
        unknown = self.given is None and picture.lens is None
        sigma = UNKNOWN_FOCAL_SIGMA if unknown else FOCAL_SIGMA
        told = picture.height_m if picture.height_m and picture.height_m.value > 0.0 else None
        yaw = picture.yaw_deg
        return Tags(
            picture.name,
            position,
            hfov_rad,
            f"{math.degrees(hfov_rad):.1f} deg",
            picture.position_sigma_m,
            _CALIBRATED_SIGMA if self.given is not None else sigma,
            None if told is None else (told.value, told.sigma),
            None if yaw is None else (math.radians(yaw.value), math.radians(yaw.sigma)),
            None if picture.pitch_deg is None else math.radians(picture.pitch_deg.value),
            None if picture.roll_deg is None else math.radians(picture.roll_deg.value),
            TILT_SIGMA_RAD if picture.pitch_deg is None else math.radians(picture.pitch_deg.sigma),
        )


def _filled(picture: Picture, found: Found, lenses: _Lenses) -> Picture:
    """The picture with the pose and the focal length that were found."""
    roll, pitch, yaw = (math.degrees(angle) for angle in euler(found.pose.attitude))
    refined_pose = found.refined
    yaw_deg = math.degrees(refined_pose.yaw_sigma_rad)
    lens = lenses.lens(picture)
    ratio = found.focal_ratio
    return replace(
        picture,
        position=found.pose.position,
        position_sigma_m=refined_pose.position_sigma_m,
        height_m=Measured(found.pose.height_m, refined_pose.height_sigma_m),
        yaw_deg=Measured(yaw % 360.0, yaw_deg),
        pitch_deg=Measured(pitch, yaw_deg),
        roll_deg=Measured(roll, yaw_deg),
        lens=replace(lens, fx_px=lens.fx_px * ratio, fy_px=lens.fy_px * ratio),
    )
