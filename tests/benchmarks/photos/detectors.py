"""Quality of the detectors on the photographs of Brighton Beach; prints a table.

    python -m tests.benchmarks.photos.detectors              picture by picture, about three minutes
    python -m tests.benchmarks.photos.detectors --map      the maps that `replay` makes, by the tags
    python -m tests.benchmarks.photos.detectors --time          milliseconds a picture on one core

Pixels and cells (25 x 25 px, about 2 m) are counted in the photographs themselves, so that poses do
not matter. `learned` is learned from three photographs and judged on the other fifteen, three times
with other photographs. Neighbours overlap, so ground is seen again from another place.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from missions.geo.grid import Grid
from tests.benchmarks.frame import cpu_ms, options_of
from tests.benchmarks.photos import brighton
from tests.benchmarks.photos.brighton import PAINTED, learned_from
from uavmap.load.mission_source import load
from uavmap.photos.tune.examples import Example
from uavmap.photos.tune.selection import KINDS, SETS, Counts, cell_counts, total
from uavmap.photos.tune.tune_job import TuneSettings
from uavmap.ui.cli import main as uavmap
from vision.detectors import Detector, make_detector
from vision.detectors.learned_model import LearnedDetector

CELL_PX = 25.0
Judged = tuple[Counts, Counts]


def fixed() -> dict[str, Detector]:
    """Return the detectors that are not learned, with parameters chosen by hand for a road."""
    return {
        "threshold (the paper's)": make_detector("threshold"),
        "paved": make_detector("paved"),
        "adaptive": make_detector("adaptive", **brighton.ADAPTIVE),
        "color": make_detector("color", **brighton.COLOR),
        "index (exg)": make_detector("index", **brighton.INDEX),
    }


def judged(detector: Detector, example: Example, share: float) -> Judged:
    """Count pixels and cells of a photograph."""
    sure = np.ones_like(example.region)
    mask = detector.mask(example.picture) > 0
    values = (
        detector.probability(example.picture) if detector.calibrated else mask.astype(np.float32)
    )
    region = example.region.astype(np.float32)
    return (
        Counts.compare(mask, example.region, sure),
        cell_counts(values, region, sure, CELL_PX, share),
    )


def row(name: str, found: Sequence[Judged]) -> None:
    """Print a line of the table."""
    pixels, cells = (total([one[i] for one in found]) for i in (0, 1))
    ious = sorted(cells.iou for _, cells in found)
    print(
        f"{name:44} {pixels.precision:6.3f} {pixels.recall:6.3f} {pixels.iou:6.3f}   "
        f"{cells.precision:6.3f} {cells.recall:6.3f} {cells.iou:6.3f}   "
        f"{ious[0]:.2f} to {ious[-1]:.2f}",
        flush=True,
    )


def head() -> None:
    """Print the head of the table."""
    print(f"{'detector':44} {'pixels: precision, recall, IoU':22}  cells           spread of IoU")


def by_picture(examples: list[Example]) -> None:
    """Run all detectors; `learned` as `uavmap tune` chooses."""
    head()
    for name, detector in fixed().items():
        row(name, [judged(detector, example, 0.5) for example in examples])
    every: list[Judged] = []
    for painted in PAINTED:
        every += one_training(examples, painted, TuneSettings())
    row("learned, all three", every)


def one_training(
    examples: list[Example], painted: Sequence[int], settings: TuneSettings
) -> list[Judged]:
    """Learn from some, judge the others."""
    others = [example for i, example in enumerate(examples) if i not in painted]
    model, choice = learned_from(examples, painted, others, settings)
    found = [judged(LearnedDetector(model), example, choice.share) for example in others]
    row(f"learned from {painted}: {choice.kind}, {choice.features}", found)
    return found


def by_map(examples: list[Example]) -> None:
    """Print the maps of `uavmap replay`, with the poses of the tags."""
    print("maps by the poses of the tags      precision recall IoU (cells of 2 m)")
    road = load("road")
    grid = Grid.at(road.home, road.grid.cell_m)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        print_map("of the mission road", folder / "road", [], grid)
        for number, painted in enumerate(PAINTED):
            model, choice = learned_from(examples, painted, examples)
            where = folder / f"model-{number}"
            brighton.detector_folder(where, {"share": choice.share}, model)
            out = folder / f"learned-{number}"
            print_map(f"learned from {painted}", out, ["--detector", str(where)], grid)


def print_map(name: str, out: Path, more: list[str], grid: Grid) -> None:
    """Replay and compare the map with the painted region."""
    uavmap(["replay", str(brighton.PHOTOGRAPHS), "--mission", "road", "--out", str(out), *more])
    counts = brighton.map_counts(out, grid)
    print(f"{name:34} {counts.precision:6.3f} {counts.recall:6.3f} {counts.iou:6.3f}")


def times(examples: list[Example]) -> None:
    """Print the milliseconds for a picture of 1000 x 562 px on one core."""
    cv2.setNumThreads(1)
    detectors = fixed()
    for kind in KINDS:
        for names in SETS:
            settings = TuneSettings(kinds=(kind,), sets=(names,))
            model, _ = learned_from(examples, PAINTED[0], [], settings)
            detectors[f"learned: {kind}, {names}"] = LearnedDetector(model)
    for name, detector in detectors.items():
        ms = cpu_ms(partial(detector.probability, examples[9].picture), times=5)
        print(f"{name:44} {ms:6.1f} ms")


def main() -> None:
    """Print the requested tables."""
    options = options_of(__doc__, map=False, time=False)
    if not brighton.there():
        raise SystemExit(f"{brighton.PHOTOGRAPHS}: the photographs are not here")
    chosen = {by_map: options.map, times: options.time}
    show = next((show for show, on in chosen.items() if on), by_picture)
    show(brighton.examples(brighton.names()))


if __name__ == "__main__":
    main()
