"""The detector's files, kept beside the journal of a flight or a replay.

A journal holds the text of a mission, and that names a model by its path. Results are moved to
another computer, and models are tidied away. So a copy lies in the results, as a folder that
`--detector` takes; what is read later is held against the checksum in the text, as ever.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from missions.errors import MissionFileError, OutputError
from missions.mission_file.detector_section import DetectorSection
from missions.mission_file.schema import parse_toml
from uavmap.detector_source import DETECTOR_TOML
from uavmap.toml_text import toml_text

KEPT: Final = "detector"
"""The folder, in that of the results."""
_BESIDE: Final = ".toml"  # settings of a segmentation model, under its name


def keep_detector(section: DetectorSection, text: str, folder: Path) -> None:
    """Copy the model of a mission into the folder of its results, if its detector has one.

    `text` is the mission's. Raises `OutputError` where the disk refuses, or the model is not what
    the text says any more; nothing is left behind then.
    """
    if section.model is None:
        return
    model, kept = Path(section.model), folder / KEPT
    try:
        kept.mkdir(parents=True, exist_ok=True)
        _copied(model, kept / model.name)
        settings = model.with_suffix(_BESIDE)
        if section.name == "onnx":
            _copied(settings, kept / settings.name)
        table = dict(_section(text))
        table["model"] = model.name
        (kept / DETECTOR_TOML).write_text(toml_text({"detector": table}), "utf-8")
    except OSError as error:
        drop_detector(folder)
        raise OutputError(
            f"{kept}: the detector's model cannot be kept ({error.strerror}); make room, or give "
            "another --out"
        ) from None
    if section.model_sha256 not in (None, _sha256(kept / model.name)):
        drop_detector(folder)
        raise OutputError(f"{model}: the file has changed since it was read; begin again")


def drop_detector(folder: Path) -> None:
    """Remove what `keep_detector` has made, for a mission that has not begun."""
    shutil.rmtree(folder / KEPT, ignore_errors=True)


def with_kept_detector(text: str, folder: Path) -> str:
    """The text of a mission with its model read from the copy in a folder of results.

    A text without a model, or with one of which no copy lies there, or a changed one, is returned
    as it is.
    """
    try:
        tables = parse_toml(text, str(folder))
    except MissionFileError:
        return text  # whoever parses it says what is wrong
    section = tables.get("detector")
    if not isinstance(section, Mapping) or not isinstance(section.get("model"), str):
        return text
    kept = (folder / KEPT / Path(section["model"]).name).resolve()
    with contextlib.suppress(OSError):
        if kept.is_file() and section.get("model_sha256") == _sha256(kept):
            return toml_text({**tables, "detector": {**section, "model": str(kept)}})
    return text


def with_relative_model(text: str, source: str) -> str:
    """The text of a mission file that lies in the results, beside the copy of its model."""
    tables = parse_toml(text, source)
    section = tables.get("detector")
    if not isinstance(section, Mapping) or not isinstance(section.get("model"), str):
        return text
    name = f"{KEPT}/{Path(section['model']).name}"
    return toml_text({**tables, "detector": {**section, "model": name}})


def _section(text: str) -> Mapping[str, Any]:
    section: Mapping[str, Any] = parse_toml(text, "the mission")["detector"]
    return section


def _copied(source: Path, target: Path) -> None:
    """A copy that is whole or not there."""
    temporary = target.with_name(f".{target.name}")
    try:
        shutil.copyfile(source, temporary)
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
