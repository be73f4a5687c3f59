"""The features of a pixel: colour, texture and surroundings, at any exposure and resolution.

A picture is scaled to a working width, so that a feature means the same ground at any resolution.
It is described on a grid of every `STRIDE`-th pixel. Colours are differences of logarithms. A
longer exposure adds a constant to each channel's logarithm, which the differences lose. Brightness
is relative to the picture's mean. Box filters and area means cost the same at each scale.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
    """Return rows and columns of the described places of a working picture."""
    return max(1, rows // STRIDE), max(1, columns // STRIDE)


def features(picture: NDArray[np.uint8], names: Sequence[str] = FEATURES) -> Array:
    """Return the features of a working picture: (len(names), rows // STRIDE, columns // STRIDE).

    Args:
        picture: (rows, columns, 3), uint8, blue-green-red, at the working width.
        names: Some of `FEATURES`.
    """
    rows, columns = described_shape(*picture.shape[:2])
    size = (columns, rows)
    wanted = set(names)
    found = _colors(picture, size, in_context=not wanted.isdisjoint(GROUPS["context"]))
    if not wanted.isdisjoint(GROUPS["texture"]):
        found |= _texture(picture, size, found["light"])
    return np.stack([found[name] for name in names])


def _colors(
    picture: NDArray[np.uint8], size: tuple[int, int], *, in_context: bool
) -> dict[str, Array]:
    logs = _shrunk(cv2.LUT(picture, _LOG), size)
    blue, green, red = cv2.split(logs)
    plain = cv2.split(cv2.resize(picture, size, interpolation=cv2.INTER_AREA).astype(np.float32))
    total = plain[0] + plain[1] + plain[2] + 3.0
    light = np.asarray(0.1 * blue + 0.6 * green + 0.3 * red, np.float32)
    # the median leaps where bright ground comes to cover more than half of a picture
    light -= np.float32(np.log(np.exp(light).mean()))
    base: dict[str, Array] = {
        "light": light,
        "red_green": red - green,
        "blue_green": blue - green,
        "green_excess": np.asarray(3.0 * plain[1] / total - 1.0, np.float32),
    }
    found = dict(base)
    found["saturation"] = np.asarray(
        1.0 - 3.0 * cv2.min(cv2.min(*plain[:2]), plain[2]) / total, np.float32
    )
    for key, value in base.items():
        found[f"{key}_near"] = _box(value, NEAR)
        if not in_context:
            continue
        found[f"{key}_around"] = _box(value, AROUND)
        if key == "light":
            found["light_beside"] = found["light_near"] - found["light_around"]
            found["light_far_beside"] = found["light_near"] - _box(value, FAR)
        else:
            found[f"{key}_beside"] = found[f"{key}_near"] - _box(value, FAR)
            found[f"{key}_rest"] = found[f"{key}_near"] - np.float32(np.median(value))
    return found


def _texture(picture: NDArray[np.uint8], size: tuple[int, int], light: Array) -> dict[str, Array]:
    gray = cv2.LUT(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), _LOG)
    detail = _shrunk(np.abs(cv2.Laplacian(gray, cv2.CV_32F)), size)
    found = {"detail": _log(detail)}
    for key, side in (("near", NEAR), ("around", AROUND)):
        found[f"detail_{key}"] = _log(_box(detail, side))
        spread = _box(light * light, side) - _box(light, side) ** 2
        found[f"rough_{key}"] = _log(np.asarray(np.maximum(spread, 0.0), np.float32))
    across = np.asarray(cv2.Sobel(light, cv2.CV_32F, 1, 0), np.float32)
    along = np.asarray(cv2.Sobel(light, cv2.CV_32F, 0, 1), np.float32)
    for key, side in (("near", NEAR), ("around", AROUND)):
        xx, yy, xy = (_box(v, side) for v in (across * across, along * along, across * along))
        # 0: edges in all directions, as of leaves; 1: all in one, as of a road
        ratio = np.sqrt((xx - yy) ** 2 + 4.0 * xy * xy) / (xx + yy + np.float32(_LEAST))
        found[f"line_{key}"] = np.asarray(ratio, np.float32)
    return found


def _shrunk(values: NDArray[Any], size: tuple[int, int]) -> Array:
    return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_AREA), np.float32)


def _box(values: Array, side: int) -> Array:
    return np.asarray(cv2.blur(values, (side, side), borderType=cv2.BORDER_REFLECT), np.float32)


def _log(values: Array) -> Array:
    return np.asarray(np.log(values + np.float32(_LEAST)), np.float32)
