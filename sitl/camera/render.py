"""The view of a camera on a tilted vehicle of the world, rendered as JPEG."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import TypeAlias

import cv2
import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from sitl.camera.pinhole import (
    CameraSpec,
    Shot,
    ground_to_pixel,
    image_motion_px,
    pixels_of,
    seen_ground,
)
from sitl.camera.tag_layer import shows_tag, with_tags
from sitl.world.ground import (
    METRES_PER_PIXEL,
    TILE_M,
    TILE_PX,
    Gray,
    Matrix,
    Orthophoto,
    Picture,
    Relief,
)
from sitl.world.world import World

Rgb: TypeAlias = tuple[int, int, int]
Outlines: TypeAlias = list[npt.NDArray[np.int32]]
_JPEG_QUALITY = 90
_SHIFT = 4  # binary digits of a pixel's fraction in polygon filling
_NOISE_MARGIN_PX = 97
_NOISE_SEED = 5
_SHARP_PX = 0.5  # a motion below this makes no visible blur
_SMEAR_SAMPLES = 4  # for each pixel of the way of a point during the exposure
# Brightness of blue, green, red over gray for grass; 0.114 b + 0.587 g + 0.299 r stays 1
_GRASS_BGR = (0.80, 1.06, 0.9603)


def render(world: World, camera: CameraSpec, shot: Shot) -> bytes:
    """Return the JPEG that the camera takes; the same arguments give the same bytes."""
    homography = ground_to_pixel(camera, shot)
    view = _paint(world, camera, shot, homography)
    view = _smeared(view, *image_motion_px(camera, shot))
    tag_m = world.spec.tag_m
    if shot.tags and shows_tag(camera, shot, tag_m):
        paper = view if view.ndim == 3 else _coloured(world, view)
        view = with_tags(paper, camera, shot, tag_m, world.spec.tag_dictionary)
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


def _smeared(picture: Picture, right_px: float, down_px: float) -> Picture:
    length_px = math.hypot(right_px, down_px)
    if length_px < _SHARP_PX:
        return picture
    reach = math.ceil(length_px / 2.0) + 1
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1), np.float32)
    samples = _SMEAR_SAMPLES * math.ceil(length_px)
    shares = (np.arange(samples) + 0.5) / samples - 0.5
    u, v = reach + shares * right_px, reach + shares * down_px
    column, row = np.floor(u).astype(int), np.floor(v).astype(int)
    right, low = u - column, v - row  # each sample is shared out among the four pixels around it
    np.add.at(kernel, (row, column), (1 - low) * (1 - right))
    np.add.at(kernel, (row, column + 1), (1 - low) * right)
    np.add.at(kernel, (row + 1, column), low * (1 - right))
    np.add.at(kernel, (row + 1, column + 1), low * right)
    kernel /= kernel.sum()
    smeared = cv2.filter2D(picture, -1, kernel, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(smeared, dtype=np.uint8)


def _coloured(world: World, gray: Gray) -> Picture:
    palette = _palette(world.spec.roi_intensity, world.spec.ground_intensity)
    return np.asarray(cv2.applyColorMap(gray, palette), dtype=np.uint8)


def _paint(world: World, camera: CameraSpec, shot: Shot, homography: Matrix) -> Picture:
    """Return ground and ROI without light or noise: gray, or in colour over an orthophoto."""
    size = (camera.width_px, camera.height_px)
    to_ground = np.asarray(np.linalg.inv(homography), dtype=np.float64)
    if world.spec.relief is not None:
        return _paint_relief(world, world.spec.relief, camera, shot, homography, to_ground)
    ground = _warp(world.ground_texture, to_ground, shot.east_m, shot.north_m, size)
    if world.spec.orthophoto is not None:
        ground = _photographed(world, world.spec.orthophoto, camera, shot, to_ground, ground)
    # the ROI's own frame: the camera moves backwards instead of the polygon forwards
    drift_east, drift_north = world.drift_at(shot.t_s)
    east, north = shot.east_m - drift_east, shot.north_m - drift_north
    films = [
        (rgb, _outlines(film, camera, homography, to_ground, east, north))
        for rgb, film in world.films
    ]
    if not any(outlines for _, outlines in films):
        return ground
    return _with_films(world, _warp(world.roi_texture, to_ground, east, north, size), ground, films)


def _paint_relief(
    world: World,
    relief: Relief,
    camera: CameraSpec,
    shot: Shot,
    homography: Matrix,
    to_ground: Matrix,
) -> Picture:
    east, north = seen_ground(camera, shot, to_ground, relief)
    ground = _wrapped(world.ground_texture, east + shot.east_m, north + shot.north_m)
    drift_east, drift_north = world.drift_at(shot.t_s)
    from_east, from_north = shot.east_m - drift_east, shot.north_m - drift_north
    box = shapely.box(
        float(east.min()) + from_east - 1.0,
        float(north.min()) + from_north - 1.0,
        float(east.max()) + from_east + 1.0,
        float(north.max()) + from_north + 1.0,
    )
    if not world.roi_at_rest.intersects(box):
        return ground

    def outlines(film: BaseGeometry) -> Outlines:
        clipped = shapely.segmentize(shapely.clip_by_rect(film, *box.bounds), 1.0)
        return [
            _fixed(
                pixels_of(homography, shot, relief, ring[:, 0] - from_east, ring[:, 1] - from_north)
            )
            for ring in _rings(shapely.get_parts(clipped))
        ]

    roi = _wrapped(world.roi_texture, east + from_east, north + from_north)
    films = [(rgb, outlines(film)) for rgb, film in world.films]
    return _with_films(world, roi, ground, films)


def _fixed(pixels: Matrix) -> npt.NDArray[np.int32]:
    return np.round(pixels * (1 << _SHIFT)).astype(np.int32)


def _with_films(
    world: World, roi: Gray, ground: Picture, films: Sequence[tuple[Rgb | None, Outlines]]
) -> Picture:
    """Draw the films of the ROI over the ground, each within its outlines and over those before
    it."""
    view = ground
    for rgb, outlines in films:
        if not outlines:
            continue
        if rgb is not None and view.ndim == 2:
            view = _coloured(world, view)
        film: Picture = roi
        if rgb is not None:
            film = _tinted(roi, world.spec.roi_intensity, rgb)
        elif view.ndim == 3:
            film = _coloured(world, roi)
        mask = np.zeros(view.shape[:2], np.uint8)
        cv2.fillPoly(mask, outlines, 255, cv2.LINE_AA, _SHIFT)
        left, top, columns, rows = cv2.boundingRect(mask)
        if columns:
            at = slice(top, top + rows), slice(left, left + columns)
            view[at] = _blend(film[at], view[at], mask[at])
    return view


def _tinted(gray: Gray, mean: float, rgb: Rgb) -> Picture:
    """Return the pattern of a gray film around a colour, blue-green-red."""
    levels = np.arange(256, dtype=np.float64)[:, None] - mean
    table = np.clip(np.round(np.array(rgb[::-1]) + levels), 0, 255).astype(np.uint8)
    return np.asarray(cv2.applyColorMap(gray, table[:, None, :]), dtype=np.uint8)


def _wrapped(tile: Gray, east_m: Matrix, north_m: Matrix) -> Gray:
    """Return a wrapping tile, fixed to the plane, at the places of all pixels."""
    scale = 1.0 / METRES_PER_PIXEL
    columns = (TILE_PX / 2.0 + (east_m % TILE_M) * scale).astype(np.float32)
    rows = (TILE_PX * 1.5 - (north_m % TILE_M) * scale).astype(np.float32)
    # the pattern twice by twice: a pixel lies in it wherever it wraps
    return np.asarray(cv2.remap(tile, columns, rows, cv2.INTER_LINEAR), dtype=np.uint8)


def _blend(upper: Picture, lower: Picture, mask: Gray) -> Picture:
    """Return `upper` if the mask is 255, `lower` if it is 0."""
    view = lower.copy()
    cv2.copyTo(upper, mask, view)
    rim = cv2.findNonZero(cv2.inRange(mask, (1.0,), (254.0,)))
    if rim is not None:  # few pixels are blended: to blend all of them takes twice the time
        columns, rows = np.asarray(rim).reshape(-1, 2).T
        share = mask[rows, columns, None] * np.float32(1.0 / 255.0)
        pair = upper[rows, columns, None], lower[rows, columns, None]
        view[rows, columns] = cv2.blendLinear(*pair, share, np.float32(1.0) - share)[:, 0]
    return view


def _photographed(
    world: World, photo: Orthophoto, camera: CameraSpec, shot: Shot, to_ground: Matrix, meadow: Gray
) -> Picture:
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
    """Return the outer corners of the picture, (3, 4), homogeneous pixels."""
    right, low = camera.width_px - 0.5, camera.height_px - 0.5
    return np.array([[-0.5, right, right, -0.5], [-0.5, -0.5, low, low], [1.0] * 4])


def _warp(
    tile: Gray, to_ground: Matrix, east_m: float, north_m: float, size: tuple[int, int]
) -> Gray:
    """Return a wrapping tile, fixed to the plane, seen from above (east_m, north_m).

    The camera is placed in the middle half of `tile`, which holds its pattern twice by twice. So a
    footprint up to the pattern's size touches no edge, where OpenCV is three times slower.
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
    roi: BaseGeometry,
    camera: CameraSpec,
    homography: Matrix,
    to_ground: Matrix,
    east_m: float,
    north_m: float,
) -> Outlines:
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
    if not roi.intersects(shapely.box(*box)):
        return []
    clipped = shapely.clip_by_rect(roi, *box)
    outlines = []
    for ring in _rings(shapely.get_parts(clipped)):
        points = np.ones((3, len(ring)))
        points[0], points[1] = ring[:, 0] - east_m, ring[:, 1] - north_m
        pixels = homography @ points
        pixels = pixels[:2] / np.maximum(pixels[2], 1e-3)
        outlines.append(_fixed(pixels.T))
    return outlines


def _rings(parts: Iterable[object]) -> Iterable[Matrix]:
    for part in parts:
        if isinstance(part, MultiPolygon):
            yield from _rings(part.geoms)
        elif isinstance(part, Polygon):
            for ring in (part.exterior, *part.interiors):
                yield np.asarray(ring.coords, dtype=np.float64)


def _noise(camera: CameraSpec, std: float, world_seed: int, seed: int) -> npt.NDArray[np.int16]:
    """Return a frame of sensor noise: a window of a large noise picture, placed by the seed."""
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
    """Return gray level to BGR: gray up to the ROI's brightness, greenish at the ground's."""
    levels = np.arange(256, dtype=np.float64)
    span = ground_intensity - roi_intensity
    grass = np.clip((levels - roi_intensity) / (span if abs(span) > 1.0 else 1.0), 0.0, 1.0)
    tint = 1.0 + grass[:, None] * (np.array(_GRASS_BGR)[None, :] - 1.0)
    return np.clip(np.round(levels[:, None] * tint), 0, 255).astype(np.uint8)[:, None, :]
