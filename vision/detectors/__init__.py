"""The detectors by name. A new one is a file beside these and a line in `_REGISTRY`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from inspect import signature

from missions.errors import MissionFileError
from vision.detectors.interface import Detector
from vision.detectors.paved import PavedDetector
from vision.detectors.threshold import ThresholdDetector

__all__ = ["Detector", "detector_names", "make_detector"]

_REGISTRY: Mapping[str, Callable[..., Detector]] = {
    "paved": PavedDetector,
    "threshold": ThresholdDetector,
}


def detector_names() -> tuple[str, ...]:
    """The names that `make_detector` knows, sorted."""
    return tuple(sorted(_REGISTRY))


def make_detector(name: str, **params: object) -> Detector:
    """The detector of that name; parameters left out keep their defaults.

    Raises `MissionFileError` for an unknown name, an unknown parameter or one out of range.

    >>> make_detector("threshold", intensity=120)
    ThresholdDetector(intensity=120, dilations=7, polarity='dark')
    """
    if name not in _REGISTRY:
        raise MissionFileError(
            f"detector.name is {name!r}: expected one of {', '.join(detector_names())}"
        )
    build = _REGISTRY[name]
    known = tuple(signature(build).parameters)
    for key in params:
        if key not in known:
            raise MissionFileError(
                f"detector.{key} is not a parameter of the detector {name!r}: "
                f"expected one of {', '.join(known)}"
            )
    return build(**params)
