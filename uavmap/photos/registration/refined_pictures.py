"""Pictures of a source, refined by their overlaps, which add missing tags; and a report.

    Gathered -> (decoded small, straightened) -> TaggedPicture -> refine -> Gathered, refined

It runs before tags are validated, so pictures without heading or height can be used if they overlap
others. The report is a few lines for the terminal, and registration.json for programs.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from missions.errors import ImageError
from missions.flight.setting_of import setting_of
from missions.geo.geodesy import LocalPlane
from missions.geo.grid import Grid
from missions.geo.terrain import Terrain
from missions.mission.schema import Mission
from uavmap.base.printable import printable
from uavmap.output import summary
from uavmap.photos.registration.calibration import Lenses
from uavmap.photos.registration.refinement import RefinedPicture, TaggedPicture, refine
from uavmap.photos.scratch_file import FeatureFile
from uavmap.photos.sources.inventory import Gathered
from uavmap.photos.sources.photo_file import eight_bits
from uavmap.photos.sources.picture_record import Picture
from uavmap.photos.workers import Crew, Threads, threads_of
from vision.camera import Lens, euler
from vision.registration.ground_plane import bearing
from vision.registration.matching import WIDTH_PX, extract, thumbnail
from vision.registration.views import Agreement, Features, Measured, Net, Registration

_LOG: Final = logging.getLogger("uavmap.photos")
FILE: Final = "registration.json"
MAX_NAMED_PICTURES: Final = 12
"""Maximum number of pictures left as tagged that the terminal names; the file names all."""
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
    taken: tuple[TaggedPicture, ...]
    result: Registration
    found: Mapping[str, RefinedPicture]

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
    """Register the pictures of a set once (`Overlaps`)."""
    with FeatureFile() as kept:
        return Overlaps.examine(gathered, mission, kept, lens=lens, crew=crew).refined(gathered)


@dataclass(frozen=True, slots=True)
class Overlaps:
    """The features of a set's pictures, which register some or all of them."""

    taken: Sequence[TaggedPicture]
    lenses: Lenses
    ground: tuple[Grid, Terrain] | None
    crew: Crew

    @classmethod
    def examine(
        cls,
        gathered: Gathered,
        mission: Mission | None,
        kept: FeatureFile,
        *,
        lens: Lens | None = None,
        crew: Crew | None = None,
    ) -> Overlaps:
        """Examine the pictures of a set, over the ground of the mission if it is not flat.

        Args:
            mission: Gives the ground, and the angle of view of pictures without such a tag.
            kept: File for the features.
            lens: A calibration for all pictures.
            crew: Examines the pictures; None: threads here, one a core. The result is the same.
        """
        lenses = Lenses(HFOV_DEG if mission is None else mission.camera.hfov_deg, lens)
        placed = [p for p in gathered.pictures if _has_place(p)]
        ground = None
        if mission is not None and mission.ground is not None:
            ground = setting_of(mission).grid, mission.ground
        crew = crew or Threads()
        return cls(_examined(placed, lenses, crew, kept), lenses, ground, crew)

    def refined(self, gathered: Gathered) -> RefinedSet:
        """Register the pictures that are still in the set; others do not affect their poses."""
        names = {picture.name for picture in gathered.pictures}
        taken = [tag for tag in self.taken if tag.picture.name in names]
        many = threads_of(self.crew).in_order
        result, found = refine(taken, self.ground, _log_overlaps, many)
        by_name = {tag.picture.name: tag.picture for tag in taken}
        poses = {name: _filled(by_name[name], pose, self.lenses) for name, pose in found.items()}
        turned = frozenset(name for name, pose in found.items() if pose.refined.turned)
        for line in lines(taken, result, found):
            _LOG.info(line)
        better = replace(gathered, refined=poses, upside_down=turned)
        return RefinedSet(better, tuple(taken), result, found)


def _examined(
    placed: Sequence[Picture], lenses: Lenses, crew: Crew, kept: FeatureFile
) -> list[TaggedPicture]:
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
            taken.append(TaggedPicture(picture, kept.put(features), hfov_rad, sigma))
        if number % every == 0 or number == len(placed):
            _LOG.info(f"compared {number} of {len(placed)}: {printable(picture.name)}")
    return taken


def _features(lenses: Lenses, picture: Picture) -> tuple[Features, float] | None:
    """Return a picture's features and angle of view; None if it cannot be decoded."""
    try:
        image = eight_bits(picture.content.decode(WIDTH_PX))
    except ImageError:
        return None  # the judgement reports the reason
    small = thumbnail(image)
    rows, columns = small.shape
    straight, camera = lenses.straightened(small, lenses.lens(picture).scaled(columns, rows))
    return extract(straight), camera.hfov_rad


def _log_overlaps(done: int, all_: int) -> None:
    if done % _OVERLAPS_A_LINE == 0 and done < all_:
        _LOG.info(f"searched for overlaps: {done} of {all_}")


def _has_place(picture: Picture) -> bool:
    place = picture.position
    return place is not None and max(abs(place.lat_deg), abs(place.lon_deg)) >= _NOWHERE_DEG


def _filled(picture: Picture, found: RefinedPicture, lenses: Lenses) -> Picture:
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


# --- the report, for the terminal and for programs -----------------------------------------------
def report(
    taken: Sequence[TaggedPicture], result: Registration, found: Mapping[str, RefinedPicture]
) -> dict[str, Any]:
    """Return the content of registration.json."""
    return {
        "version": 1,
        "pictures_refined": len(found),
        "pictures_as_tagged": len(taken) - len(found),
        "held_apart": {
            "pixels_of_width": WIDTH_PX,
            "as_tagged": _agreement(result.before),
            "refined": _agreement(result.after),
        },
        "nets": [_net(net, taken) for net in result.nets],
        "pictures": [
            _picture(tag, found.get(tag.picture.name), left)
            for tag, left in zip(taken, result.left, strict=True)
        ],
    }


def lines(
    taken: Sequence[TaggedPicture], result: Registration, found: Mapping[str, RefinedPicture]
) -> list[str]:
    """Return the lines for the terminal."""
    report_lines = []
    if found and result.after is not None:
        nets = f"{len(result.nets)} net" + ("s" if len(result.nets) > 1 else "")
        pairs = sum(net.pairs for net in result.nets)
        report_lines.append(
            f"registration: {len(found)} of {len(taken)} pictures refined "
            f"({nets}, {pairs} overlaps)"
        )
        before = "" if result.before is None else f"; as tagged to {_metres(result.before)}"
        report_lines.append(f"  they agree on the ground to {_metres(result.after)}{before}")
        after = result.after
        report_lines.append(
            f"  transfer error {after.median_px:.2f} px (median), {after.most_px:.2f} px (90 %) "
            f"in pictures of {WIDTH_PX} px, {after.points} tie points that were kept apart"
        )
        moved = [
            _moved_m(tag, found[tag.picture.name]) for tag in taken if tag.picture.name in found
        ]
        report_lines.append(
            f"  positions moved by {np.median(moved):.1f} m (median), at most {max(moved):.1f} m"
        )
    elif taken:
        report_lines.append(f"registration: none of {len(taken)} pictures could be refined")
    report_lines += [
        f"{name}: stored upside down (it overlaps its neighbours only when turned by 180 degrees); "
        "turned"
        for name, pose in found.items()
        if pose.refined.turned
    ]
    left = [
        (tag.picture.name, why)
        for tag, why in zip(taken, result.left, strict=True)
        if why is not None
    ]
    report_lines += [
        f"{printable(name)}: left as tagged: {why}" for name, why in left[:MAX_NAMED_PICTURES]
    ]
    if len(left) > MAX_NAMED_PICTURES:
        report_lines.append(
            f"{len(left) - MAX_NAMED_PICTURES} more are left as tagged: {FILE} names them"
        )
    return report_lines


def _metres(agreement: Agreement) -> str:
    return f"{agreement.median_m:.2f} m (median), {agreement.most_m:.2f} m (90 %)"


def _agreement(agreement: Agreement | None) -> dict[str, Any] | None:
    if agreement is None:
        return None
    return {
        "tie_points": agreement.points,
        "median_m": round(agreement.median_m, 3),
        "p90_m": round(agreement.most_m, 3),
        "median_px": round(agreement.median_px, 3),
        "p90_px": round(agreement.most_px, 3),
    }


def _net(net: Net, taken: Sequence[TaggedPicture]) -> dict[str, Any]:
    return {
        "pictures": [taken[k].picture.name for k in net.members],
        "overlaps": net.pairs,
        "focal_length_of_told": {name: round(f, 4) for name, f in net.focal.items()},
        "ground_falls_east_percent": round(100.0 * net.slope[0], 2),
        "ground_falls_north_percent": round(100.0 * net.slope[1], 2),
        "height_tags_off_percent": round(100.0 * net.height_bias, 2),
        "heading_tags_off_deg": round(math.degrees(net.yaw_bias_rad), 2),
        "geotags_off_sigma_m": _rounded(net.position_sigma_m, 2),
    }


def _picture(tag: TaggedPicture, found: RefinedPicture | None, left: str | None) -> dict[str, Any]:
    if found is None:
        return {"name": tag.picture.name, "refined": False, "why": left}
    pose, refined = found.pose, found.refined
    heading = math.degrees(float(bearing(refined.axes[None])[0]))
    east_m, north_m = LocalPlane(tag.position).to_plane(found.tag_position)
    return {
        "name": tag.picture.name,
        "refined": True,
        "net": refined.component,
        "lat_deg": round(pose.position.lat_deg, 8),
        "lon_deg": round(pose.position.lon_deg, 8),
        "height_m": round(pose.height_m, 3),
        "heading_deg": round(heading % 360.0, 2),
        "tilt_deg": round(math.degrees(math.acos(min(1.0, -float(refined.axes[2, 2])))), 2),
        "roll_pitch_yaw_deg": [round(math.degrees(v), 3) for v in euler(pose.attitude)],
        "hfov_deg": round(math.degrees(found.hfov_rad), 3),
        "moved_east_m": round(east_m, 2),
        "moved_north_m": round(north_m, 2),
        "height_changed_m": _rounded(tag.height_m and pose.height_m - tag.height_m.value, 2),
        "upside_down": refined.turned,
        "position_sigma_m": round(refined.position_sigma_m, 2),
        "height_sigma_m": round(refined.height_sigma_m, 2),
        "heading_sigma_deg": round(math.degrees(refined.yaw_sigma_rad), 2),
        "tie_points": refined.matches,
        "transfer_error_px": round(refined.residual_px, 2),
    }


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)


def _moved_m(tag: TaggedPicture, found: RefinedPicture) -> float:
    return math.hypot(*LocalPlane(tag.position).to_plane(found.tag_position))
