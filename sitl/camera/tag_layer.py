"""Markers on the vehicles below, put into a picture.

A pixel is the mean over a lattice of points in it, and over instants of the exposure. Each point's
ray is met with the plane of the marker. So edges are as soft as a sensor's. A marker is blurred by
its own motion over the picture, not by that of the ground.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np
import numpy.typing as npt

from sitl.camera.pinhole import CameraSpec, Shot, axes_to_ned, lens_height_m
from sitl.world.ground import Matrix, Picture
from sitl.world.tags import TagPose, modules

_BLACK, _WHITE = 25.0, 235.0  # gray levels of print on paper in the light of the ground
_FINE, _COARSE = 6, 3  # points along the edge of a pixel
_LARGE_PX = 80
_SHARP_PX = 0.25
_A_PIXEL: Final = 4  # instants for each pixel of motion
_NEAREST_M = 0.05


def with_tags(
    view: Picture, camera: CameraSpec, shot: Shot, tag_m: float, dictionary: str
) -> Picture:
    """Put the shot's markers into a picture, gray or in colour, before light and noise.

    `tag_m` is the side of a marker's black square. Higher markers hide lower ones.
    """
    painted = view
    for tag in sorted(shot.tags, key=lambda tag: tag.up_m):
        layer = _layer(camera, shot, tag, tag_m, dictionary)
        if layer is None:
            continue
        if painted is view:
            painted = view.copy()
        window, gray, share = layer
        under = painted[window].astype(np.float32)
        if under.ndim == 3:
            gray, share = gray[..., None], share[..., None]
        painted[window] = np.round(gray + (1.0 - share) * under).astype(np.uint8)
    return painted


def shows_tag(camera: CameraSpec, shot: Shot, tag_m: float) -> bool:
    """Return whether any marker may be in the picture."""
    reach_m = tag_m  # more than half a marker with its margin, for every dictionary
    return any(_outline(camera, shot, tag, reach_m) is not None for tag in shot.tags)


def _layer(
    camera: CameraSpec, shot: Shot, tag: TagPose, tag_m: float, dictionary: str
) -> tuple[tuple[slice, slice], npt.NDArray[np.float32], npt.NDArray[np.float32]] | None:
    """Return a marker's window, its brightness times its share of each pixel, and the share."""
    white = modules(dictionary, tag.number)
    count = len(white)
    half_m = tag_m / (count - 2) * count / 2.0
    outline = _outline(camera, shot, tag, half_m)
    if outline is None:
        return None
    motion = _motion_px(camera, shot, tag)
    far = math.hypot(*motion) / 2.0
    first = np.maximum(np.floor(outline.min(axis=0) - far), 0.0).astype(int)
    last = np.ceil(outline.max(axis=0) + far).astype(int) + 1
    last = np.minimum(last, (camera.width_px, camera.height_px))
    if (first >= last).any():
        return None
    fine = _COARSE if (last - first).max() > _LARGE_PX else _FINE
    inner = (np.arange(fine) + 0.5) / fine - 0.5
    columns = (np.arange(first[0], last[0])[:, None] + inner).ravel()
    rows = (np.arange(first[1], last[1])[:, None] + inner).ravel()
    to_plane = np.linalg.inv(_plane_to_pixel(camera, shot, tag))
    length_px = math.hypot(*motion)
    instants = 1 if length_px < _SHARP_PX else _A_PIXEL * math.ceil(length_px)
    size = (last[1] - first[1], fine, last[0] - first[0], fine)
    gray, share = np.zeros(size[::2], np.float32), np.zeros(size[::2], np.float32)
    for part in (np.arange(instants) + 0.5) / instants - 0.5:
        u, v = np.meshgrid(columns - part * motion[0], rows - part * motion[1])
        ahead, right, scale = np.tensordot(to_plane, np.stack([u, v, np.ones_like(u)]), axes=1)
        row = np.floor((0.5 - ahead / scale / (2.0 * half_m)) * count).astype(int)
        column = np.floor((0.5 + right / scale / (2.0 * half_m)) * count).astype(int)
        inside = (row >= 0) & (row < count) & (column >= 0) & (column < count)
        paper = white[np.clip(row, 0, count - 1), np.clip(column, 0, count - 1)]
        level = np.where(inside, np.where(paper == 1, _WHITE, _BLACK), 0.0)
        gray += level.reshape(size).mean(axis=(1, 3)) / instants
        share += inside.reshape(size).mean(axis=(1, 3)) / instants
    return (slice(first[1], last[1]), slice(first[0], last[0])), gray, share


def _plane_to_pixel(camera: CameraSpec, shot: Shot, tag: TagPose) -> Matrix:
    """Return the homography from metres (forward, right, 1) on a marker to homogeneous pixels."""
    lens_up = shot.ground_m + lens_height_m(shot)
    middle = (tag.north_m - shot.north_m, tag.east_m - shot.east_m, lens_up - tag.up_m)
    body = axes_to_ned(tag.attitude)
    ned = np.column_stack([body[:, 0], body[:, 1], middle])
    return np.asarray(camera.to_pixel @ axes_to_ned(shot.attitude).T @ ned, dtype=np.float64)


def _outline(camera: CameraSpec, shot: Shot, tag: TagPose, half_m: float) -> Matrix | None:
    """Return pixels, (4, 2), of a square's corners; None if its upper side is out of view."""
    matrix = _plane_to_pixel(camera, shot, tag)
    corners = half_m * np.array([[1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]])
    points = np.column_stack([corners, np.ones(4)]) @ matrix.T
    # its upper side is seen if the corners turn in the picture as they do on the vehicle
    if points[:, 2].min() < _NEAREST_M or np.linalg.det(matrix) <= 0.0:
        return None
    pixels = np.asarray(points[:, :2] / points[:, 2:])
    size = (camera.width_px, camera.height_px)
    beside = (pixels.max(axis=0) < -0.5) | (pixels.min(axis=0) > np.array(size) - 0.5)
    return None if beside.any() else pixels


def _motion_px(camera: CameraSpec, shot: Shot, tag: TagPose) -> tuple[float, float]:
    """Return how far a marker's middle moves over the picture in an exposure: right, down."""
    moved, open_s = shot.moved_m, camera.exposure_s
    east, north, up = (speed * open_s for speed in tag.velocity_m_s)
    later = replace(
        shot, east_m=shot.east_m + moved[0], north_m=shot.north_m + moved[1],
        height_m=shot.height_m + moved[2], attitude=shot.turned or shot.attitude,
    )  # fmt: skip
    onward = replace(tag, east_m=tag.east_m + east, north_m=tag.north_m + north, up_m=tag.up_m + up)
    before = _plane_to_pixel(camera, shot, tag)[:, 2]
    after = _plane_to_pixel(camera, later, onward)[:, 2]
    return (
        float(after[0] / after[2] - before[0] / before[2]),
        float(after[1] / after[2] - before[1] / before[2]),
    )
