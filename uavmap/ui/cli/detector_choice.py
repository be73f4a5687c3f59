"""The detector of a new mission: named, chosen at the terminal, trained, or left for later."""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from missions.errors import ImageError
from missions.mission.sections import LATER
from uavmap.base.terminal import Terminal
from uavmap.load.detector_source import detector_descriptions, detector_text, resolved_section
from uavmap.photos.sources.photo_file import SUFFIXES
from uavmap.photos.tune.paint_page import paint
from uavmap.photos.tune.training import need_learner
from uavmap.photos.tune.tune_job import FILES, OVERLAYS, TuneSettings, tune
from uavmap.ui.cli.common import ask, is_interactive, refuse_existing
from vision.detectors import detector_parameters

_LATER_TEXT: Final = "Choose it later: until then the mission only flies in the simulator."
TUNE_SETTINGS: Final = TuneSettings()
"""Settings for the training of a new mission's detector."""


def add_detector_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the detector."""
    group = parser.add_argument_group("the detector (default: chosen later)")
    either = group.add_mutually_exclusive_group()
    either.add_argument(
        "--detector",
        metavar="NAME|DIR",
        help=f"{', '.join(detector_descriptions())}, a folder made by `uavmap tune`, or {LATER}",
    )
    either.add_argument(
        "--like",
        metavar="PHOTO",
        nargs="+",
        type=Path,
        help="train a detector on photographs, or on a folder of them, with masks NAME.png beside "
        "them. Without masks a page opens on which you paint them",
    )


def choose_detector(options: argparse.Namespace) -> Path | None:
    """Return the named detector, or the one chosen at the terminal; None: later, or to be trained.

    Raises `MissionFileError` for an unusable detector, `AreaError` without an answer.
    """
    name = options.detector
    if name is None and options.like is None and is_interactive():
        table = {**detector_descriptions(), LATER: _LATER_TEXT}
        for number, (known, text) in enumerate(table.items(), 1):
            sys.stderr.write(f"  {number}  {known:9}  {text}\n")
        answer = ask("detector (number, name, or a folder made by `uavmap tune`):")
        name = dict(zip(map(str, range(1, 1 + len(table))), table, strict=True)).get(answer, answer)
    if name is None or name == LATER:
        return None
    detector_text(Path(name))
    return Path(name)


def detector_table(detector: Path | None, folder: Path) -> dict[str, Any]:
    """Return the table `[detector]` of a mission file in a folder, with its parameters."""
    if detector is None:
        return {"name": LATER}
    table = resolved_section(None, Path(), detector) or {}
    table.pop("model_sha256", None)  # the file on the day of the flight counts
    name = table["name"]
    if "model" in table:
        table["model"] = os.path.relpath(table["model"], folder.resolve())
    elif name == "threshold" and not table.get(name):
        return {"name": name}  # the mission text has its keys with their defaults
    tables = {key: table.pop(key) for key in list(table) if isinstance(table[key], dict)}
    return table | {"tables": {**tables, name: detector_parameters(name) | tables.get(name, {})}}


def train_detector(photographs: Sequence[Path], mission: Path) -> Path:
    """Train a detector on photographs; return its folder, beside the mission file.

    Raises `ImageError`, `OutputError`, and `UavmapError` without the extra `tune`.
    """
    need_learner()
    out = mission.with_name(f"{mission.stem}-detector")
    painted = mission.with_name(f"{mission.stem}-painted")
    refuse_existing(out, FILES)
    show = Terminal().show
    found = list(_photographs(photographs))
    with tempfile.TemporaryDirectory() as scratch:
        images, masks = Path(scratch) / "photographs", Path(scratch) / "masks"
        for folder in (images, masks):
            folder.mkdir()
        for photograph, mask in found:
            _link(photograph, images / photograph.name)
            if mask is not None:
                _link(mask, masks / f"{photograph.stem}.png")
        if not any(mask for _, mask in found):
            masks = painted
            if is_interactive() or not painted.exists():
                _paint(images, painted, found[0][0], show)
        report = tune(images, masks, out, TUNE_SETTINGS, show)
    low, high = report["cell_iou_spread"]
    show(f"cell IoU from {low:.2f} to {high:.2f} on photographs that were not used for training")
    show(f"check {out / OVERLAYS} before you use it: the detector rates red ground as region")
    return out


def _paint(images: Path, painted: Path, first: Path, show: Any) -> None:
    if not is_interactive():
        raise ImageError(
            f"--like {first}: no mask beside it; paint {first.with_suffix('.png').name} (white: "
            "region, black: not region), or run the command at a terminal: a page opens on which "
            "you paint"
        )
    try:
        paint(images, painted, TUNE_SETTINGS.width_px, show)
    finally:
        if painted.is_dir() and not any(painted.iterdir()):
            shutil.rmtree(painted)


def _photographs(given: Sequence[Path]) -> Iterator[tuple[Path, Path | None]]:
    """Yield each photograph with the mask beside it, if any. Raises `ImageError`."""
    files = [
        file
        for path in given
        for file in (sorted(path.iterdir()) if path.is_dir() else [path])
        if not path.is_dir() or file.suffix.lower() in SUFFIXES
    ]
    names: dict[str, Path] = {}
    masks = {mask for file in files if (mask := _mask(file)) is not None}
    for file in files:
        if not file.is_file():
            raise ImageError(f"--like {file}: no such photograph")
        if file in masks:
            continue
        if (other := names.setdefault(file.stem, file)) != file:
            raise ImageError(f"--like {file}: has the same name as {other}; rename one of them")
        yield file, _mask(file)
    if not names:
        raise ImageError(f"--like {given[0]}: has no photograph; give JPEG, PNG or TIFF files")


def _mask(photograph: Path) -> Path | None:
    """Return the mask beside a photograph: `NAME.png`, or `NAME.JPG.png`."""
    named = (photograph.with_suffix(".png"), photograph.with_name(f"{photograph.name}.png"))
    return next((path for path in named if path != photograph and path.is_file()), None)


def _link(source: Path, target: Path) -> None:
    target.symlink_to(source.resolve())
