"""One recorded picture before its pixels are decoded, and the check of its tags.

A source gives the values of the file only; a missing value is None. Another step may add it
(`dataclasses.replace`): a position from its neighbours, a heading from its ground.

A wrong position, height or heading puts verdicts in the wrong place, where they count like any
other. So a picture that cannot belong to this set is refused, with its reason.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median_low
from typing import Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from missions.flight.state import Setting
from missions.mission.schema import Mission
from missions.units import LatLon, Pose, Quaternion
from vision.camera import Lens
from vision.registration.views import Measured


class Content(Protocol):
    """The pixels of a picture in their file. Thread-safe."""

    @property
    def size_bytes(self) -> int:
        """Length of the file; pictures of different sizes have different contents."""
        ...

    def digest(self) -> str:
        """Return the SHA-256 of the content, hexadecimal. Raises `ImageError`."""
        ...

    def decode(self, max_width_px: int) -> NDArray[np.uint8] | NDArray[np.uint16]:
        """Return the picture, scaled down to at most `max_width_px` columns, never up.

        Shape (rows, columns, 3), blue-green-red, or (rows, columns) for one band; uint8, or uint16
        if the file has more than 8 bits. Rows are as stored: an orientation of the tags is not
        applied. Raises `ImageError` if it cannot be decoded.
        """
        ...


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture of a source, with its tags.

    Attributes:
        name: Unique in the source: the path below it, with "/"; for a video, its name and the
            frame's number.
        taken_s: Time of exposure by `clock`; None if unknown.
        clock: `utc`: since 1970. `camera`: since 1970 by a clock without a zone; differences hold
            within a set. `relative`: since the recording began.
        position_sigma_m: Standard deviation of one horizontal coordinate.
        height_m: Height of the camera above the place of take-off, which counts as the ground.
        amsl_m: Height of the camera above sea level, or above the ellipsoid: many cameras do not
            state which.
        yaw_deg: True bearing of the picture's upper edge for a view straight down, else of the
            optical axis; 0 to 360.
        pitch_deg: Pitch of the optical axis: -90 is straight down, 0 the horizon.
        roll_deg: Roll about the optical axis; 0 is upright.
        lens: The intrinsics at full size; None without a focal length.
        lens_from: Its source in words.
        notes: Tags that were found and could not be used, a line each.
    """

    name: str
    content: Content
    width_px: int
    height_px: int
    taken_s: float | None = None
    clock: Literal["utc", "camera", "relative"] = "camera"
    position: LatLon | None = None
    position_sigma_m: float = 5.0
    height_m: Measured | None = None
    amsl_m: Measured | None = None
    yaw_deg: Measured | None = None
    pitch_deg: Measured | None = None
    roll_deg: Measured | None = None
    lens: Lens | None = None
    lens_from: str = ""
    notes: tuple[str, ...] = ()


class Refused(NamedTuple):
    """An unreadable file of a source, which should be a picture."""

    name: str
    reason: str


class PictureSource(Protocol):
    """A place with recorded pictures. Reading it loads no pixels."""

    path: Path

    def pictures(self) -> Iterator[Picture | Refused]:
        """Yield every picture, in a fixed order; the same each time.

        A bad picture never ends the iteration. Raises `ImageError` if the whole source is
        unreadable.
        """
        ...

    def left_out(self) -> Sequence[str]:
        """Return the other files there, a line for each kind; known once `pictures` has ended."""
        ...


# --- the check of tags ---------------------------------------------------------------------------
FARTHEST_M = 10_000.0
"""Maximum distance of a picture from the others, or from the mission's start, m."""
HEIGHT_RATIO = 4.0
"""Maximum ratio of a height to the usual one of the set."""
OTHER_DAY_S = 12 * 3600.0
"""Maximum difference from the usual time of the set, s."""
MAX_LATITUDE_DEG = 79.0
MIN_DOWN_DEG = 35.0
"""Minimum angle of the camera below the horizon, degrees."""
_MIN_SET = 3
_EARTH_M = 6_371_000.0
_MIN_HEIGHT_M = 0.5
_USUAL_HEIGHT_M = 50.0
_MAX_HEIGHT_M = 5_000.0


@dataclass(frozen=True, slots=True)
class Placed:
    """A picture with a complete pose; `taken_s` is since the first."""

    picture: Picture
    pose: Pose
    taken_s: float | None


Verdict = Placed | str
"""A picture that can be used, or the reason why it cannot."""


def credible(
    pictures: Sequence[Picture],
    mission: Mission | None = None,
    *,
    any_day: bool = False,
) -> list[Verdict]:
    """Return for each picture, in their order, its pose by its tags, or why it is not used.

    Args:
        pictures: All pictures of the set, whose medians are the usual values.
        mission: The mission to be mapped. `camera.mounting = "gimbal"` replaces a missing pitch,
            and `start.amsl_m` converts heights above the sea. Pictures far from its start are
            refused.
        any_day: True to accept pictures of other days.
    """
    found: list[Verdict] = [_placed(picture, mission) for picture in pictures]
    usable = [entry for entry in found if isinstance(entry, Placed)]
    usual = _Usual.from_pictures(usable, mission, any_day=any_day)
    verdicts = [e if isinstance(e, str) else usual.refusal(e) or e for e in found]
    times = (v.picture.taken_s for v in verdicts if isinstance(v, Placed))
    first_s = min((t_s for t_s in times if t_s is not None), default=0.0)
    return [_since(v, first_s) if isinstance(v, Placed) else v for v in verdicts]


def contradicted(
    pictures: Sequence[Picture], mission: Mission | None = None, *, any_day: bool = False
) -> dict[str, str]:
    """Return by name the pictures whose own tags cannot be true in this set, with reasons.

    A picture's overlaps may still give what its tags lack, so a missing tag contradicts nothing.
    """
    heights = [p.height_m if p.height_m and p.height_m.value > 0.0 else None for p in pictures]
    usual_m = median_low([h.value for h in heights if h] or [_USUAL_HEIGHT_M])
    filled = [
        replace(
            picture,
            height_m=height or Measured(usual_m, 1.0),
            yaw_deg=picture.yaw_deg or Measured(0.0, 180.0),
            pitch_deg=picture.pitch_deg or Measured(-90.0, 5.0),
        )
        for picture, height in zip(pictures, heights, strict=True)
        if picture.position is not None
    ]
    verdicts = credible(filled, mission, any_day=any_day)
    return {
        picture.name: verdict
        for picture, verdict in zip(filled, verdicts, strict=True)
        if isinstance(verdict, str)
    }


def _since(entry: Placed, first_s: float) -> Placed:
    taken_s = entry.picture.taken_s
    return replace(entry, taken_s=None if taken_s is None else taken_s - first_s)


# --- one picture ---------------------------------------------------------------------------------
def _placed(picture: Picture, mission: Mission | None) -> Verdict:
    position = picture.position
    if position is None:
        return _noted(picture, "GPS", "geotag") or "no geotag"
    if abs(position.lat_deg) < 1e-3 and abs(position.lon_deg) < 1e-3:
        return "its geotag is 0, 0: the receiver had no position"
    if abs(position.lat_deg) > MAX_LATITUDE_DEG:
        return f"its geotag is at {position.lat_deg:.4f} deg of latitude: no map is made there"
    height_m = _height_m(picture, mission)
    if isinstance(height_m, str):
        return height_m
    attitude = _attitude(picture, mission)
    if isinstance(attitude, str):
        return attitude
    return Placed(picture, Pose(position, height_m, attitude), None)


def _height_m(picture: Picture, mission: Mission | None) -> float | str:
    height = picture.height_m
    level_known = mission is not None and "amsl_m" in mission.start.model_fields_set
    if height is None and picture.amsl_m is not None and mission is not None and level_known:
        height = Measured(picture.amsl_m.value - mission.start.amsl_m, picture.amsl_m.sigma)
    if height is None:
        return _noted(picture, "Altitude", "XMP is not") or (
            "no height above the ground: XMP drone-dji:RelativeAltitude is missing (EXIF altitude "
            "is above sea level); write it, for example with exiftool "
            '-xmp-drone-dji:RelativeAltitude="+40.0", or give the ground\'s height as start.amsl_m '
            "in the mission file"
        )
    if height.value <= 0.0:
        return f"its height is {height.value:.1f} m: not above the place of take-off"
    if height.value < _MIN_HEIGHT_M:
        return f"its height is {height.value:.2f} m: a map needs {_MIN_HEIGHT_M:g} m at least"
    if height.value > _MAX_HEIGHT_M:
        return f"its height is {height.value:.0f} m: no aircraft of this kind is as high"
    return height.value


def _attitude(picture: Picture, mission: Mission | None) -> Quaternion | str:
    pitch, roll = picture.pitch_deg, picture.roll_deg
    if pitch is None and mission is not None and mission.camera.mounting == "gimbal":
        pitch = Measured(-90.0, 5.0)
    if picture.yaw_deg is None:
        return _noted(picture, "Yaw", "Pitch", "Orientation", "XMP is not") or (
            "no heading: XMP drone-dji:GimbalYawDegree (or Camera:Yaw) is missing"
        )
    if pitch is None:
        return _noted(picture, "Pitch", "XMP is not") or (
            "no pitch: XMP drone-dji:GimbalPitchDegree (or Camera:Pitch) is missing; for a camera "
            'that always looks straight down, write camera.mounting = "gimbal" in the mission file'
        )
    if not MIN_DOWN_DEG - 180.0 <= pitch.value <= -MIN_DOWN_DEG:
        side = "above" if pitch.value > 0.0 else "below"
        return (
            f"its camera points {abs(pitch.value):.0f} deg {side} the horizon; at least "
            f"{MIN_DOWN_DEG:g} below it are needed"
        )
    roll_deg = 0.0 if roll is None else roll.value
    angles = (math.radians(a) for a in (roll_deg, pitch.value, picture.yaw_deg.value))
    return Quaternion.from_euler(*angles)


def _noted(picture: Picture, *words: str) -> str | None:
    """Return the source's note on a tag that it could not use."""
    return next((note for note in picture.notes if any(word in note for word in words)), None)


# --- the set -------------------------------------------------------------------------------------
@dataclass(frozen=True, slots=True)
class _Usual:
    """The usual place, height and time of the pictures of a set; None if too few give it."""

    middle: LatLon
    whose: str
    height_m: float | None
    taken_s: float | None

    @classmethod
    def from_pictures(
        cls, usable: Sequence[Placed], mission: Mission | None, *, any_day: bool
    ) -> _Usual:
        places = [entry.pose.position for entry in usable]
        middle, whose = LatLon(0.0, 0.0), "the others"
        if mission is not None:
            middle, whose = mission.home, "the mission's start"
        elif places:
            middle = LatLon(
                median_low(place.lat_deg for place in places),
                median_low(place.lon_deg for place in places),
            )
        times = [e.picture.taken_s for e in usable if e.picture.taken_s is not None]
        return cls(
            middle,
            whose,
            median_low(e.pose.height_m for e in usable) if len(usable) >= _MIN_SET else None,
            median_low(times) if len(times) >= _MIN_SET and not any_day else None,
        )

    def refusal(self, entry: Placed) -> str | None:
        """Return the reason why a picture does not belong to this set."""
        away_m = distance_m(entry.pose.position, self.middle)
        if away_m > FARTHEST_M:
            return f"it was taken {away_m / 1000.0:,.0f} km from {self.whose}"
        height_m, usual_m = entry.pose.height_m, self.height_m
        if usual_m and not usual_m / HEIGHT_RATIO <= height_m <= usual_m * HEIGHT_RATIO:
            return f"its height is {height_m:.0f} m, that of the others about {usual_m:.0f} m"
        taken_s = entry.picture.taken_s
        if taken_s is None or self.taken_s is None or abs(taken_s - self.taken_s) <= OTHER_DAY_S:
            return None
        days = abs(taken_s - self.taken_s) / 86400.0
        when = "after" if taken_s > self.taken_s else "before"
        return (
            f"it was taken {days:,.1f} days {when} the others, by its EXIF date (--any-day uses it)"
        )


def distance_m(one: LatLon, other: LatLon) -> float:
    """Return the approximate distance of two places, on a sphere.

    >>> round(distance_m(LatLon(0.0, 0.0), LatLon(0.0, 180.0)) / 1000)
    20015
    """
    a, b = math.radians(one.lat_deg), math.radians(other.lat_deg)
    east = math.radians(other.lon_deg - one.lon_deg)
    half = math.sin((b - a) / 2) ** 2 + math.cos(a) * math.cos(b) * math.sin(east / 2) ** 2
    return 2.0 * _EARTH_M * math.asin(min(1.0, math.sqrt(half)))


def above_ground(pose: Pose, setting: Setting) -> Pose:
    """Return a pose with its height above the ground below, instead of above the start.

    On flat ground both are the same. The photographer started at the mission's start.
    """
    if setting.ground is None:
        return pose
    ground_m = setting.ground.height_m(setting.grid.fixed(pose.position))
    start_m = setting.ground.height_m(setting.grid.fixed(setting.mission.home))
    return replace(pose, height_m=pose.height_m - (ground_m - start_m))
