"""What a camera on a tilted vehicle sees of the world: an own pinhole model, rendered as JPEG.

Frames: NED (true north, true east, down) with its origin on the ground; the camera's axes are
forward (optical axis), right, down (lower edge of the picture). Pixels: u to the right, v down,
(0, 0) the centre of the upper left pixel, the optical axis at ((width - 1) / 2, (height - 1) / 2).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry import MultiPolygon, Polygon

from missions.units import Quaternion
from sitl.world.orthophoto import Matrix, Orthophoto, Picture
from sitl.world.texture import METRES_PER_PIXEL, TILE_M, TILE_PX, Gray
from sitl.world.world import World

_JPEG_QUALITY = 90
_LENS_OVER_GROUND_M = 0.1  # of a landed vehicle
_MAX_HALF_DIAGONAL_DEG = 55.0  # with the tilt limit this keeps the horizon out of the picture
_SHIFT = 4  # binary digits of a pixel's fraction in polygon filling
_NOISE_MARGIN_PX = 97
_NOISE_SEED = 5
# Brightness of blue, green, red over gray for grass; 0.114 b + 0.587 g + 0.299 r stays 1
_GRASS_BGR = (0.80, 1.06, 0.9603)


@dataclass(frozen=True, slots=True)
class CameraSpec:
    """A camera on a multicopter, looking down.

    `hfov_deg` is the horizontal field of view over the whole width. `fixed`: bolted to the body,
    so it tilts along; else a gimbal holds it at nadir and only the heading turns it. `yaw_deg`:
    bearing of the picture's upper edge relative to the nose. `min_interval_s`: shortest time
    between two pictures.
    """

    hfov_deg: float = 70.0
    width_px: int = 640
    height_px: int = 480
    fixed: bool = True
    yaw_deg: float = 0.0
    min_interval_s: float = 0.2

    def __post_init__(self) -> None:
        if not (self.width_px >= 16 and self.height_px >= 16 and 5.0 <= self.hfov_deg <= 105.0):
            raise ValueError(f"a camera that cannot be simulated: {self}")
        diagonal = math.hypot(self.width_px, self.height_px) / 2.0
        if math.degrees(math.atan2(diagonal, self.focal_px)) > _MAX_HALF_DIAGONAL_DEG:
            raise ValueError(f"the field of view reaches the horizon when it tilts: {self}")

    @property
    def focal_px(self) -> float:
        """Focal length in pixels.

        >>> round(CameraSpec(hfov_deg=90.0, width_px=640).focal_px, 9)
        320.0
        """
        return self.width_px / 2.0 / math.tan(math.radians(self.hfov_deg) / 2.0)

    def attitude(self, roll_rad: float, pitch_rad: float, yaw_rad: float) -> Quaternion:
        """Camera axes to NED for the body's attitude, as in CAMERA_IMAGE_CAPTURED."""
        mounting = Quaternion.from_euler(0.0, -math.pi / 2.0, 0.0)
        turned = Quaternion.from_euler(0.0, 0.0, math.radians(self.yaw_deg))
        if not self.fixed:
            roll_rad = pitch_rad = 0.0
        body = Quaternion.from_euler(roll_rad, pitch_rad, yaw_rad)
        return _product(body, _product(turned, mounting))


@dataclass(frozen=True, slots=True)
class Shot:
    """The true moment of an exposure: place in the world's plane, attitude, time."""

    east_m: float
    north_m: float
    height_m: float
    attitude: Quaternion
    t_s: float
    noise_seed: int


def ground_to_pixel(camera: CameraSpec, shot: Shot) -> Matrix:
    """The homography from ground (east, north, 1), metres *relative to the camera's foot point*,
    to homogeneous pixels.

    The point's pixel is the first two components divided by the third, which is its depth.
    """
    rotation = _matrix(shot.attitude)  # columns: forward, right, down of the camera in NED
    height = max(shot.height_m, 0.0) + _LENS_OVER_GROUND_M
    # a ground point (east, north) is (north, east, height) from the lens, in NED
    to_ned = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, height]])
    focal = camera.focal_px
    centre_u, centre_v = (camera.width_px - 1) / 2.0, (camera.height_px - 1) / 2.0
    to_pixel = np.array([[centre_u, focal, 0.0], [centre_v, 0.0, focal], [1.0, 0.0, 0.0]])
    return np.asarray(to_pixel @ rotation.T @ to_ned, dtype=np.float64)


def render(world: World, camera: CameraSpec, shot: Shot) -> bytes:
    """The JPEG that the camera takes; the same arguments give the same bytes."""
    homography = ground_to_pixel(camera, shot)
    view = _paint(world, camera, shot, homography)
    gain = world.illumination_at(shot.t_s)
    view = np.asarray(cv2.convertScaleAbs(view, alpha=gain), dtype=np.uint8)
    if world.spec.sensor_noise > 0.0:
        noise = _noise(camera, world.spec.sensor_noise, world.spec.seed, shot.noise_seed)
        if view.ndim == 3:
            noise = np.asarray(cv2.merge((noise, noise, noise)), dtype=np.int16)
        view = np.asarray(cv2.add(view, noise, dtype=cv2.CV_8U), dtype=np.uint8)
    colour = view if view.ndim == 3 else _coloured(world, view)
    done, data = cv2.imencode(".jpg", colour, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    if not done:
        raise RuntimeError("OpenCV could not encode a rendered frame")
    return bytes(data)


def _coloured(world: World, gray: Gray) -> Picture:
    palette = _palette(world.spec.roi_intensity, world.spec.ground_intensity)
    return np.asarray(cv2.applyColorMap(gray, palette), dtype=np.uint8)


def _paint(world: World, camera: CameraSpec, shot: Shot, homography: Matrix) -> Picture:
    """Ground and ROI without light or noise: gray, or in colour over an orthophoto."""
    size = (camera.width_px, camera.height_px)
    to_ground = np.asarray(np.linalg.inv(homography), dtype=np.float64)
    ground = _warp(world.ground_texture, to_ground, shot.east_m, shot.north_m, size)
    if world.spec.orthophoto is not None:
        ground = _photographed(world, world.spec.orthophoto, camera, shot, to_ground, ground)
    # the ROI's own frame: the camera moves backwards instead of the polygon forwards
    drift_east, drift_north = world.drift_at(shot.t_s)
    east, north = shot.east_m - drift_east, shot.north_m - drift_north
    outlines = _outlines(world, camera, homography, to_ground, east, north)
    if not outlines:
        return ground
    mask = np.zeros((camera.height_px, camera.width_px), np.uint8)
    cv2.fillPoly(mask, outlines, 255, cv2.LINE_AA, _SHIFT)
    roi = _warp(world.roi_texture, to_ground, east, north, size)
    return _blend(roi if ground.ndim == 2 else _coloured(world, roi), ground, mask)


def _blend(upper: Picture, lower: Picture, mask: Gray) -> Picture:
    """`upper` where the mask is 255, `lower` where it is 0."""
    share = mask.astype(np.float32) * np.float32(1.0 / 255.0)
    blended = cv2.blendLinear(upper, lower, share, np.float32(1.0) - share)
    return np.asarray(blended, dtype=np.uint8)


def _photographed(
    world: World,
    photo: Orthophoto,
    camera: CameraSpec,
    shot: Shot,
    to_ground: Matrix,
    meadow: Gray,
) -> Picture:
    """The orthophoto from above, in colour, and the meadow where it does not reach."""
    corners = _corners(camera)
    ground = to_ground @ corners
    east, north = ground[:2] / ground[2]
    places = [
        world.plane.to_wgs84(float(e) + shot.east_m, float(n) + shot.north_m)
        for e, n in zip(east, north, strict=True)
    ]
    size = (camera.width_px, camera.height_px)
    picture, known = photo.seen(places, corners[:2].T, size)
    return picture if known.min() == 255 else _blend(picture, _coloured(world, meadow), known)


def _corners(camera: CameraSpec) -> Matrix:
    """The outer corners of the picture, (3, 4), homogeneous pixels."""
    right, low = camera.width_px - 0.5, camera.height_px - 0.5
    return np.array([[-0.5, right, right, -0.5], [-0.5, -0.5, low, low], [1.0] * 4])


def _warp(
    tile: Gray, to_ground: Matrix, east_m: float, north_m: float, size: tuple[int, int]
) -> Gray:
    """A wrapping tile, fixed to the plane, as seen from above (east_m, north_m).

    `tile` is its own pattern twice by twice, and the camera is placed in the middle half of it:
    footprints up to the pattern's size never touch an edge, where OpenCV is three times slower.
    """
    scale = 1.0 / METRES_PER_PIXEL
    middle = TILE_PX / 2.0
    to_tile = np.array(
        [
            [scale, 0.0, middle + (east_m % TILE_M) * scale],
            [0.0, -scale, middle + TILE_PX - (north_m % TILE_M) * scale],
            [0.0, 0.0, 1.0],
        ]
    )
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    warped = cv2.warpPerspective(
        tile, to_tile @ to_ground, size, flags=flags, borderMode=cv2.BORDER_WRAP
    )
    return np.asarray(warped, dtype=np.uint8)


def _outlines(
    world: World,
    camera: CameraSpec,
    homography: Matrix,
    to_ground: Matrix,
    east_m: float,
    north_m: float,
) -> list[npt.NDArray[np.int32]]:
    """Rings of the ROI around the picture, in fixed-point pixels; filled even-odd, holes too."""
    ground = to_ground @ _corners(camera)
    east, north = ground[:2] / ground[2]
    margin = 0.1 * (np.ptp(east) + np.ptp(north)) + 0.1
    box = (
        float(east.min() - margin) + east_m,
        float(north.min() - margin) + north_m,
        float(east.max() + margin) + east_m,
        float(north.max() + margin) + north_m,
    )
    if not world.roi_at_rest.intersects(shapely.box(*box)):
        return []
    clipped = shapely.clip_by_rect(world.roi_at_rest, *box)
    outlines = []
    for ring in _rings(shapely.get_parts(clipped)):
        points = np.ones((3, len(ring)))
        points[0], points[1] = ring[:, 0] - east_m, ring[:, 1] - north_m
        pixels = homography @ points
        pixels = pixels[:2] / np.maximum(pixels[2], 1e-3)
        outlines.append(np.round(pixels.T * (1 << _SHIFT)).astype(np.int32))
    return outlines


def _rings(parts: Iterable[object]) -> Iterable[Matrix]:
    for part in parts:
        if isinstance(part, MultiPolygon):
            yield from _rings(part.geoms)
        elif isinstance(part, Polygon):
            for ring in (part.exterior, *part.interiors):
                yield np.asarray(ring.coords, dtype=np.float64)


def _noise(camera: CameraSpec, std: float, world_seed: int, seed: int) -> npt.NDArray[np.int16]:
    """A frame of sensor noise: a window of a large noise picture, placed by the shot's seed."""
    bank = _noise_bank(camera.width_px, camera.height_px, std, world_seed)
    rng = np.random.default_rng([world_seed, _NOISE_SEED, seed])
    row, column = rng.integers(0, _NOISE_MARGIN_PX, 2)
    return bank[row : row + camera.height_px, column : column + camera.width_px]


@lru_cache(maxsize=4)
def _noise_bank(width: int, height: int, std: float, seed: int) -> npt.NDArray[np.int16]:
    rng = np.random.default_rng([seed, _NOISE_SEED])
    shape = (height + _NOISE_MARGIN_PX, width + _NOISE_MARGIN_PX)
    return np.round(std * rng.standard_normal(shape)).astype(np.int16)


@lru_cache(maxsize=4)
def _palette(roi_intensity: float, ground_intensity: float) -> Gray:
    """Gray level to BGR: gray up to the ROI's brightness, greenish at the ground's."""
    levels = np.arange(256, dtype=np.float64)
    span = ground_intensity - roi_intensity
    grass = np.clip((levels - roi_intensity) / (span if abs(span) > 1.0 else 1.0), 0.0, 1.0)
    tint = 1.0 + grass[:, None] * (np.array(_GRASS_BGR)[None, :] - 1.0)
    return np.clip(np.round(levels[:, None] * tint), 0, 255).astype(np.uint8)[:, None, :]


def _matrix(q: Quaternion) -> Matrix:
    """Rotation matrix of a unit quaternion."""
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _product(a: Quaternion, b: Quaternion) -> Quaternion:
    """First `b`, then `a`."""
    return Quaternion(
        a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z,
        a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
        a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
        a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w,
    )
