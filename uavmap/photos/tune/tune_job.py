"""From examples to a detector's folder: `detector.toml`, its model, overlays and a report."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import cv2
import numpy as np
import tomlkit
from numpy.typing import NDArray

from missions.classes import Classes
from missions.errors import ImageError, MissionFileError, OutputError
from uavmap.base.atomic_write import umask, write_bytes, write_text
from uavmap.output.drawing.judged import RED, outline
from uavmap.output.summary import encode
from uavmap.photos.draft_map import MAP, Drafts
from uavmap.photos.next_pictures import NEXT, write_next
from uavmap.photos.tune.class_training import check_classes, class_counts, fit_classes
from uavmap.photos.tune.examples import (
    Example,
    list_pictures,
    load_examples,
    read_classes,
    read_picture,
)
from uavmap.photos.tune.familiar_ground import (
    Sure,
    familiar_ground,
    sure_cells,
    wrong_at_most,
)
from uavmap.photos.tune.selection import (
    KINDS,
    SETS,
    Choice,
    Counts,
    Picture,
    choose,
    fitted,
    picture_counts,
    total,
)
from uavmap.photos.tune.training import PictureFeatures, Scale, described, need_learner, variants
from vision.detectors.learned_model import LearnedDetector, Model, model_bytes
from vision.detectors.pixel_features import STRIDE, described_shape, features

MODEL: Final = "model.json"
DETECTOR: Final = "detector.toml"
REPORT: Final = "report.json"
OVERLAYS: Final = "overlays"
FILES: Final = (MODEL, REPORT, OVERLAYS, MAP, NEXT, DETECTOR)
_OTHERS: Final = 24  # maximum pictures without examples that normalise the features
_SHOWN: Final = 12  # maximum number of those that are drawn
_MIN_SPREAD: Final = 1e-3
_GREEN: Final = (0, 255, 0)

Show = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class TuneSettings:
    """Settings of a training; `cell_px` is the side of a map cell at the working width."""

    seed: int = 0
    width_px: int = 1000
    cell_px: float = 25.0
    kinds: tuple[str, ...] = KINDS
    sets: tuple[str, ...] = tuple(SETS)
    classes: Classes | None = None
    """Classes that are painted; None for region and surround alone."""


def tune(
    images: Path,
    where: Path,
    out: Path,
    settings: TuneSettings,
    show: Show,
    drafts: Drafts | None = None,
) -> dict[str, Any]:
    """Learn a detector, draw a map of the pictures with it; return the report.

    `out` appears once all its content is complete: an interruption, or a full disk, leaves nothing.
    Raises `ImageError` for faults of pictures or examples, `UavmapError` without scikit-learn,
    `OutputError` if the disk refuses.
    """
    need_learner()
    settings = replace(settings, classes=read_classes(where))
    examples = load_examples(images, where, settings.width_px, show)
    others = _others(images, {example.name for example in examples}, settings, show)
    show(f"{len(examples)} painted, {len(others)} others to normalise features")
    found = learn(examples, [picture for _, picture in others], settings, show)
    report, choice = _report(found, settings), found.choice
    try:
        with _complete_folder(out) as folder:
            write_bytes(folder / MODEL, model_bytes(found.model))
            write_text(folder / DETECTOR, _detector_toml(choice, report, settings.classes))
            write_text(folder / REPORT, encode(report) + "\n")
            _draw(folder / OVERLAYS, examples, others[:_SHOWN], choice, found.model)
            _draft(drafts or Drafts(images), folder, show)
    except OSError as error:
        raise OutputError(f"--out {out} cannot be written: {error.strerror}") from None
    return report


def _draft(drafts: Drafts, folder: Path, show: Show) -> None:
    """Draw a map, and name the pictures to paint next; report why if no picture has a place."""
    show("mapping all pictures with it")
    try:
        drafts.draw(folder, folder)
    except (ImageError, MissionFileError) as error:
        show(f"no map, and no picture to paint next: {error}")
    write_next(drafts.asked, folder)


@contextmanager
def _complete_folder(out: Path) -> Iterator[Path]:
    """Yield a folder beside `out` that replaces it, or adds to it, once it is complete."""
    out.parent.mkdir(parents=True, exist_ok=True)
    folder = Path(tempfile.mkdtemp(dir=out.parent, prefix=f".{out.name}."))
    try:
        yield folder
        folder.chmod(0o777 & ~umask())
        if not out.exists():
            folder.rename(out)
            return
        for name in FILES:  # beside other files there; the file that names the model comes last
            _replace(folder / name, out / name)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


class LearnedModel(NamedTuple):
    """A model, the choice of cross-validation, the examples described, and their sure shares.

    `classes` has the counts of the places of each class, if several are painted.
    """

    model: Model
    choice: Choice
    pictures: Sequence[Picture]
    sure: Sequence[Sure]
    classes: Mapping[int, Counts]


def _replace(new: Path, old: Path) -> None:
    """Move a file or folder over an old one; move the old one away if there is no new one."""
    if old.is_dir():
        shutil.rmtree(old)
    else:
        old.unlink(missing_ok=True)
    if new.exists():
        new.rename(old)


def learn(
    examples: Sequence[Example],
    others: Sequence[NDArray[np.uint8]],
    settings: TuneSettings,
    show: Show,
) -> LearnedModel:
    """Learn from examples.

    Raises `ImageError` if fewer than two pictures are painted, or if one of them holds all the
    region or all the surround.
    """
    _check_spread(examples)
    numbers = () if settings.classes is None else tuple(settings.classes.names)
    if settings.classes is not None:
        check_classes(examples, settings.classes)
    pictures = []
    for number, example in enumerate(examples):
        rng = np.random.default_rng([settings.seed, number])
        pictures.append(tuple(map(described, [example, *variants(example, rng)])))
    scale = _scale(pictures, others)
    cell = settings.cell_px / STRIDE
    ground = familiar_ground(pictures, scale, settings.seed)
    choice = choose(
        pictures, scale, ground.left_out, cell, settings.seed, show, settings.kinds, settings.sets
    )
    names = SETS[choice.features]
    sure = sure_cells(pictures, choice, ground, cell)
    model = Model(
        features=names,
        working_width_px=settings.width_px,
        parts=fitted(pictures, names, scale, choice.kind, settings.seed),
        slope=choice.slope,
        offset=choice.offset,
        threshold=choice.threshold,
        familiarity=ground.familiarity,
        wrong_at_most=wrong_at_most(sure),
        classes=fit_classes(pictures, numbers, names, scale, settings.seed) if numbers else None,
    )
    classes = class_counts(pictures, choice, numbers, scale, settings.seed) if numbers else {}
    return LearnedModel(model, choice, pictures, sure, classes)


def _check_spread(examples: Sequence[Example]) -> None:
    for number, kind in enumerate(("region", "surround")):
        count = sum(example.shows[number] for example in examples)
        if count < 2:
            raise ImageError(
                f"{count} of {len(examples)} painted pictures shows {kind}; paint at least two "
                "that do: a detector is tested on pictures that it was not learned from"
            )


def _others(
    images: Path, painted: set[str], settings: TuneSettings, show: Show
) -> list[tuple[str, NDArray[np.uint8]]]:
    """Return some pictures that are not painted, evenly from all of them."""
    paths = [path for path in list_pictures(images) if path.stem not in painted]
    step = max(1, -(-len(paths) // _OTHERS))
    found = []
    for path in paths[::step]:
        try:
            found.append((path.stem, read_picture(path, settings.width_px)))
        except ImageError as error:
            show(f"left out: {error}")
    return found


def _scale(pictures: Sequence[Picture], others: Sequence[NDArray[np.uint8]]) -> Scale:
    """Return mean and standard deviation of each feature; each picture counts alike."""
    some = [one.values[:, ::7] for picture in pictures for one in picture]
    some += [f.reshape(len(f), -1)[:, ::7] for f in map(features, others)]
    means = np.stack([values.mean(axis=1, dtype=np.float64) for values in some])
    squares = np.stack([(values.astype(np.float64) ** 2).mean(axis=1) for values in some])
    mean = means.mean(axis=0)
    spread = np.sqrt(np.maximum(squares.mean(axis=0) - mean**2, 0.0))
    return mean, np.maximum(spread, _MIN_SPREAD)


# --- the files -------------------------------------------------------------------------------
def _report(found: LearnedModel, settings: TuneSettings) -> dict[str, Any]:
    pictures, choice = found.pictures, found.choice
    cell = settings.cell_px / STRIDE
    counts = [
        picture_counts(plain, share, cell, choice.threshold, choice.share)
        for (plain, *_), share in zip(pictures, choice.shares, strict=True)
    ]
    rows = [
        {
            "picture": plain.name,
            "region_share": round(_region_share(plain), 4),
            "pixels": _figures(pixels),
            "cells": _figures(cells),
            "sure": sure.share,
            "wrong_when_sure": sure.wrong,
        }
        for (plain, *_), (pixels, cells), sure in zip(pictures, counts, found.sure, strict=True)
    ]
    ious = [cells.iou for _, cells in counts]
    return {
        "model": choice.kind,
        "features": choice.features,
        "seed": settings.seed,
        "working_width_px": settings.width_px,
        "cell_px": settings.cell_px,
        "threshold": choice.threshold,
        "share": choice.share,
        "calibration": [choice.slope, choice.offset],
        "pixels": _figures(total([pixels for pixels, _ in counts])),
        "cells": _figures(total([cells for _, cells in counts])),
        "wrong_at_most": found.model.wrong_at_most,
        "cell_iou_spread": [round(min(ious), 4), round(max(ious), 4)],
        "pictures": rows,
        "tried": dict(choice.tried),
        **_class_report(found.classes, settings.classes),
    }


def _class_report(counts: Mapping[int, Counts], classes: Classes | None) -> dict[str, Any]:
    if classes is None:
        return {}
    return {
        "classes": [
            {"number": number, "name": name, **_figures(counts[number])}
            for number, name in classes.names.items()
        ]
    }


def _region_share(one: PictureFeatures) -> float:
    return float(one.region[one.known].mean()) if one.known.any() else 0.0


def _figures(counts: Counts) -> dict[str, float]:
    return {
        "precision": round(counts.precision, 4),
        "recall": round(counts.recall, 4),
        "iou": round(counts.iou, 4),
    }


def _detector_toml(choice: Choice, report: dict[str, Any], classes: Classes | None) -> str:
    section: dict[str, Any] = {"name": "learned", "model": MODEL, "share": choice.share}
    if classes is not None:
        section["classes"] = classes.model_dump(mode="json", exclude_unset=True)
    pixels, cells = report["pixels"], report["cells"]
    return (
        "# Written by `uavmap tune`. Results on painted pictures that it was not learned from:\n"
        f"# pixels IoU {pixels['iou']:.2f}, cells IoU {cells['iou']:.2f} "
        f"(precision {cells['precision']:.2f}, recall {cells['recall']:.2f}).\n"
        f"# In cells that it is sure of, at most {100 * report['wrong_at_most']:.0f} % are "
        "wrong in another picture.\n"
        f"{tomlkit.dumps({'detector': section})}"
    )


def _draw(
    folder: Path,
    examples: Sequence[Example],
    others: Sequence[tuple[str, NDArray[np.uint8]]],
    choice: Choice,
    model: Model,
) -> None:
    """Outline painted region in green, marked region in red.

    A painted picture shows the marks of a model that has not seen it.
    """
    folder.mkdir(exist_ok=True)
    for example, share in zip(examples, choice.shares, strict=True):
        rows, columns = example.picture.shape[:2]
        small = share.reshape(described_shape(rows, columns))
        whole = cv2.resize(small, (columns, rows), interpolation=cv2.INTER_LINEAR)
        drawn = example.picture.copy()
        outline(drawn, example.region, _GREEN)
        outline(drawn, np.asarray(whole >= choice.threshold), RED)
        _write_jpeg(folder / f"{example.name}.jpg", drawn)
    detector = LearnedDetector(model)
    for name, picture in others:
        drawn = picture.copy()
        outline(drawn, detector.mask(picture) > 0, RED)
        _write_jpeg(folder / f"{name}.jpg", drawn)


def _write_jpeg(path: Path, image: NDArray[np.uint8]) -> None:
    _, data = cv2.imencode(".jpg", image)
    write_bytes(path, bytes(data))
