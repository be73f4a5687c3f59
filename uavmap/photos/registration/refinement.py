"""Recorded pictures to a registration and back: TaggedPicture -> View -> Refined -> Pose."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.geo.geodesy import LocalPlane
from missions.geo.grid import Grid
from missions.geo.terrain import Terrain
from missions.units import GridPoint, LatLon, Pose, Quaternion
from uavmap.photos.sources.picture_record import Picture
from vision.camera import rotation
from vision.registration.ground_plane import Relief
from vision.registration.registering import Many, register
from vision.registration.views import FeaturesLike, Measured, Refined, Registration, View

UNKNOWN_TILT_RAD: Final = math.radians(7.0)
"""Standard deviation of a camera's tilt from straight down without a tag, rad."""


@dataclass(frozen=True, slots=True)
class TaggedPicture:
    """A picture before its overlaps are known.

    Attributes:
        picture: Picture as tagged, with a position.
        focal_sigma: Standard deviation of the focal length, as a share.
    """

    picture: Picture
    features: FeaturesLike
    hfov_rad: float
    focal_sigma: float

    @property
    def position(self) -> LatLon:
        """Position of the geotag."""
        assert self.picture.position is not None
        return self.picture.position

    @property
    def height_m(self) -> Measured | None:
        """Height above the ground; None without a tag above 0."""
        height = self.picture.height_m
        return height if height and height.value > 0.0 else None

    @property
    def focal_px(self) -> float:
        """Focal length in pixels of the features."""
        return self.features.width_px / 2.0 / math.tan(self.hfov_rad / 2.0)


@dataclass(frozen=True, slots=True)
class RefinedPicture:
    """The pose of a picture after registration.

    `tag_position` is the camera's position. `pose` has the camera at the point from which level
    ground would show the same picture: on a slope it differs a little. `focal_ratio` is relative to
    the focal length as tagged.
    """

    pose: Pose
    hfov_rad: float
    focal_ratio: float
    tag_position: LatLon
    refined: Refined


def refine(
    taken: Sequence[TaggedPicture],
    ground: tuple[Grid, Terrain] | None = None,
    progress: Callable[[int, int], None] = lambda done, all_: None,
    many: Many = map,
) -> tuple[Registration, Mapping[str, RefinedPicture]]:
    """Register pictures; return the registration, and the refined pictures by name.

    `ground` is the terrain in the metres of a grid, if it is not flat. Heights are then above the
    ground at the grid's start.
    """
    if not taken:
        return Registration((), (), (), None, None), {}
    plane = LocalPlane(_middle([t.position for t in taken]))
    relief = None
    if ground is not None:
        grid, terrain = ground
        start_m = terrain.height_m(GridPoint(0.0, 0.0))
        relief = Relief.from_terrain(
            terrain, start_m, lambda e, n: grid.fixed(plane.to_wgs84(e, n))
        )
    result = register([_view(t, plane, relief) for t in taken], progress, many, relief)
    return result, {
        one.picture.name: _refined_picture(refined, one, plane, result)
        for one, refined in zip(taken, result.refined, strict=True)
        if refined is not None
    }


def _middle(positions: Sequence[LatLon]) -> LatLon:
    """Return the median of positions, which a single outlier does not move."""
    lat = float(np.median([p.lat_deg for p in positions]))
    lon0 = positions[0].lon_deg
    away = float(np.median([math.remainder(p.lon_deg - lon0, 360.0) for p in positions]))
    return LatLon(lat, math.remainder(lon0 + away, 360.0))


def _view(taken: TaggedPicture, plane: LocalPlane, relief: Relief | None) -> View:
    picture, features, focal_px = taken.picture, taken.features, taken.focal_px
    east_m, north_m = plane.to_plane(taken.position)
    tilt, tilt_sigma = (0.0, 0.0), UNKNOWN_TILT_RAD
    yaw = None if picture.yaw_deg is None else Measured(*map(math.radians, picture.yaw_deg))
    if picture.pitch_deg is not None:
        pitch, tilt_sigma = map(math.radians, picture.pitch_deg)
        roll = 0.0 if picture.roll_deg is None else math.radians(picture.roll_deg.value)
        yaw_rad = 0.0 if yaw is None else yaw.value
        matrix = rotation(Quaternion.from_euler(roll, pitch, yaw_rad))
        forward, right, down = matrix[2]  # components of straight down, in camera axes
        tilt = (right / max(forward, 1e-3), down / max(forward, 1e-3))
        if yaw is not None:
            upper_north, upper_east = -matrix[0, 2], -matrix[1, 2]
            yaw = yaw._replace(value=math.atan2(upper_east, upper_north))
    return View(
        picture.name,
        features,
        Measured(focal_px, taken.focal_sigma * focal_px),
        f"{math.degrees(taken.hfov_rad):.1f} deg "
        f"{features.width_px} x {features.height_px} px, {focal_px:.1f} px",
        east_m,
        north_m,
        picture.position_sigma_m,
        taken.height_m,
        yaw,
        tilt,
        tilt_sigma,
        0.0 if relief is None else float(relief.at(np.array([[east_m, north_m]]))[0]),
    )


def _refined_picture(
    refined: Refined, taken: TaggedPicture, plane: LocalPlane, result: Registration
) -> RefinedPicture:
    east_m, north_m, height_m = (float(x) for x in refined.centre_m)
    slope_e, slope_n = result.nets[refined.component].slope
    return RefinedPicture(
        Pose(plane.to_wgs84(east_m, north_m), height_m, attitude(refined.axes)),
        2.0 * math.atan(taken.features.width_px / 2.0 / refined.focal_px),
        refined.focal_px / taken.focal_px,
        plane.to_wgs84(east_m + height_m * slope_e, north_m + height_m * slope_n),
        refined,
    )


def attitude(axes: NDArray[np.float64]) -> Quaternion:
    """Return camera axes to NED, from the picture's right, down and forward in (east, north, up).

    >>> down_north = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
    >>> wanted = Quaternion.from_euler(0.0, math.radians(-90.0), 0.0)
    >>> bool(np.allclose(attitude(down_north), wanted))
    True
    """
    right, down, forward = axes.T
    m = np.array([[v[1], v[0], -v[2]] for v in (forward, right, down)]).T
    # Shepperd's method: of four formulas, the one that divides by the largest number
    squares = np.array(
        [
            1.0 + m[0, 0] + m[1, 1] + m[2, 2],
            1.0 + m[0, 0] - m[1, 1] - m[2, 2],
            1.0 - m[0, 0] + m[1, 1] - m[2, 2],
            1.0 - m[0, 0] - m[1, 1] + m[2, 2],
        ]
    )
    largest = int(squares.argmax())
    a, b, c = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    d, e, f = m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1]
    s = squares[largest]
    rows = [(s, a, b, c), (a, s, d, e), (b, d, s, f), (c, e, f, s)]
    w, x, y, z = np.array(rows[largest]) / (2.0 * math.sqrt(s))
    sign = 1.0 if w >= 0.0 else -1.0
    return Quaternion(*(float(sign * v) for v in (w, x, y, z)))
