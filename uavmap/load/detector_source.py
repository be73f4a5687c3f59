"""Detectors as missions name them: their parameters, their files, and those of plug-ins.

A mission holds path and checksum of its model, so a resumed flight is judged by the same model.
"""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Callable, Mapping
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, Final

import tomlkit
from pydantic import ValidationError

from missions.errors import MissionFileError
from missions.mission.messages import explain
from missions.mission.sections.detector_section import DetectorSection
from uavmap.base.text_files import read_bytes, read_text
from uavmap.load.onnx_file import onnx_detector
from vision.detectors import (
    FROM_FILES,
    Detector,
    build_detector,
    check_keys,
    detector_names,
    make_detector,
)

GROUP: Final = "uavmap.detectors"
"""The entry points that plug-ins have: a name, and what makes the detector of its parameters."""
DETECTOR_TOML: Final = "detector.toml"
_LARGEST_TOML: Final = 100_000
_LARGEST_MODEL: Final = 500_000_000


def known_detectors() -> tuple[str, ...]:
    """The names of all detectors that are installed, sorted."""
    return tuple(sorted({*detector_names(), *_plugins()}))


def check_detector(section: DetectorSection) -> None:
    """Raise `MissionFileError` for parameters that the detectors refuse; reads no model."""
    for name in section.tables:
        if name not in known_detectors():
            raise MissionFileError(
                f"detector.{name}: a table of no detector; known: {', '.join(known_detectors())}"
            )
    name = section.name
    if name in FROM_FILES:
        if section.model is None:
            raise MissionFileError(
                f"detector.model is missing: the detector {name!r} is made of a file; name it, "
                "or give --detector"
            )
        check_keys(name, section.parameters)
    elif section.model is not None:
        raise MissionFileError(
            f"detector.model = {section.model!r}: the detector {name!r} has no file; leave it out"
        )
    else:
        _made(name, section.parameters)


def detector_of_section(section: DetectorSection, height_ratio: float = 1.0) -> Detector:
    """Return the detector of a mission. Raises `MissionFileError` for a model unreadable or
    changed.

    Dilations are counted in pixels at the lowest layer. From `height_ratio` times that height a
    pixel shows so much more ground, and fewer dilations bridge the same gap.
    """
    parameters = section.parameters
    if "dilations" in parameters:
        parameters["dilations"] = round(parameters["dilations"] / height_ratio)
    if section.name not in FROM_FILES:
        return _made(section.name, parameters)
    path = Path(section.model or "")
    kept = section.model_sha256
    data = _model(path, "" if kept is None else f"put it back: its SHA-256 is {kept}")
    if kept not in (None, _sha256(data)):
        raise MissionFileError(
            f"detector.model = {str(path)!r}: the file has changed since the mission was begun; "
            f"put the old one back: its SHA-256 is {kept}"
        )
    try:
        if section.name == "onnx":
            return onnx_detector(path, data, parameters)
        return make_detector(section.name, model=data, **parameters)
    except MissionFileError as error:
        text = str(error).removeprefix("detector.model: ")
        raise MissionFileError(f"detector.model = {str(path)!r}: {text}") from None


def resolved_section(
    section: Mapping[str, Any] | None, folder: Path, detector: Path | None
) -> dict[str, Any] | None:
    """Return the table `[detector]` with its model by whole path and checksum.

    A `detector` (a folder of `uavmap tune`) replaces the table, except for a `view` that it does
    not set. Raises `MissionFileError`.
    """
    found = None if section is None else dict(section)
    if detector is not None:
        view = {"view": found["view"]} if found and "view" in found else {}
        found = {**view, **_given(detector)}
    if found is None or not isinstance(model := found.get("model"), str) or not model:
        return found
    path = _whole(folder, model)
    return {**found, "model": str(path), "model_sha256": _sha256(_model(path))}


def detector_text(detector: Path) -> str:
    """Return the table `[detector]` of a folder (`--detector`), for recorded pictures.

    Its model is read once, so that a fault is reported first. Raises `MissionFileError`.
    """
    what = f"--detector {detector}"
    try:
        table = {"view": "all", **(resolved_section(None, Path(), detector) or {})}
        section = DetectorSection.model_validate(table)
        check_detector(section)
        if section.model is not None:
            detector_of_section(section)
    except ValidationError as error:
        lines = [f"{what}: detector.{fault}" for fault in explain(error, DetectorSection)]
        raise MissionFileError("\n".join(lines)) from None
    except MissionFileError as error:
        raise MissionFileError(f"{what}: {str(error).removeprefix(f'{what}: ')}") from None
    return tomlkit.dumps({"detector": table})


def _given(detector: Path) -> dict[str, Any]:
    path = detector / DETECTOR_TOML if detector.is_dir() else detector
    try:
        given = tomllib.loads(read_text(path, _LARGEST_TOML))
    except OSError as error:
        raise MissionFileError(
            f"--detector {detector}: {path.name} cannot be read ({error.strerror}); give a folder "
            "that `uavmap tune` has written, or such a file"
        ) from None
    except ValueError as error:
        raise MissionFileError(f"--detector {detector}: {path}: not a TOML file: {error}") from None
    section = given.get("detector")
    if set(given) != {"detector"} or not isinstance(section, dict):
        raise MissionFileError(
            f"--detector {detector}: {path}: it must hold the table [detector] and nothing else"
        )
    if isinstance(section.get("model"), str):
        try:
            section["model"] = str(_whole(path.parent, section["model"]))
        except MissionFileError as error:
            raise MissionFileError(f"--detector {detector}: {path}: {error}") from None
    return section


# --- files and plug-ins ------------------------------------------------------------------------
def _whole(folder: Path, model: str) -> Path:
    try:
        return (folder / model).resolve()
    except (OSError, ValueError, RuntimeError) as error:  # no name of a file; links in a circle
        raise MissionFileError(
            f"detector.model = {model!r}: no path of a file ({error}); name the model's file"
        ) from None


def _model(path: Path, remedy: str = "") -> bytes:
    try:
        return read_bytes(path, _LARGEST_MODEL)
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        remedy = remedy or (
            "train it with `uavmap tune`, or give its path from the folder of the mission file"
        )
        raise MissionFileError(
            f"detector.model = {str(path)!r}: cannot be read ({why}); {remedy}"
        ) from None


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _made(name: str, parameters: Mapping[str, Any]) -> Detector:
    if name in detector_names():
        return make_detector(name, **parameters)
    plugins = _plugins()
    if name not in plugins:
        raise MissionFileError(
            f"detector.name is {name!r}: expected one of {', '.join(known_detectors())}"
        )
    made = build_detector(name, _loaded(name, plugins[name]), parameters)
    if not isinstance(made, Detector):
        raise MissionFileError(
            f"detector.name = {name!r}: the plug-in {plugins[name].value} makes no detector: it "
            "needs name, calibrated, probability and mask"
        )
    return made


@lru_cache(maxsize=1)
def _plugins() -> Mapping[str, EntryPoint]:
    """The plug-ins by name; a name of ours stays ours."""
    found = {point.name: point for point in entry_points(group=GROUP)}
    return {name: point for name, point in found.items() if name not in detector_names()}


def _loaded(name: str, point: EntryPoint) -> Callable[..., Detector]:
    try:
        build: Callable[..., Detector] = point.load()
    except Exception as error:  # a plug-in is somebody else's code
        raise MissionFileError(
            f"detector.name = {name!r}: the plug-in {point.value} cannot be loaded "
            f"({type(error).__name__}: {error}); install it again, or remove it"
        ) from None
    return build
