"""The detectors that missions name: their parameters, their files, and those of plug-ins.

A mission holds path and checksum of its model, so a resumed flight is judged by the same model.
The results hold a copy of it, in a folder that `--detector` accepts.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, Final

import tomlkit
from pydantic import ValidationError

from missions.errors import MissionFileError, OutputError
from missions.mission.messages import explain
from missions.mission.schema import Mission, parse_toml
from missions.mission.sections import LATER, DetectorSection
from uavmap.base.text_files import read_bytes, read_text
from uavmap.load.onnx_model import LARGEST_TOML, onnx_detector, onnx_settings
from vision.detectors import (
    FINDS,
    FROM_FILES,
    Detector,
    build_detector,
    check_keys,
    detector_names,
    make_detector,
)

GROUP: Final = "uavmap.detectors"
"""The entry points of plug-ins: a name, and a function from parameters to a detector."""
DETECTOR_TOML: Final = "detector.toml"
OVERLAYS: Final = "overlays"
"""Folder of judged pictures beside a detector that `uavmap tune` has learned."""
SIMULATOR_DETECTOR: Final = "threshold"
"""The detector of a simulated flight without a chosen one: it fits the painted ground."""
_LARGEST_MODEL: Final = 500_000_000


def known_detectors() -> tuple[str, ...]:
    """Return the names of all installed detectors, sorted."""
    return tuple(sorted({*detector_names(), *_plugins()}))


def detector_descriptions() -> Mapping[str, str]:
    """Return a sentence on each installed detector, by name; built-in ones come first."""
    return {**FINDS, **dict.fromkeys(sorted(_plugins()), "A detector of a plug-in.")}


def require_detector(section: DetectorSection, source: str) -> None:
    """Raise `MissionFileError` if no detector is chosen for real pictures."""
    if section.name == LATER:
        raise MissionFileError(
            f'{source}: detector.name = "{LATER}": no detector is chosen, and only the simulator '
            "works without one; set one of "
            f"{', '.join(FINDS)}, or fly with --detector NAME (or a folder of `uavmap tune`)"
        )


def check_detector(section: DetectorSection) -> None:
    """Raise `MissionFileError` for parameters that the detectors refuse; reads no model."""
    for name in section.tables:
        if name not in known_detectors():
            raise MissionFileError(
                f"detector.{name}: unknown detector; known: {', '.join(known_detectors())}"
            )
    name = section.name
    if name in FROM_FILES:
        if section.model is None:
            raise MissionFileError(
                f"detector.model is missing: the detector {name!r} needs the file of a model; name "
                "it, or give --detector"
            )
        check_keys(name, section.parameters)
    elif section.model is not None:
        raise MissionFileError(
            f"detector.model = {section.model!r}: the detector {name!r} has no file; leave it out"
        )
    else:
        _made(SIMULATOR_DETECTOR if name == LATER else name, section.parameters)


def detector_of_section(section: DetectorSection, height_ratio: float = 1.0) -> Detector:
    """Return the detector of a mission.

    Dilations are counted in pixels at the lowest layer. From `height_ratio` times that height,
    fewer dilations close the same gap. Raises `MissionFileError` for a model that is unreadable or
    has changed.
    """
    parameters = section.parameters
    if "dilations" in parameters:
        parameters["dilations"] = round(parameters["dilations"] / height_ratio)
    if section.name not in FROM_FILES:
        return _made(SIMULATOR_DETECTOR if section.name == LATER else section.name, parameters)
    path = Path(section.model or "")
    kept = section.model_sha256
    data = _model(path, "" if kept is None else f"put it back: its SHA-256 is {kept}")
    if kept not in (None, _sha256(data)):
        raise MissionFileError(
            f"detector.model = {str(path)!r}: the file has changed since the mission began; "
            f"put the old one back: its SHA-256 is {kept}"
        )
    try:
        if section.name == "onnx":
            return onnx_detector(path, data, parameters)
        return make_detector(section.name, model=data, **parameters)
    except MissionFileError as error:
        text = str(error).removeprefix("detector.model: ")
        raise MissionFileError(f"detector.model = {str(path)!r}: {text}") from None


def region_in_words(section: DetectorSection) -> str:
    """Describe what the detector of a mission marks as region; read no model.

    >>> region_in_words(DetectorSection())
    'darker than 150 of 255 (fits the simulator; for real ground see uavmap tune)'
    >>> region_in_words(DetectorSection(name="paved", paved={}))
    'bare ground: not green, and brighter than 90 of 255'
    """
    if section.classes is not None:
        names = [section.classes.names[number] for number in section.explored]
        return f"{', '.join(names)}: {_detector_in_words(section)}"
    return _detector_in_words(section)


def _detector_in_words(section: DetectorSection) -> str:
    if section.model is not None:
        model = Path(section.model)
        return f"as learned by the model {model.parent.name}/{model.name}"
    words: str | None = getattr(detector_of_section(section), "words", None)
    if words is None:
        return f"as marked by the plug-in {section.name}"
    if section.name == LATER:
        return f"not chosen yet; the simulator takes {SIMULATOR_DETECTOR}: {words}"
    simulated = section.name == "threshold"
    return f"{words} (fits the simulator; for real ground see uavmap tune)" if simulated else words


def region_lines(section: DetectorSection, folder: Path = Path()) -> Iterator[str]:
    """Yield lines on what a mission's detector marks as region, and on pictures that show it.

    The mission names its model relative to `folder`.
    """
    yield f"region = {region_in_words(section)}"
    overlays = None if section.model is None else (folder / section.model).parent / OVERLAYS
    if overlays is not None and overlays.is_dir():
        yield f"check what it marks: {overlays} (red: marked, green: painted)"


def resolved_section(
    section: Mapping[str, Any] | None, folder: Path, detector: Path | None
) -> dict[str, Any] | None:
    """Return the table `[detector]` with its model by whole path and checksum. Raises
    `MissionFileError`.

    A `detector` (a name, or a folder of `uavmap tune`) replaces the table, except for `view` and
    `share` where it does not set them, and `classes.region`. Classes that the table does not give
    come from the file beside the model.
    """
    found, region = None if section is None else dict(section), dict[str, Any]()
    if detector is not None:
        before = found or {}
        kept = {key: before[key] for key in ("view", "share") if key in before}
        region = {key: names for key, names in _classes_in(before).items() if key == "region"}
        found = kept | _given(detector)
    if found is None:
        return None
    beside: Mapping[str, Any] = {}
    if isinstance(model := found.get("model"), str) and model:
        path = _absolute(folder, model)
        found |= {"model": str(path), "model_sha256": _sha256(_model(path))}
        beside = _classes_beside(path, found.get("name"))
    classes = {**beside, **_classes_in(found)}
    return {**found, "classes": classes | region} if classes else found


def _classes_in(section: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the table of classes of a section; empty without one."""
    classes = section.get("classes")
    return classes if isinstance(classes, Mapping) else {}


def _classes_beside(model: Path, name: object) -> Mapping[str, Any]:
    """Return the table of classes in the file that belongs to a model; empty without any."""
    if name == "onnx":
        classes = onnx_settings(model).classes
        return {} if classes is None else classes.model_dump(mode="json", exclude_unset=True)
    beside = model.parent / DETECTOR_TOML
    return _classes_in(_given(beside)) if beside.is_file() else {}


def detector_text(detector: Path) -> str:
    """Return the table `[detector]` of a name or folder (`--detector`), for recorded pictures. Its
    model is read once, to report a fault first. Raises `MissionFileError`."""
    what = f"--detector {detector}"
    try:
        recorded = {"view": "all", "share": 0.5}
        table = resolved_section(recorded, Path(), detector) or {}
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
    name = str(detector)
    if name in known_detectors() and not detector.exists():
        if name in FROM_FILES:
            raise MissionFileError(f"--detector {name}: it needs a file; give its folder")
        return {"name": name, name: {}}
    path = detector / DETECTOR_TOML if detector.is_dir() else detector
    try:
        given = parse_toml(read_text(path, LARGEST_TOML), f"--detector {detector}: {path}")
    except OSError as error:
        raise MissionFileError(
            f"--detector {detector}: {path.name} cannot be read ({error.strerror}); give a folder "
            "that `uavmap tune` has written, such a file, or one of the names "
            f"{', '.join(detector_descriptions())}"
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
            section["model"] = str(_absolute(path.parent, section["model"]))
        except MissionFileError as error:
            raise MissionFileError(f"--detector {detector}: {path}: {error}") from None
    return section


# --- files and plug-ins ------------------------------------------------------------------------
def _absolute(folder: Path, model: str) -> Path:
    try:
        return (folder / model).resolve()
    except (OSError, ValueError, RuntimeError) as error:  # invalid name, or links in a circle
        raise MissionFileError(
            f"detector.model = {model!r}: not the path of a file ({error}); name the model's file"
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
            f"detector.name = {name!r}: the plug-in {plugins[name].value} returns no detector: a "
            "detector has name, calibrated, probability and mask"
        )
    return made


@lru_cache(maxsize=1)
def _plugins() -> Mapping[str, EntryPoint]:
    """Return the plug-ins by name; none replaces a built-in detector."""
    found = {point.name: point for point in entry_points(group=GROUP)}
    return {name: point for name, point in found.items() if name not in detector_names()}


def _loaded(name: str, point: EntryPoint) -> Callable[..., Detector]:
    try:
        build: Callable[..., Detector] = point.load()
    except Exception as error:  # a plug-in may raise any error
        raise MissionFileError(
            f"detector.name = {name!r}: the plug-in {point.value} cannot be loaded "
            f"({type(error).__name__}: {error}); install it again, or remove it"
        ) from None
    return build


# --- the copy with the results --------------------------------------------------------------------
KEPT: Final = "detector"
"""Folder of the copy, in the folder of the results."""
_BESIDE: Final = ".toml"  # settings of a segmentation model, under its name


def keep_detector(section: DetectorSection, folder: Path) -> None:
    """Copy the model of a mission, if any, into the folder of its results.

    Raises `OutputError`, and leaves no copy, if writing fails or the model has changed.
    """
    if section.model is None:
        return
    model, kept = Path(section.model), folder / KEPT
    try:
        kept.mkdir(parents=True, exist_ok=True)
        _copy(model, kept / model.name)
        settings = model.with_suffix(_BESIDE)
        if section.name == "onnx":
            _copy(settings, kept / settings.name)
        table = section.model_dump(mode="json", exclude_unset=True) | {"model": model.name}
        (kept / DETECTOR_TOML).write_text(tomlkit.dumps({"detector": table}), "utf-8")
    except OSError as error:
        drop_detector(folder)
        raise OutputError(
            f"{kept}: the detector's model cannot be copied ({error.strerror}); make room, or give "
            "another --out"
        ) from None
    if section.model_sha256 not in (None, _sha256((kept / model.name).read_bytes())):
        drop_detector(folder)
        raise OutputError(f"{model}: the file has changed since it was read; begin again")


def drop_detector(folder: Path) -> None:
    """Remove the copy of `keep_detector`, for a mission that has not begun."""
    shutil.rmtree(folder / KEPT, ignore_errors=True)


def with_kept_detector(mission: Mission, folder: Path) -> Mission:
    """Return the mission with its model read from the unchanged copy in a folder, if any."""
    section = mission.detector
    if section.model is None:
        return mission
    kept = (folder / KEPT / Path(section.model).name).resolve()
    with contextlib.suppress(OSError):
        if kept.is_file() and section.model_sha256 == _sha256(kept.read_bytes()):
            moved = section.model_copy(update={"model": str(kept)})
            return mission.model_copy(update={"detector": moved})
    return mission


def with_relative_model(text: str) -> str:
    """Return the text of a mission file for the results, beside the copy of its model."""
    document = tomlkit.parse(text)
    section = document["detector"]
    if "model" in section:
        section["model"] = f"{KEPT}/{Path(str(section['model'])).name}"
    return tomlkit.dumps(document)


def _copy(source: Path, target: Path) -> None:
    """Copy a file whole or not at all."""
    temporary = target.with_name(f".{target.name}")
    try:
        shutil.copyfile(source, temporary)
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)
