"""The detector of sample colours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.classes import Classes
from missions.errors import MissionFileError
from vision.detectors.interface import Judgement, check_number, marked

Colors = Sequence[Sequence[int]]
_MAX_SAMPLES: Final = 64


@dataclass(frozen=True, slots=True)
class ColorDetector:
    """Detector of ROI that has one of the sample colours, by distance in CIE Lab.

    A distance of 2 is just visible, 10 is another shade, 50 another colour. The probability is a
    half at `distance` and falls as a bell; it is not calibrated.

    Attributes:
        samples: Colours of the ROI, each [red, green, blue], 0 to 255; 1 to 64 of them. With
            `classes` those of each class, by its name: a pixel is of the class of the nearest one.
        not_samples: Colours of the surround: a pixel nearer to one of these is not ROI.
        distance: Largest distance of a pixel from a sample, above 0, to 200.
        lightness: Weight of a difference of lightness beside one of colour, 0 to 1. 0 ignores
            shadows and exposure.
        classes: Classes that it distinguishes; those that are not explored are not ROI.
    """

    name: ClassVar[str] = "color"
    calibrated: ClassVar[bool] = False

    samples: Colors | Mapping[str, Colors]
    not_samples: Colors = ()
    distance: float = 20.0
    lightness: float = 0.3
    classes: Classes | None = None

    def __post_init__(self) -> None:
        check_number("distance", self.distance, 0.1, 200.0)
        check_number("lightness", self.lightness, 0.0, 1.0)
        named = self.samples if isinstance(self.samples, Mapping) else {}
        wanted = {} if self.classes is None else self.classes.by_name
        if set(named) != set(wanted):
            names = ", ".join(wanted) or "[detector.classes] gives them"
            raise MissionFileError(
                f"detector.samples is of the classes {', '.join(named) or 'none'}: expected those "
                f"of each class by its name: {names}"
            )
        for key, colors in self._by_key.items():
            _check_colors(key, colors, 1)
        _check_colors("not_samples", self.not_samples, 0)

    @property
    def _by_key(self) -> dict[str, Colors]:
        """The samples of each class, in the order of numbers; else those of the region."""
        if isinstance(self.samples, Mapping) and self.classes is not None:
            return {f"samples.{n}": self.samples[n] for n in self.classes.names.values()}
        return {"samples": self.samples}  # type: ignore[dict-item]

    @property
    def words(self) -> str:
        """Description of its region."""
        every = [color for colors in self._by_key.values() for color in colors]
        colours = ", ".join("rgb({}, {}, {})".format(*color) for color in every[:3])
        more = len(every) - 3
        return f"coloured like {colours}" + (f" and {more} more" if more > 0 else "")

    def judged(self, image: NDArray[Any]) -> Judgement:
        """See `Judgement`."""
        share, nearest = self._described(image)
        mask = marked(share)
        if self.classes is None:
            return Judgement(mask)
        numbers = np.array(tuple(self.classes.names), np.uint8)
        classes = np.where(mask > 0, numbers[nearest], np.uint8(0))
        mask[self._passed(nearest)] = 0
        return Judgement(mask, classes=classes)

    def probability(self, image: NDArray[Any]) -> NDArray[np.float32]:
        """See `Detector.probability`."""
        share, nearest = self._described(image)
        share[self._passed(nearest)] = 0.0
        return share

    def mask(self, image: NDArray[Any]) -> NDArray[np.uint8]:
        """See `Detector.mask`."""
        return marked(self.probability(image))

    def _passed(self, nearest: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Return the pixels whose nearest class is not explored."""
        if self.classes is None:
            return np.zeros(nearest.shape, np.bool_)
        return ~np.isin(tuple(self.classes.names), self.classes.explored)[nearest]

    def _described(self, image: NDArray[Any]) -> tuple[NDArray[np.float32], NDArray[np.intp]]:
        """Return each pixel's likeness to a sample, 0 to 1, and the index of its class.

        |pixel - sample|^2 is |pixel|^2 + |sample|^2 - 2 pixel . sample: a product of matrices.
        """
        weights = np.array([self.lightness, 1.0, 1.0], np.float32)
        pixels = np.ascontiguousarray((_lab(image) * weights).reshape(-1, 3).T)

        def away(colors: Colors) -> NDArray[np.float32]:
            """Return the squared distance to the nearest of the colours, less |pixel|^2."""
            bgr = np.array([[color[::-1] for color in colors]], np.uint8)
            samples = _lab(bgr)[0] * weights
            products = (np.float32(-2.0) * samples) @ pixels
            products += (samples * samples).sum(axis=1)[:, None]
            return np.asarray(products.min(axis=0), np.float32)

        first, *others = self._by_key.values()
        near, nearest = away(first), np.zeros(pixels.shape[1], np.intp)
        for number, colors in enumerate(others, 1):
            other = away(colors)
            nearest[other < near] = number
            np.minimum(near, other, out=near)
        squares = np.maximum(near + (pixels * pixels).sum(axis=0), 0.0)
        share = np.exp2(squares * np.float32(-1.0 / self.distance**2))
        if len(self.not_samples):
            share[away(self.not_samples) < near] = 0.0
        return share.reshape(image.shape[:2]), nearest.reshape(image.shape[:2])


def _lab(image: NDArray[Any]) -> NDArray[np.float32]:
    scaled = image.astype(np.float32) / np.float32(255.0)
    return np.asarray(cv2.cvtColor(scaled, cv2.COLOR_BGR2LAB), np.float32)


def _check_colors(key: str, colors: object, least: int) -> None:
    good = isinstance(colors, (list, tuple)) and least <= len(colors) <= _MAX_SAMPLES
    if not good or not all(_is_color(color) for color in colors):  # type: ignore[attr-defined]
        raise MissionFileError(
            f"detector.{key} is {colors!r}: expected {least} to {_MAX_SAMPLES} colours, each "
            "[red, green, blue] with integers from 0 to 255"
        )


def _is_color(color: object) -> bool:
    return (
        isinstance(color, (list, tuple))
        and len(color) == 3
        and all(isinstance(v, int) and not isinstance(v, bool) and 0 <= v <= 255 for v in color)
    )
