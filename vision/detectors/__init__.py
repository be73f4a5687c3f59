"""The detectors by name. A new one is a file beside these and a line in `_REGISTRY`.

A detector from another package is a plug-in (`uavmap.load.detector_source`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from inspect import signature
from typing import Final

from missions.errors import MissionFileError
from vision.detectors.color import ColorDetector
from vision.detectors.interface import Detector
from vision.detectors.learned_model import LearnedDetector
from vision.detectors.onnx import OnnxDetector
from vision.detectors.threshold import (
    AdaptiveDetector,
    IndexDetector,
    PavedDetector,
    ThresholdDetector,
)

__all__ = [
    "FINDS", "FROM_FILES", "Detector", "build_detector", "check_keys", "detector_names",
    "detector_parameters", "make_detector",
]  # fmt: skip

_REGISTRY: Mapping[str, Callable[..., Detector]] = {
    "adaptive": AdaptiveDetector,
    "color": ColorDetector,
    "index": IndexDetector,
    "learned": LearnedDetector,
    "onnx": OnnxDetector,
    "paved": PavedDetector,
    "threshold": ThresholdDetector,
}

FINDS: Final[Mapping[str, str]] = {
    "threshold": "Ground darker (or brighter) than all around it, in a steady light.",
    "paved": "Bare ground among plants: roads, soil, stones; lit and not green.",
    "adaptive": "Small patches that are darker (or brighter) than their surroundings.",
    "color": "Ground of some sample colours, which a mission file has to give.",
    "index": "Plants, by excess green; with near infrared also NDVI and water; hot spots.",
    "learned": "Ground like that painted in a few photographs, by `uavmap tune`.",
    "onnx": "The region for which a segmentation model was trained.",
}
"""Ground that each detector finds, in a sentence for the operator who chooses one."""

FROM_FILES: Final[Mapping[str, tuple[str, ...]]] = {
    "learned": ("model",),
    "onnx": ("run", "settings"),
}
"""Detectors made of the file `detector.model`, and the parameters that come from it."""


def detector_names() -> tuple[str, ...]:
    """Return the names that `make_detector` accepts, sorted."""
    return tuple(sorted(_REGISTRY))


def make_detector(name: str, **params: object) -> Detector:
    """Return the detector of that name; parameters left out keep their defaults.

    Raises `MissionFileError` for an unknown name or parameter, one out of range, and one that is
    missing and has no default.

    >>> make_detector("threshold", intensity=120)
    ThresholdDetector(intensity=120, dilations=7, polarity='dark')
    """
    if name not in _REGISTRY:
        raise MissionFileError(
            f"detector.name is {name!r}: expected one of {', '.join(detector_names())}"
        )
    return build_detector(name, _REGISTRY[name], params)


def check_keys(name: str, keys: Mapping[str, object]) -> None:
    """Raise `MissionFileError` for a key that the mission file cannot give that detector."""
    _check_known(name, _REGISTRY[name], keys, FROM_FILES.get(name, ()))


def detector_parameters(name: str) -> dict[str, object]:
    """Return the parameters of a detector that have defaults; for a plug-in, none.

    >>> detector_parameters("paved")
    {'greenness': 0.04, 'intensity': 90, 'dilations': 1}
    """
    if name not in _REGISTRY:
        return {}
    parameters = signature(_REGISTRY[name]).parameters.items()
    given = ((key, one.default) for key, one in parameters if one.default is not one.empty)
    return {key: default for key, default in given if default is not None}


def build_detector(
    name: str, build: Callable[..., Detector], params: Mapping[str, object]
) -> Detector:
    """Check the parameters against the signature of `build`, and return its result."""
    _check_known(name, build, params, ())
    for key, parameter in signature(build).parameters.items():
        if parameter.default is parameter.empty and key not in params:
            raise MissionFileError(f"detector.{key} is missing: the detector {name!r} needs it")
    return build(**params)


def _check_known(
    name: str, build: Callable[..., Detector], keys: Mapping[str, object], without: tuple[str, ...]
) -> None:
    known = tuple(key for key in signature(build).parameters if key not in without)
    for key in keys:
        if key not in known:
            raise MissionFileError(
                f"detector.{key} is not a parameter of the detector {name!r}: "
                f"expected one of {', '.join(known)}"
            )
