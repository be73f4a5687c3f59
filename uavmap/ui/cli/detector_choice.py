"""What a new mission looks for: a detector that is named, asked for, learned, or chosen later."""

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
from uavmap.load.detector_source import detector_text, finds, resolved_section
from uavmap.photos.sources.photo_file import SUFFIXES
from uavmap.photos.tune.paint_page import paint
from uavmap.photos.tune.training import need_learner
from uavmap.photos.tune.tune_job import FILES, OVERLAYS, Wishes, tune
from uavmap.ui.cli.common import answer_to, asks, overwrite_nothing
from vision.detectors import detector_parameters

_LATER_TEXT: Final = (
    "Nothing yet: the mission can be simulated, and does not fly before one is set."
)


WISHES: Final = Wishes()
"""How a detector of a new mission is learned."""


def add_detector_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the detector."""
    group = parser.add_argument_group("what to look for (default: later)")
    either = group.add_mutually_exclusive_group()
    either.add_argument(
        "--detector",
        metavar="NAME|DIR",
        help=f"{', '.join(finds())}; a folder that `uavmap tune` has written; or {LATER}",
    )
    either.add_argument(
        "--like",
        metavar="PHOTO",
        nargs="+",
        type=Path,
        help="learn it from photographs, or a folder of them, with masks NAME.png beside them; "
        "without masks a page to paint them on opens",
    )


def chosen(options: argparse.Namespace) -> Path | None:
    """Return the detector that is named, or answered at a terminal; None: later, or learned.

    Raises `MissionFileError` for one that cannot be used, `AreaError` without an answer.
    """
    name = options.detector
    if name is None and options.like is None and asks():
        table = {**finds(), LATER: _LATER_TEXT}
        for number, (known, text) in enumerate(table.items(), 1):
            sys.stderr.write(f"  {number}  {known:9}  {text}\n")
        answer = answer_to("what is the region (number, name, or a folder of `uavmap tune`):")
        name = dict(zip(map(str, range(1, 1 + len(table))), table, strict=True)).get(answer, answer)
    if name is None or name == LATER:
        return None
    detector_text(Path(name))
    return Path(name)


def detector_table(detector: Path | None, folder: Path) -> dict[str, Any]:
    """Return the table `[detector]` for a mission file in a folder, with its parameters."""
    if detector is None:
        return {"name": LATER}
    table = resolved_section(None, Path(), detector) or {}
    table.pop("model_sha256", None)  # that of the file on the day of the flight counts
    name = table["name"]
    if "model" in table:
        table["model"] = os.path.relpath(table["model"], folder.resolve())
    elif name == "threshold" and not table.get(name):
        return {"name": name}  # the section has its keys, with their defaults
    tables = {key: table.pop(key) for key in list(table) if isinstance(table[key], dict)}
    return table | {"tables": {**tables, name: detector_parameters(name) | tables.get(name, {})}}


def learned(photographs: Sequence[Path], mission: Path) -> Path:
    """Learn a detector from photographs; return its folder, beside the mission file.

    Raises `ImageError`, `OutputError`, and `UavmapError` without the extra `tune`.
    """
    need_learner()
    out = mission.with_name(f"{mission.stem}-detector")
    painted = mission.with_name(f"{mission.stem}-painted")
    overwrite_nothing(out, FILES)
    show = Terminal().show
    found = list(_photographs(photographs))
    with tempfile.TemporaryDirectory() as scratch:
        images, masks = Path(scratch) / "photographs", Path(scratch) / "masks"
        for folder in (images, masks):
            folder.mkdir()
        for photograph, mask in found:
            _linked(photograph, images / photograph.name)
            if mask is not None:
                _linked(mask, masks / f"{photograph.stem}.png")
        if not any(mask for _, mask in found):
            masks = painted
            if asks() or not painted.exists():
                _paint(images, painted, found[0][0], show)
        report = tune(images, masks, out, WISHES, show)
    low, high = report["cell_iou_spread"]
    show(f"cell IoU from {low:.2f} to {high:.2f} on photographs that it was not learned from")
    show(f"look at {out / OVERLAYS} first: red is what it takes for the region")
    return out


def _paint(images: Path, painted: Path, first: Path, show: Any) -> None:
    if not asks():
        raise ImageError(
            f"--like {first}: no mask beside it; paint {first.with_suffix('.png').name} (white: "
            "region, black: not), or call it at a terminal, which opens a page to paint on"
        )
    try:
        paint(images, painted, WISHES.width_px, show)
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
            raise ImageError(f"--like {file}: there is no such photograph")
        if file in masks:
            continue
        if (other := names.setdefault(file.stem, file)) != file:
            raise ImageError(f"--like {file}: has the name of {other}; rename one of them")
        yield file, _mask(file)
    if not names:
        raise ImageError(f"--like {given[0]}: holds no photograph; give JPEG, PNG or TIFF files")


def _mask(photograph: Path) -> Path | None:
    """Return the mask beside a photograph: `NAME.png`, or `NAME.JPG.png`."""
    named = (photograph.with_suffix(".png"), photograph.with_name(f"{photograph.name}.png"))
    return next((path for path in named if path != photograph and path.is_file()), None)


def _linked(source: Path, target: Path) -> None:
    target.symlink_to(source.resolve())
