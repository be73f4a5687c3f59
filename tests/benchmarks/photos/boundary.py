"""Accuracy of the boundary at pixel level; prints a table.

    python -m tests.benchmarks.photos.boundary                  `runway` in the simulator, ten seeds
    python -m tests.benchmarks.photos.boundary --seeds 3
    python -m tests.benchmarks.photos.boundary --brighton       the photographs of Brighton Beach

In the simulator the camera tilts with the airframe, the wind blows, positions have errors of 0.3 m,
and the light changes. The error of the boundary is measured both ways: from each of its points
(every 0.1 m) to the true outline, and back.
"""

from __future__ import annotations

import contextlib
import io
import json
import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from missions.flight.setting_of import setting_of
from missions.geo.grid import Grid
from missions.units import LatLon
from tests.benchmarks import frame
from tests.benchmarks.photos import brighton
from tests.benchmarks.photos.brighton import PAINTED, detector_folder, learned_from
from tests.support.plans import named_text
from tests.support.small_missions import first_patch
from uavmap.load.mission_source import load
from uavmap.output.facts.flown_mission import BOUNDARY_FILE
from uavmap.output.facts.score import true_roi
from uavmap.photos.after_flight import draw_boundary
from uavmap.photos.ground.rasters import RasterSettings
from uavmap.runner.flight import fly
from uavmap.ui.cli import main as uavmap

STEP_M = 0.1
BY_HAND: dict[str, dict[str, Any]] = {
    "paved": brighton.PAVED,
    "color": brighton.COLOR,
    "index": brighton.INDEX,
    "adaptive": brighton.ADAPTIVE,
}


def area_of(folder: Path, grid: Grid, kind: str) -> BaseGeometry:
    """Return a feature of boundary.geojson, or the outline of map.geojson, in grid metres."""
    name = BOUNDARY_FILE if kind == "boundary" else "map.geojson"
    features = json.loads((folder / name).read_text("utf-8"))["features"]
    geometry = next(f["geometry"] for f in features if f["properties"]["kind"] == kind)
    if geometry is None:
        return Polygon()
    return shapely.transform(
        shapely.from_geojson(json.dumps(geometry)),
        lambda points: np.array([grid.fixed(LatLon(lat, lon)) for lon, lat in points]),
    )


def iou(one: BaseGeometry, other: BaseGeometry) -> float:
    """Return the intersection over union of two shapes."""
    union_m2 = shapely.union(one, other).area
    return float(shapely.intersection(one, other).area / union_m2) if union_m2 else 1.0


def errors_m(one: BaseGeometry, other: BaseGeometry) -> np.ndarray:
    """Return the distances of points of either outline to the other one, sorted, m."""
    found = []
    for line, to in ((one.boundary, other.boundary), (other.boundary, one.boundary)):
        points = shapely.segmentize(line, STEP_M)
        found.append(shapely.distance(shapely.points(shapely.get_coordinates(points)), to))
    return np.sort(np.concatenate(found))


# --- the simulator -------------------------------------------------------------------------------
def print_flights(seeds: int) -> None:
    """Fly `runway`, seed by seed; print a line each."""
    setting = setting_of(load("runway"))
    truth = true_roi(setting.mission, setting.grid)
    print("seed  cells' IoU  boundary's IoU  error: median, 95 %, most (m)  told 95 %  area / true")
    found = []
    flying = partial(fly, keep_frames=True)
    for seed in range(1, seeds + 1):
        text = first_patch(named_text("runway").text)
        with frame.flight_of("runway", text, fly=flying, seed=seed) as (_, folder):
            draw_boundary(folder, print, RasterSettings(ortho=False))
            region = area_of(folder, setting.grid, "boundary")
            cells = area_of(folder, setting.grid, "outline")
            features = json.loads((folder / BOUNDARY_FILE).read_text("utf-8"))["features"]
        told = features[0]["properties"]
        errors = np.quantile(errors_m(region, truth), (0.5, 0.95, 1.0))
        said = (told["uncertainty_95_m"], told["area_m2"] / truth.area)
        found.append((iou(cells, truth), iou(region, truth), *errors, *said))
        print(f"{seed:4}  " + "  ".join(f"{value:9.3f}" for value in found[-1]), flush=True)
    print("mean  " + "  ".join(f"{value:9.3f}" for value in np.mean(found, axis=0)))


# --- Brighton Beach ------------------------------------------------------------------------------
def brighton_beach() -> None:
    """Compare each detector's boundary with the painted region, by refined poses."""
    print("detector                    cells' IoU  boundary's IoU  precision  recall")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for kind, values in BY_HAND.items():
            section = {"name": kind, "share": 0.5, "view": "all", kind: values}
            _one_detector(kind, detector_folder(folder / kind, section))
        examples = brighton.examples(brighton.names())
        for number, painted in enumerate(PAINTED):
            model, choice = learned_from(examples, painted, examples)
            section = {"share": choice.share, "view": "all"}
            made = detector_folder(folder / f"learned-{number}", section, model)
            _one_detector(f"learned from {painted}", made)


def _one_detector(name: str, detector: Path) -> None:
    grid = setting_of(load("road")).grid
    rings = [[grid.fixed(LatLon(lat, lon)) for lon, lat in ring] for ring in brighton.rings()]
    truth = Polygon(rings[0], rings[1:])
    out = detector.with_name(f"{detector.name}-map")
    photographs = str(brighton.PHOTOGRAPHS)
    line = ["replay", photographs, "--mission", "road", "--detector", str(detector), "--no-ortho"]
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        uavmap([*line, "--out", str(out)])
    region = area_of(out, grid, "boundary")
    common_m2 = region.intersection(truth).area
    print(
        f"{name:27} {iou(area_of(out, grid, 'outline'), truth):10.3f} {iou(region, truth):15.3f} "
        f"{common_m2 / region.area:10.3f} {common_m2 / truth.area:7.3f}",
        flush=True,
    )


def main() -> None:
    """Run the requested parts."""
    options = frame.options_of(__doc__, seeds=10, brighton=False)
    if options.brighton:
        brighton_beach()
    else:
        print_flights(options.seeds)


if __name__ == "__main__":
    main()
