"""The data set Brighton Beach with a painted truth: the pixels of its photographs that are region.

The region (roads, their shoulders, parking) is a polygon that was painted on a mosaic, in
`tests/data/brighton/region.geojson`. A file beside it has the place of each photograph, measured by
registration of the photographs with each other. The poses in their tags have errors of metres.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import shapely
import tomlkit
from numpy.typing import NDArray

from missions.geo.grid import Grid
from missions.units import Cell
from uavmap.output.facts.map_model import NOT_ROI
from uavmap.photos.tune.examples import Example, read_picture
from uavmap.photos.tune.selection import Choice, Counts
from uavmap.photos.tune.tune_job import DETECTOR, MODEL, TuneSettings, learn
from vision.detectors.learned_model import Model, model_bytes

DATA = Path(__file__).parents[2] / "data" / "brighton"
PHOTOGRAPHS = Path(__file__).parents[4] / "shared" / "data" / "brighton_beach"
WIDTH_PX = 1000
PAINTED = ((2, 7, 12), (0, 9, 16), (5, 11, 14))
"""Numbers of the photographs that are painted, three at a time."""
PAVED: dict[str, Any] = {"greenness": 0.04, "intensity": 90, "dilations": 1}
COLOR: dict[str, Any] = {
    "samples": [[165, 160, 165], [125, 125, 140], [90, 95, 120]],
    "not_samples": [[110, 140, 70], [60, 80, 40], [40, 60, 35]],
}
INDEX: dict[str, Any] = {"kind": "exg", "value": 0.05, "side": "below"}
ADAPTIVE: dict[str, Any] = {"polarity": "bright", "offset": 10}
"""Parameters of detectors, chosen by hand for a road."""


def there() -> bool:
    """Return whether the photographs are on this machine; they are not part of the project."""
    return PHOTOGRAPHS.is_dir()


def rings() -> list[NDArray[np.float64]]:
    """Return the outline of the region and its holes, longitude and latitude."""
    (feature,) = json.loads((DATA / "region.geojson").read_text("utf-8"))["features"]
    return [np.array(ring) for ring in feature["geometry"]["coordinates"]]


def truth(name: str) -> NDArray[np.bool_]:
    """Return the region in a photograph, 1000 px wide, as it is stored."""
    places = json.loads((DATA / "pictures.json").read_text("utf-8"))
    matrix = np.array(places["pixel_of_1e-5_deg"][name])
    drawn = np.zeros((places["height_px"], places["width_px"]), np.uint8)
    for ring in rings():
        away = (ring - [places["lon_deg"], places["lat_deg"]]) * 1e5
        pixels = away @ matrix[:, :2].T + matrix[:, 2]
        one = np.zeros_like(drawn)
        cv2.fillPoly(one, [np.round(pixels * 16).astype(np.int32)], (1,), shift=4)
        drawn ^= one
    return drawn > 0


def names() -> list[str]:
    """Return the names of the photographs, in their order."""
    places = json.loads((DATA / "pictures.json").read_text("utf-8"))
    return sorted(places["pixel_of_1e-5_deg"])


def examples(chosen: Sequence[str]) -> list[Example]:
    """Return photographs, painted with the truth."""
    found = []
    for name in chosen:
        picture = read_picture(PHOTOGRAPHS / f"{name}.JPG", WIDTH_PX)
        rows, columns = picture.shape[:2]  # a quarter of 2250 rows is 562 or 563
        drawn = truth(name).astype(np.uint8)
        region = cv2.resize(drawn, (columns, rows), interpolation=cv2.INTER_NEAREST) > 0
        found.append(Example(name, picture, region.astype(np.uint8)))
    return found


# --- detectors and maps --------------------------------------------------------------------------
def learned_from(
    every: Sequence[Example],
    painted: Sequence[int],
    others: Sequence[Example],
    settings: TuneSettings = TuneSettings(),  # noqa: B008 - frozen
) -> tuple[Model, Choice]:
    """Return a model learned from some photographs, for others that are not painted."""
    pictures = [example.picture for example in others]
    model, choice, *_ = learn([every[i] for i in painted], pictures, settings, lambda _: None)
    return model, choice


def detector_folder(folder: Path, section: dict[str, Any], model: Model | None = None) -> Path:
    """Make a folder for `uavmap replay --detector`."""
    folder.mkdir()
    if model is not None:
        section = {"name": "learned", "model": MODEL, **section}
        (folder / MODEL).write_bytes(model_bytes(model))
    (folder / DETECTOR).write_text(tomlkit.dumps({"detector": section}), "utf-8")
    return folder


def map_counts(out: Path, grid: Grid) -> Counts:
    """Compare the judged cells of a map with the painted region."""
    roi, there = set(), set()
    for feature in json.loads((out / "map.geojson").read_text("utf-8"))["features"]:
        told = feature["properties"]
        if told["kind"] == "cell":
            cell = Cell(told["column"], told["row"])
            if told["state"] not in NOT_ROI:
                roi.add(cell)
            if _region_share(grid, cell) >= 0.5:
                there.add(cell)
    return Counts(len(roi & there), len(roi - there), len(there - roi))


def _region_share(grid: Grid, cell: Cell) -> float:
    """Return the part of a cell that is region."""
    outline, *holes = rings()
    corners = [grid.position(grid.to_fixed(point, 0.0)) for point in grid.corners_of(cell)]
    square = shapely.Polygon([(p.lon_deg, p.lat_deg) for p in corners])
    return float(shapely.Polygon(outline, holes).intersection(square).area / square.area)
