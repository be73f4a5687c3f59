"""Pixels near to one of some colours, as the eye tells them apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.errors import MissionFileError
from vision.detectors.interface import check_number, marked

_MOST_SAMPLES: Final = 64


@dataclass(frozen=True, slots=True)
class ColorDetector:
    """The ROI has one of the sample colours, by distance in CIE Lab.

    A distance of 2 is just visible, 10 is another shade, 50 another colour. The probability is a
    half at `distance` and falls as a bell; it is not calibrated.

    Attributes:
        samples: Colours of the ROI, each [red, green, blue], 0 to 255; 1 to 64 of them.
        not_samples: Colours of the surround: a pixel nearer to one of these is not ROI.
        distance: Largest distance of a pixel from a sample, above 0, to 200.
        lightness: Weight of a difference of lightness beside one of colour, 0 to 1. 0 ignores
            shadows and exposure.
    """

    name: ClassVar[str] = "color"
    calibrated: ClassVar[bool] = False

    samples: Sequence[Sequence[int]]
    not_samples: Sequence[Sequence[int]] = ()
    distance: float = 20.0
    lightness: float = 0.3

    def __post_init__(self) -> None:
        check_number("distance", self.distance, 0.1, 200.0)
        check_number("lightness", self.lightness, 0.0, 1.0)
        _check_colors("samples", self.samples, 1)
        _check_colors("not_samples", self.not_samples, 0)

    def probability(self, image: NDArray[Any]) -> NDArray[np.float32]:
        """See `Detector.probability`."""
        lab = _lab(image)
        near = self._nearest(lab, self.samples)
        share = np.exp2(-((near / np.float32(self.distance)) ** 2))
        if len(self.not_samples):
            share[self._nearest(lab, self.not_samples) < near] = 0.0
        return np.asarray(share, np.float32)

    def mask(self, image: NDArray[Any]) -> NDArray[np.uint8]:
        """See `Detector.mask`."""
        return marked(self.probability(image))

    def _nearest(
        self, lab: NDArray[np.float32], colors: Sequence[Sequence[int]]
    ) -> NDArray[np.float32]:
        """Return the distance of each pixel to the nearest of the colours.

        |pixel - sample|^2 is |pixel|^2 + |sample|^2 - 2 pixel . sample: a product of matrices.
        """
        weights = np.array([self.lightness, 1.0, 1.0], np.float32)
        samples = _lab(np.array([[color[::-1] for color in colors]], np.uint8))[0] * weights
        pixels = lab.reshape(-1, 3) * weights
        away = (samples * samples).sum(axis=1)[:, None] - 2.0 * (samples @ pixels.T)
        squares = away.min(axis=0) + np.einsum("ij,ij->i", pixels, pixels)
        near = np.sqrt(np.maximum(squares, 0.0)).reshape(lab.shape[:2])
        return np.asarray(near, np.float32)


def _lab(image: NDArray[Any]) -> NDArray[np.float32]:
    scaled = image.astype(np.float32) / np.float32(255.0)
    return np.asarray(cv2.cvtColor(scaled, cv2.COLOR_BGR2LAB), np.float32)


def _check_colors(key: str, colors: object, least: int) -> None:
    good = isinstance(colors, (list, tuple)) and least <= len(colors) <= _MOST_SAMPLES
    if not good or not all(_is_color(color) for color in colors):  # type: ignore[attr-defined]
        raise MissionFileError(
            f"detector.{key} is {colors!r}: expected {least} to {_MOST_SAMPLES} colours, each "
            "[red, green, blue] with integers from 0 to 255"
        )


def _is_color(color: object) -> bool:
    return (
        isinstance(color, (list, tuple))
        and len(color) == 3
        and all(isinstance(v, int) and not isinstance(v, bool) and 0 <= v <= 255 for v in color)
    )
