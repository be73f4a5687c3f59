"""The detector's files, kept beside the journal of a flight or a replay.

Results are moved to other computers, and models are tidied away. So the results hold a copy of
the model, as a folder that `--detector` takes, checked by the checksum in the mission.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
from pathlib import Path
from typing import Final

import tomlkit

from missions.errors import OutputError
from missions.mission.schema import Mission
from missions.mission.sections.detector_section import DetectorSection
from uavmap.load.detector_source import DETECTOR_TOML

KEPT: Final = "detector"
"""The folder, in that of the results."""
_BESIDE: Final = ".toml"  # settings of a segmentation model, under its name


def keep_detector(section: DetectorSection, folder: Path) -> None:
    """Copy the model of a mission, if it has one, into the folder of its results.

    Raises `OutputError`, and leaves nothing, where the disk refuses, or the model has changed.
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
        table = section.model_dump(mode="json", exclude_unset=True) | {"model": model.name}
        (kept / DETECTOR_TOML).write_text(tomlkit.dumps({"detector": table}), "utf-8")
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


def with_kept_detector(mission: Mission, folder: Path) -> Mission:
    """Return the mission with its model read from the unchanged copy in a folder, if any."""
    section = mission.detector
    if section.model is None:
        return mission
    kept = (folder / KEPT / Path(section.model).name).resolve()
    with contextlib.suppress(OSError):
        if kept.is_file() and section.model_sha256 == _sha256(kept):
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


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
