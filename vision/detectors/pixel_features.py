"""The features of a pixel: colour, texture and surroundings, at any exposure and resolution.

A picture is scaled to a working width, so that a feature means the same ground at any resolution.
It is described on a grid of every `STRIDE`-th pixel. Colours are differences of logarithms. A
longer exposure adds a constant to each channel's logarithm, which the differences lose. Brightness
is relative to the picture's mean. Box filters and area means cost the same at each scale.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.errors import ImageError

Array = NDArray[np.float32]

STRIDE: Final = 4
"""Pixels of the working width between two described places."""
NEAR, AROUND, FAR = 5, 15, 45
"""Sides of the boxes over which features are averaged, in described places."""

_LOG: Final = np.log(np.arange(256, dtype=np.float32) + 6.0).astype(np.float32)
_LEVELS_A_UNIT: Final = 10_000
_LEVELS: Final = np.round(_LOG * _LEVELS_A_UNIT).astype(np.uint16)
_LEAST: Final = 1e-4

GROUPS: Final[Mapping[str, tuple[str, ...]]] = {
    "color": (
        "light", "red_green", "blue_green", "green_excess", "saturation",
        "light_near", "red_green_near", "blue_green_near", "green_excess_near",
    ),
    "texture": (
        "detail", "detail_near", "detail_around", "rough_near", "rough_around",
        "line_near", "line_around",
    ),
    "context": (
        "light_around", "red_green_around", "blue_green_around", "green_excess_around",
        "light_beside", "red_green_beside", "blue_green_beside", "light_far_beside",
        "red_green_rest", "blue_green_rest", "green_excess_rest",
    ),
}  # fmt: skip
"""The features by group. `_near`, `_around`: the mean over a box; `_beside`: against the mean of
the surroundings; `_rest`: against the median of the picture.
"""

FEATURES: Final = tuple(name for names in GROUPS.values() for name in names)


def working_picture(image: NDArray[Any], width_px: int) -> NDArray[np.uint8]:
    """Return a picture at the working width, 8 bits; `ImageError` unless it has three channels."""
    if image.ndim != 3 or image.shape[2] != 3:
        raise ImageError(f"a learned detector needs 3 channels, the picture has {image.shape[2:]}")
    if image.dtype == np.uint16:
        image = (image >> 8).astype(np.uint8)
    rows, columns = image.shape[:2]
    if columns == width_px:
        return image.astype(np.uint8, copy=False)
    size = (width_px, max(STRIDE, round(rows * width_px / columns)))
    how = cv2.INTER_AREA if columns > width_px else cv2.INTER_LINEAR
    return cv2.resize(image, size, interpolation=how).astype(np.uint8, copy=False)


def described_shape(rows: int, columns: int) -> tuple[int, int]:
    """Return rows and columns of the described places; the last three pixels may be in none."""
    return max(1, rows // STRIDE), max(1, columns // STRIDE)


def features(picture: NDArray[np.uint8], names: Sequence[str] = FEATURES, every: int = 1) -> Array:
    """Return the features of every so many described places: (len(names), rows, columns).

    Args:
        picture: (rows, columns, 3), uint8, blue-green-red, at the working width.
        names: Some of `FEATURES`.
        every: Step between the places, in both directions.
    """

    def box(values: Array, side: int) -> Array:
        mean = cv2.blur(values, (side, side), borderType=cv2.BORDER_REFLECT)
        return np.asarray(mean, np.float32)[::every, ::every]

    wanted = set(names)
    base = _base(picture)
    found = {key: value[::every, ::every] for key, value in base.items()}
    del base["saturation"]
    found |= {f"{key}_near": box(value, NEAR) for key, value in base.items()}
    if not wanted.isdisjoint(GROUPS["texture"]):
        detail = _detail(picture)
        found |= {"detail": _log(detail[::every, ::every])} | _texture(detail, base["light"], box)
    if not wanted.isdisjoint(GROUPS["context"]):
        found |= _context(base, found, box)
    return np.stack([found[name] for name in names])


_Box = Callable[[Array, int], Array]


def _base(picture: NDArray[np.uint8]) -> dict[str, Array]:
    """Return the colours of the described places."""
    half = _halved(_whole_places(picture))
    logs = _halved(cv2.LUT(half, _LEVELS)) * np.float32(1.0 / _LEVELS_A_UNIT)
    blue, green, red = cv2.split(logs)
    plain = cv2.split(_halved(half).astype(np.float32))
    total = plain[0] + plain[1] + plain[2] + 3.0
    light = np.asarray(0.1 * blue + 0.6 * green + 0.3 * red, np.float32)
    # the median leaps where bright ground comes to cover more than half of a picture
    light -= np.float32(np.log(np.exp(light).mean()))
    least = cv2.min(cv2.min(*plain[:2]), plain[2])
    return {
        "light": light,
        "red_green": red - green,
        "blue_green": blue - green,
        "green_excess": np.asarray(3.0 * plain[1] / total - 1.0, np.float32),
        "saturation": np.asarray(1.0 - 3.0 * least / total, np.float32),
    }


def _context(base: Mapping[str, Array], found: Mapping[str, Array], box: _Box) -> dict[str, Array]:
    more = {f"{key}_around": box(value, AROUND) for key, value in base.items()}
    for key, value in base.items():
        near = found[f"{key}_near"]
        beside = near - box(value, FAR)
        if key == "light":
            more |= {"light_beside": near - more["light_around"], "light_far_beside": beside}
        else:
            rest = near - np.float32(np.median(value))
            more |= {f"{key}_beside": beside, f"{key}_rest": rest}
    return more


def _detail(picture: NDArray[np.uint8]) -> Array:
    """Return the mean strength of the finest edges in the described places."""
    gray = cv2.LUT(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), _LOG)
    edges = np.asarray(cv2.Laplacian(gray, cv2.CV_32F), np.float32)
    return _halved(_halved(_whole_places(np.abs(edges, out=edges))))


def _texture(detail: Array, light: Array, box: _Box) -> dict[str, Array]:
    across = np.asarray(cv2.Sobel(light, cv2.CV_32F, 1, 0), np.float32)
    along = np.asarray(cv2.Sobel(light, cv2.CV_32F, 0, 1), np.float32)
    squares = light * light, across * across, along * along, across * along
    found = {}
    for key, side in (("near", NEAR), ("around", AROUND)):
        found[f"detail_{key}"] = _log(box(detail, side))
        square, xx, yy, xy = (box(values, side) for values in squares)
        spread = np.maximum(square - box(light, side) ** 2, 0.0)
        found[f"rough_{key}"] = _log(np.asarray(spread, np.float32))
        # 0: edges in all directions, as of leaves; 1: all in one, as of a road
        ratio = np.sqrt((xx - yy) ** 2 + 4.0 * xy * xy) / (xx + yy + np.float32(_LEAST))
        found[f"line_{key}"] = np.asarray(ratio, np.float32)
    return found


def _whole_places(values: NDArray[Any]) -> NDArray[Any]:
    """Return the part of a picture that is in described places."""
    rows, columns = described_shape(*values.shape[:2])
    return values[: rows * STRIDE, : columns * STRIDE]


def _halved(values: NDArray[Any]) -> NDArray[Any]:
    rows, columns = (max(1, side // 2) for side in values.shape[:2])
    return np.asarray(cv2.resize(values, (columns, rows), interpolation=cv2.INTER_AREA))


def _log(values: Array) -> Array:
    return np.asarray(np.log(values + np.float32(_LEAST)), np.float32)
