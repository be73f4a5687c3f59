"""A picture laid on a raster part by part."""

import math

import numpy as np
import pytest

from missions.units import GridPoint
from vision import raster
from vision.raster import Overlay, Raster, Window, framed

WIDTH_PX, HEIGHT_PX, GSD_M, TURN_RAD = 200, 120, 0.1, math.radians(40.0)
RASTER = Raster(-20.0, 20.0, 0.1, 400, 400)


def aslant(points: np.ndarray) -> np.ndarray:
    """Pixels of a camera that looks straight down on the origin and stands turned."""
    east, north = points[..., 0], points[..., 1]
    c, s = math.cos(TURN_RAD), math.sin(TURN_RAD)
    right, down = (c * east + s * north) / GSD_M, (s * east - c * north) / GSD_M
    middle = np.array([(WIDTH_PX - 1) / 2.0, (HEIGHT_PX - 1) / 2.0])
    return np.stack([right, down], axis=-1) + middle


def laid(window: Window) -> tuple[np.ndarray, int]:
    """The weights on a window, and over how many pixels they were reckoned."""
    picture = Overlay(aslant, GridPoint(0.0, 0.0), 15.0, WIDTH_PX, HEIGHT_PX)
    found, asked = np.zeros(window.shape, np.float32), 0
    image = framed(np.arange(WIDTH_PX * HEIGHT_PX, dtype=np.float32).reshape(HEIGHT_PX, WIDTH_PX))
    for part, laying in picture.laid(RASTER, window):
        found[part.within(window)] = laying.weight * laying.sampled(image)
        asked += laying.weight.size
    return found, asked


@pytest.mark.parametrize("window", [RASTER.whole, Window(53, 91, 307, 386)])
def test_parts_make_the_whole_and_what_is_not_in_the_picture_is_left_out(
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
