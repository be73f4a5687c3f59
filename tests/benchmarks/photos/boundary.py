"""How good the boundary at pixel level is; prints a table.

    python -m tests.benchmarks.photos.boundary                  `runway` in the simulator, ten seeds
    python -m tests.benchmarks.photos.boundary --seeds 3
    python -m tests.benchmarks.photos.boundary --brighton       the photographs of Brighton Beach
    python -m tests.benchmarks.photos.boundary --cost FOLDER    seconds of a replay, part by part

In the simulator the camera tilts with the airframe, the wind blows, positions are off by 0.3 m and
the light changes. The error of the boundary is the distance of each of its points (every 0.1 m) to
the true outline, and of each point of the true outline to the boundary.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import tempfile
import time
from pathlib import Path

import numpy as np
import shapely
import tomlkit
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from missions.flight.setting import Setting
from missions.geo.grid import Grid
from missions.units import LatLon
from tests.benchmarks.photos import brighton
from tests.benchmarks.photos.detectors import PAINTED
from tests.support.plans import named_text, plan_of
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import JOURNAL, SIM_EPOCH_UTC_S
from uavmap.load.mission_source import load
from uavmap.output.facts.boundary_model import FILE
from uavmap.output.facts.score import true_roi
from uavmap.photos.after_flight import draw_boundary
from uavmap.photos.ground.rasters import Wishes
from uavmap.photos.picture_replay import look_at_all
from uavmap.photos.replay_job import journal_meta
from uavmap.photos.scratch_file import Spool
from uavmap.photos.sources.inventory import gather, open_source
from uavmap.photos.tune.tune_job import DETECTOR, MODEL, learned
from uavmap.photos.tune.tune_job import Wishes as TuneWishes
from uavmap.runner.flight import fly
from uavmap.ui.cli import main as uavmap
from vision.detectors.learned_model import model_bytes

STEP_M = 0.1
BY_HAND: dict[str, dict[str, object]] = {
    "paved": {"greenness": 0.04, "intensity": 90, "dilations": 1},
    "color": {
        "samples": [[165, 160, 165], [125, 125, 140], [90, 95, 120]],
        "not_samples": [[110, 140, 70], [60, 80, 40], [40, 60, 35]],
    },
    "index": {"kind": "exg", "value": 0.05, "side": "below"},
    "adaptive": {"polarity": "bright", "offset": 10},
}


def mapped(folder: Path, grid: Grid, kind: str) -> BaseGeometry:
    """A feature of boundary.geojson, or the outline of map.geojson, in metres of the grid."""
    name = FILE if kind == "boundary" else "map.geojson"
    features = json.loads((folder / name).read_text("utf-8"))["features"]
    geometry = next(f["geometry"] for f in features if f["properties"]["kind"] == kind)
    if geometry is None:
        return Polygon()
    return shapely.transform(
        shapely.from_geojson(json.dumps(geometry)),
        lambda points: np.array([grid.fixed(LatLon(lat, lon)) for lon, lat in points]),
    )


def iou(one: BaseGeometry, other: BaseGeometry) -> float:
    """Of two shapes."""
    union_m2 = shapely.union(one, other).area
    return float(shapely.intersection(one, other).area / union_m2) if union_m2 else 1.0


def errors_m(one: BaseGeometry, other: BaseGeometry) -> np.ndarray:
    """How far each point of either outline is from the other one, sorted."""
    found = []
    for line, to in ((one.boundary, other.boundary), (other.boundary, one.boundary)):
        points = shapely.segmentize(line, STEP_M)
        found.append(shapely.distance(shapely.points(shapely.get_coordinates(points)), to))
    return np.sort(np.concatenate(found))


# --- the simulator -------------------------------------------------------------------------------
def flown(seeds: int) -> None:
    """`runway`, seed by seed."""
    source = named_text("runway")
    setting = Setting.of(load("runway"))
    truth = true_roi(setting.mission, setting.grid)
    print("seed  cells' IoU  boundary's IoU  error: median, 95 %, most (m)  told 95 %  area / true")
    found = []
    for seed in range(1, seeds + 1):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            plan = plan_of(
                source.source, source.text, strategy=None, vehicles=None, seed=seed, urls=(),
                speedup=None, epoch_utc_s=SIM_EPOCH_UTC_S,
            )  # fmt: skip
            fly(plan, folder, keep_frames=True)
            draw_boundary(folder, print, Wishes(ortho=False))
            region = mapped(folder, setting.grid, "boundary")
            off_m = errors_m(region, truth)
            features = json.loads((folder / FILE).read_text("utf-8"))["features"]
            told = features[0]["properties"]
            row = (
                iou(mapped(folder, setting.grid, "outline"), truth),
                iou(region, truth),
                *(float(np.quantile(off_m, share)) for share in (0.5, 0.95, 1.0)),
                told["uncertainty_95_m"],
                told["area_m2"] / truth.area,
            )
        found.append(row)
        print(f"{seed:4}  " + "  ".join(f"{value:9.3f}" for value in row), flush=True)
    print("mean  " + "  ".join(f"{value:9.3f}" for value in np.mean(found, axis=0)))


# --- Brighton Beach ------------------------------------------------------------------------------
def brighton_beach() -> None:
    """Each detector's boundary against the painted region, by refined poses."""
    print("detector                    cells' IoU  boundary's IoU  precision  recall")
    with tempfile.TemporaryDirectory() as name:
        for kind, values in BY_HAND.items():
            section = {"name": kind, "share": 0.5, "view": "all", kind: values}
            _one_detector(kind, _detector(Path(name) / kind, section))
        examples = brighton.examples(brighton.names())
        for number, painted in enumerate(PAINTED):
            folder = Path(name) / f"learned-{number}"
            model, choice, _ = learned(
                [examples[i] for i in painted], [e.picture for e in examples], TuneWishes(),
                lambda _: None,
            )  # fmt: skip
            section = {"name": "learned", "model": MODEL, "share": choice.share, "view": "all"}
            _detector(folder, section)
            (folder / MODEL).write_bytes(model_bytes(model))
            _one_detector(f"learned from {painted}", folder)


def _detector(folder: Path, section: dict[str, object]) -> Path:
    folder.mkdir()
    (folder / DETECTOR).write_text(tomlkit.dumps({"detector": section}), "utf-8")
    return folder


def _one_detector(name: str, detector: Path) -> None:
    grid = Setting.of(load("road")).grid
    rings = [[grid.fixed(LatLon(lat, lon)) for lon, lat in ring] for ring in brighton.rings()]
    truth = Polygon(rings[0], rings[1:])
    out = detector.with_name(f"{detector.name}-map")
    photographs = str(brighton.PHOTOGRAPHS)
    line = ["replay", photographs, "--mission", "road", "--detector", str(detector), "--no-ortho"]
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        uavmap([*line, "--out", str(out)])
    region = mapped(out, grid, "boundary")
    common_m2 = region.intersection(truth).area
    print(
        f"{name:27} {iou(mapped(out, grid, 'outline'), truth):10.3f} {iou(region, truth):15.3f} "
        f"{common_m2 / region.area:10.3f} {common_m2 / truth.area:7.3f}",
        flush=True,
    )


# --- cost ----------------------------------------------------------------------------------------
def cost(path: Path) -> None:
    """CPU seconds of the parts of a replay, poses as tagged; the least of three."""
    setting = Setting.of(load("road"))
    gathered = gather(open_source(path))
    found: dict[str, list[float]] = {"verdicts": [], "results": [], "GeoTIFFs": []}
    for _ in range(3):
        with tempfile.TemporaryDirectory() as name, Spool() as spool:
            folder = Path(name)
            began_s = time.process_time()
            looked = look_at_all(gathered, setting, spool)
            seen_s = time.process_time()
            meta = journal_meta(setting.mission, "road", str(path)) | looked.taken()
            with Journal.create(folder / JOURNAL, meta) as journal:
                looked.written(journal, folder)
            written_s = time.process_time()
            looked.write_rasters(folder, Wishes())
            found["verdicts"].append(seen_s - began_s)
            found["results"].append(written_s - seen_s)
            found["GeoTIFFs"].append(time.process_time() - written_s)
    for part, seconds in found.items():
        print(f"{part:10} {min(seconds):6.2f} s CPU")


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--brighton", action="store_true")
    parser.add_argument("--cost", type=Path)
    options = parser.parse_args()
    if options.cost:
        cost(options.cost)
    elif options.brighton:
        brighton_beach()
    else:
        flown(options.seeds)


if __name__ == "__main__":
    main()
