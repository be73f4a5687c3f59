"""Pictures of a source, refined by their overlaps: what tags lack is filled in.

    Gathered -> (decoded small, straightened) -> Taken -> refine -> Gathered with refined poses

It runs before tags are validated, so pictures without heading or height can be used where they
overlap others.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

from missions.errors import ImageError
from missions.flight.setting_of import setting_of
from missions.mission.schema import Mission
from uavmap.base.printable import printable
from uavmap.output import summary
from uavmap.photos.registration.lenses import Lenses
from uavmap.photos.registration.refinement import Found, Taken, refine
from uavmap.photos.registration.registration_report import FILE, lines, report
from uavmap.photos.scratch_file import FeatureFile
from uavmap.photos.sources.inventory import Gathered
from uavmap.photos.sources.photo_file import eight_bits
from uavmap.photos.sources.picture_record import Picture
from uavmap.photos.workers import Crew, Threads, in_order, thread_count
from vision.camera import euler
from vision.lens import Lens
from vision.registration.picture_features import WIDTH_PX, extract, thumbnail
from vision.registration.views import Features, Measured, Registration

_LOG: Final = logging.getLogger("uavmap.photos")
HFOV_DEG: Final = 75.0
"""Angle of view of pictures for which neither tags nor a mission file give one, degrees."""

# standard deviations of focal lengths, as shares: of a calibration, a tag, a guess
_CALIBRATED, _TAGGED, _GUESSED = 0.002, 0.05, 0.15
_OVERLAPS_A_LINE = 500
_NOWHERE_DEG = 1e-3  # a geotag nearer to 0, 0 is none


@dataclass(frozen=True, slots=True)
class RefinedSet:
    """A set of pictures after registration; `gathered.refined` and `found` are by name."""

    gathered: Gathered
    taken: tuple[Taken, ...]
    result: Registration
    found: Mapping[str, Found]

    def write(self, folder: Path) -> None:
        """Write registration.json."""
        summary.write(report(self.taken, self.result, self.found), folder / FILE)


def refined(
    gathered: Gathered,
    mission: Mission | None = None,
    *,
    lens: Lens | None = None,
    crew: Crew | None = None,
) -> RefinedSet:
    """Register the pictures of a set, over the ground of the mission where it is not flat.

    Args:
        mission: Gives the ground, and the angle of view of pictures whose tags have none.
        lens: A calibration for all pictures.
        crew: Examines the pictures; None: threads here, one a core. The result is the same.
    """
    lenses = Lenses(HFOV_DEG if mission is None else mission.camera.hfov_deg, lens)
    placed = [p for p in gathered.pictures if _has_place(p)]
    ground = None
    if mission is not None and mission.ground is not None:
        ground = setting_of(mission).grid, mission.ground
    with FeatureFile() as kept:
        crew = crew or Threads()
        taken = _looked_at(placed, lenses, crew, kept)
        many = partial(in_order, workers=thread_count(crew))
        result, found = refine(taken, ground, _log_overlaps, many)
    by_name = {p.name: p for p in placed}
    poses = {name: _filled(by_name[name], pose, lenses) for name, pose in found.items()}
    turned = frozenset(name for name, pose in found.items() if pose.refined.turned)
    for line in lines(taken, result, found):
        _LOG.info(line)
    better = replace(gathered, refined=poses, upside_down=turned)
    return RefinedSet(better, tuple(taken), result, found)


def _looked_at(
    placed: Sequence[Picture], lenses: Lenses, crew: Crew, kept: FeatureFile
) -> list[Taken]:
    """Return the pictures that can be decoded, their features kept in the file."""
    every = max(1, len(placed) // 10)
    taken = []
    sent = (crew.sent(picture, WIDTH_PX) for picture in placed)
    answers = crew.in_order(partial(_features, lenses), sent)
    for number, (picture, looked) in enumerate(zip(placed, answers, strict=True), start=1):
        if looked is not None:
            features, hfov_rad = looked
            sigma = _GUESSED if picture.lens is None else _TAGGED
            sigma = sigma if lenses.given is None else _CALIBRATED
            taken.append(Taken(picture, kept.put(features), hfov_rad, sigma))
        if number % every == 0 or number == len(placed):
            _LOG.info(f"compared {number} of {len(placed)}: {printable(picture.name)}")
    return taken


def _features(lenses: Lenses, picture: Picture) -> tuple[Features, float] | None:
    """Return a picture's features and angle of view; None if it cannot be decoded."""
    try:
        image = eight_bits(picture.content.decode(WIDTH_PX))
    except ImageError:
        return None  # whoever judges it says why
    small = thumbnail(image)
    rows, columns = small.shape
    straight, camera = lenses.straightened(small, lenses.lens(picture).scaled(columns, rows))
    return extract(straight), camera.hfov_rad


def _log_overlaps(done: int, all_: int) -> None:
    if done % _OVERLAPS_A_LINE == 0 and done < all_:
        _LOG.info(f"looked for overlaps: {done} of {all_}")


def _has_place(picture: Picture) -> bool:
    place = picture.position
    return place is not None and max(abs(place.lat_deg), abs(place.lon_deg)) >= _NOWHERE_DEG


def _filled(picture: Picture, found: Found, lenses: Lenses) -> Picture:
    """Return the picture with its refined pose and focal length."""
    roll, pitch, yaw = (math.degrees(angle) for angle in euler(found.pose.attitude))
    pose, lens, ratio = found.refined, lenses.lens(picture), found.focal_ratio
    sigma_deg = math.degrees(pose.yaw_sigma_rad)
    return replace(
        picture,
        position=found.pose.position,
        position_sigma_m=pose.position_sigma_m,
        height_m=Measured(found.pose.height_m, pose.height_sigma_m),
        yaw_deg=Measured(yaw % 360.0, sigma_deg),
        pitch_deg=Measured(pitch, sigma_deg),
        roll_deg=Measured(roll, sigma_deg),
        lens=replace(lens, fx_px=lens.fx_px * ratio, fy_px=lens.fy_px * ratio),
    )
