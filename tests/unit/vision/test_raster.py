"""A picture projected on a raster part by part; lines of equal level on it, block by block."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from missions.units import GridPoint
from vision import raster
from vision.contours import Contours, Ring
from vision.raster import UNSEEN, Fusion, Overlay, Raster, Window, framed

WIDTH_PX, HEIGHT_PX, GSD_M, TURN_RAD = 200, 120, 0.1, math.radians(40.0)
RASTER = Raster(-20.0, 20.0, 0.1, 400, 400)


def aslant(points: np.ndarray) -> np.ndarray:
    """Return pixels of a camera that looks straight down on the origin and is turned."""
    east, north = points[..., 0], points[..., 1]
    c, s = math.cos(TURN_RAD), math.sin(TURN_RAD)
    right, down = (c * east + s * north) / GSD_M, (s * east - c * north) / GSD_M
    middle = np.array([(WIDTH_PX - 1) / 2.0, (HEIGHT_PX - 1) / 2.0])
    return np.stack([right, down], axis=-1) + middle


def laid(window: Window) -> tuple[np.ndarray, int]:
    """Return the weights on a window, and the number of pixels of their computation."""
    picture = Overlay(aslant, GridPoint(0.0, 0.0), 15.0, WIDTH_PX, HEIGHT_PX)
    found, asked = np.zeros(window.shape, np.float32), 0
    image = framed(np.arange(WIDTH_PX * HEIGHT_PX, dtype=np.float32).reshape(HEIGHT_PX, WIDTH_PX))
    for part, laying in picture.on_window(RASTER, window):
        found[part.within(window)] = laying.weight * laying.sampled(image)
        asked += laying.weight.size
    return found, asked


@pytest.mark.parametrize("window", [RASTER.whole, Window(53, 91, 307, 386)])
def test_parts_make_the_whole_and_leave_out_places_beyond_the_picture(
    window: Window, monkeypatch: pytest.MonkeyPatch
) -> None:
    parts, asked = laid(window)
    monkeypatch.setattr(raster, "_PART", 512)
    monkeypatch.setattr(raster, "_narrowed", lambda block, *_: block)
    whole, all_of_it = laid(window)
    assert whole.any()
    assert np.array_equal(parts, whole)
    assert all_of_it == whole.size > asked


def test_a_window_beside_the_picture_has_no_part() -> None:
    found, asked = laid(Window(0, 0, 64, 64))
    assert not found.any()
    assert not asked


LEVEL = 126.5


def rings(levels: NDArray[np.uint8], side: int | None = None) -> list[Ring]:
    lines = Contours(LEVEL, levels.shape[1])
    step = side or max(levels.shape)
    for top in range(0, levels.shape[0], step):
        for left in range(0, levels.shape[1], step):
            lines.add(levels[top : top + step + 1, left : left + step + 1], top, left)
    return list(lines.rings(0.0))


def disc(radius_px: float, hole_px: float, side: int = 80) -> NDArray[np.uint8]:
    """Return levels of a smooth disc with a hole, both about the middle pixel."""
    row, column = np.mgrid[0:side, 0:side] - side // 2
    away = np.hypot(row, column)
    inside = np.minimum(radius_px - away, away - hole_px)
    return np.clip(LEVEL + 40.0 * inside, 0, 254).astype(np.uint8)


def test_lines_of_a_disc_with_a_hole_are_two_circles() -> None:
    found = sorted(rings(disc(30.0, 9.0)), key=lambda ring: -ring.area_px)
    assert [ring.area_px for ring in found] == pytest.approx(
        [math.pi * 30.0**2, -math.pi * 9.0**2], rel=0.01
    )
    for ring, radius in zip(found, (30.0, 9.0), strict=True):
        away = np.hypot(*(ring.points - 40.0).T)
        assert np.abs(away - radius).max() < 0.05
        assert not ring.open.any()


@pytest.mark.parametrize("seed", range(3))
def test_lines_made_block_by_block_are_the_same(seed: int) -> None:
    noise = np.random.default_rng(seed).normal(127.0, 90.0, (61, 47))
    levels = np.clip(cv2.GaussianBlur(noise, (0, 0), 1.0) * 3 - 254, 0, 254).astype(np.uint8)
    levels[20:30, 10:25] = UNSEEN
    levels[[0, -1], :] = UNSEEN
    levels[:, [0, -1]] = UNSEEN

    def canonical(found: list[Ring]) -> list[object]:
        return sorted(
            (round(ring.area_px, 6), sorted(map(tuple, ring.points.tolist()))) for ring in found
        )

    whole = rings(levels)
    assert len(whole) > 10
    assert canonical(rings(levels, 16)) == canonical(whole)
    # the inside and the outside of all lines together
    inside = (levels > LEVEL) & (levels != UNSEEN)
    drawn = np.zeros(levels.shape, np.uint8)
    for ring in whole:
        one = np.zeros_like(drawn)
        points = [np.round(ring.points * 256).astype(np.int32)]
        cv2.fillPoly(one, points, (1,), shift=8)
        drawn += np.uint8(ring.area_px > 0) * one
    assert (drawn[inside] > 0).all()


def test_line_is_open_where_pictures_end() -> None:
    levels = disc(30.0, -1.0)
    levels[:, 40:] = UNSEEN
    (ring,) = rings(levels)
    east = ring.points[:, 0] > 39.2
    assert ring.open[east].all()
    assert not ring.open[~east].any()


def test_a_place_counts_from_as_many_pictures_as_are_asked_for() -> None:
    window = Window(0, 0, 8, 8)
    fusion = Fusion(window, least=2)
    fusion.add(window, np.full((8, 8), 255, np.uint8), np.ones((8, 8), np.float32))
    half = Window(0, 0, 8, 4)
    fusion.add(half, np.zeros((8, 4), np.uint8), np.ones((8, 4), np.float32))
    levels = fusion.levels()
    assert (levels[:, 4:] == UNSEEN).all()
    assert (levels[:, :2] == 127).all()  # beyond reach of the smoothing
