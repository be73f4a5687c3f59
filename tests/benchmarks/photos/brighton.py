"""The data set Brighton Beach with a painted truth: which pixels of its photographs are region.

The region (roads, their shoulders, parking) is a polygon that was painted on a mosaic, in
`tests/data/brighton/region.geojson`. Beside it lies where each photograph shows which place, as
measured by registering the photographs with each other; the poses in their tags are off by metres.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from uavmap.photos.tune.examples import Example, read_picture

DATA = Path(__file__).parents[2] / "data" / "brighton"
PHOTOGRAPHS = Path(__file__).parents[4] / "shared" / "data" / "brighton_beach"
WIDTH_PX = 1000


def there() -> bool:
    """Whether the photographs are on this machine; they are not part of the project."""
    return PHOTOGRAPHS.is_dir()


def rings() -> list[NDArray[np.float64]]:
    """The outline of the region and its holes, longitude and latitude."""
    (feature,) = json.loads((DATA / "region.geojson").read_text("utf-8"))["features"]
    return [np.array(ring) for ring in feature["geometry"]["coordinates"]]


def truth(name: str) -> NDArray[np.bool_]:
    """Which pixels of a photograph, 1000 px wide, as it is stored, are region."""
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
    """The photographs, in their order."""
    places = json.loads((DATA / "pictures.json").read_text("utf-8"))
    return sorted(places["pixel_of_1e-5_deg"])


def examples(chosen: Sequence[str]) -> list[Example]:
    """Photographs, painted with the truth."""
    found = []
    for name in chosen:
        picture = read_picture(PHOTOGRAPHS / f"{name}.JPG", WIDTH_PX)
        rows, columns = picture.shape[:2]  # a quarter of 2250 rows is 562 or 563
        drawn = truth(name).astype(np.uint8)
        region = cv2.resize(drawn, (columns, rows), interpolation=cv2.INTER_NEAREST) > 0
        found.append(Example(name, picture, region, np.ones_like(region)))
    return found
