"""Recorded pictures to the registration and back: tags to views, refined poses to poses.

tags, pixels -> View -> vision.registration.register -> Refined -> Pose, focal length
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.geo.geodesy import LocalPlane
from missions.geo.grid import Grid
from missions.geo.terrain import Terrain
from missions.units import GridPoint, LatLon, Pose, Quaternion
from vision.camera import rotation
from vision.registration import (
    Described,
    Many,
    Prior,
    Refined,
    Registration,
    Relief,
    View,
    extract,
    register,
    thumbnail,
)

POSITION_SIGMA_M: Final = 10.0
TILT_SIGMA_RAD: Final = math.radians(2.0)
"""Of a tagged tilt: a gimbal's. Without a tag a camera looks down within `UNKNOWN_TILT_RAD`."""

UNKNOWN_TILT_RAD: Final = math.radians(7.0)
FOCAL_SIGMA: Final = 0.05
UNKNOWN_FOCAL_SIGMA: Final = 0.15
"""Of a focal length that no tag tells, and a mission file does for all cameras, as a share."""


@dataclass(frozen=True, slots=True)
class Tags:
    """What is known of a picture before its overlaps are looked at; None where tags are silent.

    Attributes:
        name: of the picture; no two have the same.
        position: the geotag.
        position_sigma_m: standard deviation of its coordinates, beside what all have in common.
        hfov_rad: angle of view across the picture.
        hfov_sigma: standard deviation of the focal length that goes with it, as a share.
        camera: pictures with the same word were taken with one lens.
        height_m: above the ground, with its standard deviation.
        yaw_rad: as `Quaternion.from_euler` takes it, with its standard deviation.
        pitch_rad: of the optical axis, -pi/2 straight down.
        roll_rad: about it.
        tilt_sigma_rad: standard deviation of what both tell of the tilt.
    """

    name: str
    position: LatLon
    hfov_rad: float
    camera: str
    position_sigma_m: float = POSITION_SIGMA_M
    hfov_sigma: float = FOCAL_SIGMA
    height_m: tuple[float, float] | None = None
    yaw_rad: tuple[float, float] | None = None
    pitch_rad: float | None = None
    roll_rad: float | None = None
    tilt_sigma_rad: float = TILT_SIGMA_RAD


@dataclass(frozen=True, slots=True)
class Found:
    """The pose of a picture after registration.

    `hfov_rad` is what its focal length makes, which is `focal_ratio` times what was told.

    `tag_position` is where the camera was. `pose` has the camera where level ground would have
    to be seen from to look the same: on a slope it stands a little beside.
    """

    pose: Pose
    hfov_rad: float
    focal_ratio: float
    tag_position: LatLon
    refined: Refined


@dataclass
class Refinement:
    """Pictures of a set on their way into a registration, and what came of it."""

    tags: list[Tags] = field(default_factory=list)
    features: list[Described] = field(default_factory=list)
    grid: Grid | None = None
    terrain: Terrain | None = None
    """The ground in the metres of `grid`, where it is known not to be flat; then heights are above
    the ground at the grid's start."""

    def add(self, tags: Tags, image: NDArray[np.uint8]) -> None:
        """Take in a picture (rows, columns[, 3]); only its features are kept."""
        self.tags.append(tags)
        self.features.append(extract(thumbnail(image)))

    def run(
        self, say: Callable[[int, int], None] = lambda done, all_: None, many: Many = map
    ) -> tuple[Registration, Mapping[str, Found]]:
        """Register; the second holds, by name, the pictures that were refined."""
        if not self.tags:
            return Registration((), (), (), None, None), {}
        plane = LocalPlane(_middle([t.position for t in self.tags]))
        relief = self._relief(plane)
        views = [_view(t, f, plane, relief) for t, f in zip(self.tags, self.features, strict=True)]
        result = register(views, say, many, relief)
        return result, {
            tags.name: _found(refined, tags, features, plane, result)
            for tags, features, refined in zip(
                self.tags, self.features, result.refined, strict=True
            )
            if refined is not None
        }

    def _relief(self, plane: LocalPlane) -> Relief | None:
        if self.terrain is None or self.grid is None:
            return None
        grid = self.grid
        start_m = self.terrain.height_m(GridPoint(0.0, 0.0))
        return Relief.of(self.terrain, start_m, lambda e, n: grid.fixed(plane.to_wgs84(e, n)))


def _middle(positions: Sequence[LatLon]) -> LatLon:
    """The median of positions, which one that is far off does not move."""
    lat = float(np.median([p.lat_deg for p in positions]))
    lon0 = positions[0].lon_deg
    away = float(np.median([math.remainder(p.lon_deg - lon0, 360.0) for p in positions]))
    return LatLon(lat, math.remainder(lon0 + away, 360.0))


def _focal_px(tags: Tags, features: Described) -> float:
    return features.width_px / 2.0 / math.tan(tags.hfov_rad / 2.0)


def _view(tags: Tags, features: Described, plane: LocalPlane, relief: Relief | None) -> View:
    east_m, north_m = plane.to_plane(tags.position)
    focal_px = _focal_px(tags, features)
    tilt, tilt_sigma = (0.0, 0.0), UNKNOWN_TILT_RAD
    yaw = None if tags.yaw_rad is None else Prior(*tags.yaw_rad)
    if tags.pitch_rad is not None:
        told = 0.0 if tags.yaw_rad is None else tags.yaw_rad[0]
        matrix = rotation(Quaternion.from_euler(tags.roll_rad or 0.0, tags.pitch_rad, told))
        forward, right, down = matrix[2]  # components of straight down, in camera axes
        tilt = (right / max(forward, 1e-3), down / max(forward, 1e-3))
        tilt_sigma = tags.tilt_sigma_rad
        if yaw is not None:
            upper_north, upper_east = -matrix[0, 2], -matrix[1, 2]
            yaw = Prior(math.atan2(upper_east, upper_north), yaw.sigma)
    return View(
        tags.name,
        features,
        Prior(focal_px, tags.hfov_sigma * focal_px),
        f"{tags.camera} {features.width_px} x {features.height_px} px, {focal_px:.1f} px",
        east_m,
        north_m,
        tags.position_sigma_m,
        None if tags.height_m is None else Prior(*tags.height_m),
        yaw,
        tilt,
        tilt_sigma,
        0.0 if relief is None else float(relief.at(np.array([[east_m, north_m]]))[0]),
    )


def _found(
    refined: Refined, tags: Tags, features: Described, plane: LocalPlane, result: Registration
) -> Found:
    east_m, north_m, height_m = (float(x) for x in refined.centre_m)
    slope_e, slope_n = result.nets[refined.component].slope
    return Found(
        Pose(plane.to_wgs84(east_m, north_m), height_m, attitude(refined.axes)),
        2.0 * math.atan(features.width_px / 2.0 / refined.focal_px),
        refined.focal_px / _focal_px(tags, features),
        plane.to_wgs84(east_m + height_m * slope_e, north_m + height_m * slope_n),
        refined,
    )


def attitude(axes: NDArray[np.float64]) -> Quaternion:
    """Camera axes to NED, from the picture's right, down and forward in (east, north, up).

    >>> down_north = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
    >>> wanted = Quaternion.from_euler(0.0, math.radians(-90.0), 0.0)
    >>> bool(np.allclose(attitude(down_north), wanted))
    True
    """
    right, down, forward = axes.T
    m = np.array([[v[1], v[0], -v[2]] for v in (forward, right, down)]).T
    # Shepperd: of the four ways the one that divides by the largest
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
