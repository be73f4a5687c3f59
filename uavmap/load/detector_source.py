"""Detectors as missions name them: their parameters, their files, and those of plug-ins.

A mission holds path and checksum of its model, so a resumed flight is judged by the same model.
Results hold a copy of it, as a folder that `--detector` takes.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
import tomllib
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, Final

import tomlkit
from pydantic import ValidationError

from missions.errors import MissionFileError, OutputError
from missions.mission.messages import explain
from missions.mission.schema import Mission
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
"""The entry points that plug-ins have: a name, and what makes the detector of its parameters."""
DETECTOR_TOML: Final = "detector.toml"
OVERLAYS: Final = "overlays"
"""Judged pictures beside a detector that `uavmap tune` has learned."""
SIMULATORS: Final = "threshold"
"""The detector of a simulated flight whose mission has none yet: it fits the painted ground."""
_LARGEST_MODEL: Final = 500_000_000


def known_detectors() -> tuple[str, ...]:
    """The names of all detectors that are installed, sorted."""
    return tuple(sorted({*detector_names(), *_plugins()}))


def finds() -> Mapping[str, str]:
    """What each installed detector finds, by name, in a sentence; ours come first."""
    return {**FINDS, **dict.fromkeys(sorted(_plugins()), "What this plug-in marks.")}


def refuse_undecided(section: DetectorSection, source: str) -> None:
    """Raise `MissionFileError` where real pictures would be judged by no detector."""
    if section.name == LATER:
        raise MissionFileError(
            f'{source}: detector.name = "{LATER}": no detector is chosen, and only the simulator '
            "goes without; set one of "
            f"{', '.join(FINDS)}, or fly with --detector NAME (or a folder of `uavmap tune`)"
        )


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
        _made(SIMULATORS if name == LATER else name, section.parameters)


def detector_of_section(section: DetectorSection, height_ratio: float = 1.0) -> Detector:
    """Return the detector of a mission. Raises `MissionFileError` for a model unreadable or
    changed.

    Dilations are counted in pixels at the lowest layer; from `height_ratio` times that height fewer
    bridge the same gap.
    """
    parameters = section.parameters
    if "dilations" in parameters:
        parameters["dilations"] = round(parameters["dilations"] / height_ratio)
    if section.name not in FROM_FILES:
        return _made(SIMULATORS if section.name == LATER else section.name, parameters)
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


def region_in_words(section: DetectorSection) -> str:
    """Return what the detector of a mission takes for region, in words; reads no model.

    >>> region_in_words(DetectorSection())
    'darker than 150 of 255 (fits the simulator; for real ground see uavmap tune)'
    >>> region_in_words(DetectorSection(name="paved", paved={}))
    'bare ground: not green, and brighter than 90 of 255'
    """
    if section.classes is not None:
        names = [section.classes.names[number] for number in section.explored]
        return f"{', '.join(names)}: {_looks(section)}"
    return _looks(section)


def _looks(section: DetectorSection) -> str:
    if section.model is not None:
        model = Path(section.model)
        return f"what the model {model.parent.name}/{model.name} was made to find"
    words: str | None = getattr(detector_of_section(section), "words", None)
    if words is None:
        return f"what the plug-in {section.name} marks"
    if section.name == LATER:
        return f"not chosen yet; the simulator takes {SIMULATORS}: {words}"
    simulated = section.name == "threshold"
    return f"{words} (fits the simulator; for real ground see uavmap tune)" if simulated else words


def region_lines(section: DetectorSection, folder: Path = Path()) -> Iterator[str]:
    """Report what a mission's detector takes for region, and which pictures show it, if any.
    `folder` is that from which the mission names its model."""
    yield f"region = {region_in_words(section)}"
    overlays = None if section.model is None else (folder / section.model).parent / OVERLAYS
    if overlays is not None and overlays.is_dir():
        yield f"look at what it marks: {overlays} (red: marked, green: painted)"


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
        path = _whole(folder, model)
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
            raise MissionFileError(f"--detector {name}: is made of a file; give its folder")
        return {"name": name, name: {}}
    path = detector / DETECTOR_TOML if detector.is_dir() else detector
    try:
        given = tomllib.loads(read_text(path, LARGEST_TOML))
    except OSError as error:
        raise MissionFileError(
            f"--detector {detector}: {path.name} cannot be read ({error.strerror}); give a folder "
            "that `uavmap tune` has written, such a file, or one of the names "
            f"{', '.join(finds())}"
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


# --- the copy with the results --------------------------------------------------------------------
KEPT: Final = "detector"
"""The folder, in that of the results."""
_BESIDE: Final = ".toml"  # settings of a segmentation model, under its name


def keep_detector(section: DetectorSection, folder: Path) -> None:
    """Copy the model of a mission, if any, into the folder of its results. Raises `OutputError`,
    and leaves nothing, where the disk refuses, or the model has changed."""
    if section.model is None:
        return
    model, kept = Path(section.model), folder / KEPT
    try:
        kept.mkdir(parents=True, exist_ok=True)
        _copied(model, kept / model.name)
        settings = model.with_suffix(_BESIDE)
        if section.name == "onnx":
            _copied(settings, kept / settings.name)
        table = section.model_dump(mode="json", exclude_unset=True) | {"model": model.name}
        (kept / DETECTOR_TOML).write_text(tomlkit.dumps({"detector": table}), "utf-8")
    except OSError as error:
        drop_detector(folder)
        raise OutputError(
            f"{kept}: the detector's model cannot be kept ({error.strerror}); make room, or give "
            "another --out"
        ) from None
    if section.model_sha256 not in (None, _sha256((kept / model.name).read_bytes())):
        drop_detector(folder)
        raise OutputError(f"{model}: the file has changed since it was read; begin again")


def drop_detector(folder: Path) -> None:
    """Remove what `keep_detector` has made, for a mission that has not begun."""
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


def _copied(source: Path, target: Path) -> None:
    """A copy that is whole or not there."""
    temporary = target.with_name(f".{target.name}")
    try:
        shutil.copyfile(source, temporary)
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)
