"""How good the detectors are on the photographs of Brighton Beach; prints a table.

    python -m tests.benchmarks.photos.detectors              picture by picture, about three minutes
    python -m tests.benchmarks.photos.detectors --sets        each kind of model and set of features
    python -m tests.benchmarks.photos.detectors --map      the maps that `replay` makes, by the tags
    python -m tests.benchmarks.photos.detectors --time          milliseconds a picture on one core

Pixels and cells (25 x 25 px, about 2 m) are counted in the photographs themselves, so that poses do
not matter. `learned` is learned from three photographs and judged on the other fifteen, three times
with other photographs; neighbours overlap, so ground is seen again from elsewhere.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
import tomlkit
from numpy.typing import NDArray

from missions.geo.grid import Grid
from missions.units import Cell
from tests.benchmarks.photos import brighton
from uavmap.load.mission_source import load
from uavmap.output.facts.map_model import NOT_ROI
from uavmap.photos.tune.examples import Example
from uavmap.photos.tune.metrics import Counts, cell_counts, total
from uavmap.photos.tune.selection import KINDS, SETS
from uavmap.photos.tune.tune_job import DETECTOR, MODEL, Wishes, learned
from uavmap.ui.cli import main as uavmap
from vision.detectors import Detector, make_detector
from vision.detectors.learned_model import LearnedDetector, model_bytes

PAINTED = ((2, 7, 12), (0, 9, 16), (5, 11, 14))
CELL_PX = 25.0
Judged = tuple[Counts, Counts]


def fixed() -> dict[str, Detector]:
    """The detectors that are not learned, with parameters chosen by hand for a road."""
    return {
        "threshold (the paper's)": make_detector("threshold"),
        "paved (of the mission road)": make_detector("paved"),
        "adaptive": make_detector("adaptive", polarity="bright", offset=10),
        "color": make_detector(
            "color",
            samples=[[165, 160, 165], [125, 125, 140], [90, 95, 120]],
            not_samples=[[110, 140, 70], [60, 80, 40], [40, 60, 35]],
        ),
        "index (exg)": make_detector("index", kind="exg", value=0.05, side="below"),
    }


def judged(detector: Detector, example: Example, share: float) -> Judged:
    """Of pixels and of cells of a photograph."""
    sure = np.ones_like(example.region)
    mask = detector.mask(example.picture) > 0
    values = (
        detector.probability(example.picture) if detector.calibrated else mask.astype(np.float32)
    )
    region = example.region.astype(np.float32)
    return (
        Counts.of(mask, example.region, sure),
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
    """All detectors; `learned` as `uavmap tune` chooses."""
    head()
    for name, detector in fixed().items():
        row(name, [judged(detector, example, 0.5) for example in examples])
    every: list[Judged] = []
    for painted in PAINTED:
        every += one_training(examples, painted, Wishes())
    row("learned, all three", every)


def one_training(examples: list[Example], painted: Sequence[int], wishes: Wishes) -> list[Judged]:
    """Learn from some, judge the others."""
    others = [example for i, example in enumerate(examples) if i not in painted]
    model, choice, _ = learned(
        [examples[i] for i in painted], [e.picture for e in others], wishes, lambda _: None
    )
    found = [judged(LearnedDetector(model), example, choice.share) for example in others]
    row(f"learned from {painted}: {choice.kind}, {choice.features}", found)
    return found


def by_set(examples: list[Example]) -> None:
    """Each kind of model on each set of features."""
    head()
    for names in SETS:
        every: dict[str, list[Judged]] = {kind: [] for kind in KINDS}
        for painted in PAINTED:
            others = [example for i, example in enumerate(examples) if i not in painted]
            both, choice, _ = learned(
                [examples[i] for i in painted],
                [e.picture for e in others],
                Wishes(kinds=("both",), sets=(names,)),
                lambda _: None,
            )
            parts = {"both": both.parts, "logistic": both.parts[:1], "trees": both.parts[1:]}
            for kind in KINDS:
                detector = LearnedDetector(both.model_copy(update={"parts": parts[kind]}))
                found = [judged(detector, example, choice.share) for example in others]
                row(f"{kind} from {painted}", found)
                every[kind] += found
        for kind in KINDS:
            row(f"== {kind}, {names}", every[kind])


def by_map(examples: list[Example]) -> None:
    """The maps of `uavmap replay`, with the poses that the tags tell."""
    print("maps by the poses of the tags      precision recall IoU (cells of 2 m)")
    road = load("road")
    grid = Grid.at(road.home, road.grid.cell_m)
    with tempfile.TemporaryDirectory() as folder:
        print_map("paved", Path(folder) / "paved", [], grid)
        for number, painted in enumerate(PAINTED):
            model, choice, _ = learned(
                [examples[i] for i in painted], [e.picture for e in examples], Wishes(),
                lambda _: None,
            )  # fmt: skip
            where = Path(folder) / f"model-{number}"
            where.mkdir()
            (where / MODEL).write_bytes(model_bytes(model))
            section = {"name": "learned", "model": MODEL, "share": choice.share}
            (where / DETECTOR).write_text(tomlkit.dumps({"detector": section}), "utf-8")
            out = Path(folder) / f"learned-{number}"
            print_map(f"learned from {painted}", out, ["--detector", str(where)], grid)


def print_map(name: str, out: Path, more: list[str], grid: Grid) -> None:
    """Replay and hold the map against the painted region."""
    uavmap(["replay", str(brighton.PHOTOGRAPHS), "--mission", "road", "--out", str(out), *more])
    features = json.loads((out / "map.geojson").read_text("utf-8"))["features"]
    judged_cells, roi = set(), set()
    for feature in features:
        told = feature["properties"]
        if told["kind"] == "cell":
            cell = Cell(told["column"], told["row"])
            judged_cells.add(cell)
            if told["state"] not in NOT_ROI:
                roi.add(cell)
    there = {cell for cell in judged_cells if region_share(grid, cell) >= 0.5}
    counts = Counts(len(roi & there), len(roi - there), len(there - roi))
    print(f"{name:34} {counts.precision:6.3f} {counts.recall:6.3f} {counts.iou:6.3f}")


def region_share(grid: Grid, cell: Cell) -> float:
    """The part of a cell that is region."""
    import shapely  # noqa: PLC0415

    outline, *holes = brighton.rings()
    region = shapely.Polygon(outline, holes)
    corners = [grid.position(grid.to_fixed(point, 0.0)) for point in grid.corners_of(cell)]
    square = shapely.Polygon([(p.lon_deg, p.lat_deg) for p in corners])
    return float(region.intersection(square).area / square.area)


def times(examples: list[Example]) -> None:
    """Milliseconds a picture of 1000 x 562 px on one core."""
    cv2.setNumThreads(1)
    detectors = fixed()
    for kind in KINDS:
        for names in SETS:
            wishes = Wishes(kinds=(kind,), sets=(names,))
            model, _, _ = learned([examples[i] for i in PAINTED[0]], [], wishes, lambda _: None)
            detectors[f"learned: {kind}, {names}"] = LearnedDetector(model)
    for name, detector in detectors.items():
        print(f"{name:44} {cost_ms(detector.probability, examples[9].picture):6.1f} ms")


def cost_ms(judge: Callable[[NDArray[np.uint8]], object], picture: NDArray[np.uint8]) -> float:
    """The least CPU time of five."""
    costs = []
    for _ in range(5):
        began_s = time.process_time()
        judge(picture)
        costs.append(1000.0 * (time.process_time() - began_s))
    return min(costs)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for option in ("sets", "map", "time"):
        parser.add_argument(f"--{option}", action="store_true")
    options = parser.parse_args()
    if not brighton.there():
        raise SystemExit(f"{brighton.PHOTOGRAPHS}: the photographs are not here")
    pictures = brighton.examples(brighton.names())
    for asked, show in ((options.sets, by_set), (options.map, by_map), (options.time, times)):
        if asked:
            show(pictures)
            break
    else:
        by_picture(pictures)
