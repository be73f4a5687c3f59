"""The boundary at pixel level, and the rasters: photographs of painted ground; replays at limits.

A region of 30 m by 20 m with a hole, photographed from 40 m; two of the photographs are half as
bright.
"""

from __future__ import annotations

import contextlib
import json
import math
import resource
import shutil
import sqlite3
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from PIL import Image
from shapely.geometry.base import BaseGeometry

from missions.units import LatLon
from tests.support.small_missions import square
from tests.unit.uavmap.photos.sources.test_replay_robust import xmp
from tests.unit.uavmap.photos.test_replay import GRID, GSD_M, field_text, paint, shot
from uavmap.output.facts.flown_mission import BOUNDARY_FILE
from uavmap.photos.ground import rasters
from uavmap.ui.cli import main
from vision.raster import Fusion

TRUTH = shapely.Polygon(
    [(2.0, 3.0), (32.0, 3.0), (32.0, 23.0), (2.0, 23.0)],
    [[(12.0, 9.0), (20.0, 9.0), (20.0, 16.0), (12.0, 16.0)]],
)
"""Outline of the region, metres true east and north of the start."""
PLACES = ((8.0, 8.0, 0.0), (16.0, 14.0, 90.0), (24.0, 8.0, 213.0), (14.0, 18.0, -45.0))


@pytest.fixture(scope="module")
def field(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a folder with photographs and a mission file."""
    folder = tmp_path_factory.mktemp("field")
    (folder / "photos").mkdir()
    for number, (east_m, north_m, yaw_deg) in enumerate(PLACES):
        light = 0.7 if number % 2 else 1.0
        image = paint(
            east_m, north_m, yaw_deg, int(yaw_deg) % 97, partial(shapely.contains_xy, TRUTH),
            (60.0 * light, 220.0 * light),
        )  # fmt: skip
        path = folder / "photos" / f"{number}.jpg"
        shot(path, number, (east_m, north_m), yaw_deg, image=image)
    box, fence = square(-60, -60, 150, 150), square(-70, -70, 180, 180)
    mission = field_text("count", "intensity = 100, dilations = 3", box, fence)
    (folder / "field.toml").write_text(mission, "utf-8")
    return folder


def replayed(field: Path, out: Path, *options: str) -> int:
    line = ["replay", str(field / "photos"), "--mission", str(field / "field.toml")]
    return main([*line, "--refine", "off", "--out", str(out), *options])


@pytest.fixture(scope="module")
def results(field: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("rasterio")
    out = tmp_path_factory.mktemp("results") / "map"
    assert replayed(field, out) == 0
    return out


def features(folder: Path) -> dict[str, dict[str, Any]]:
    text = (folder / BOUNDARY_FILE).read_text("utf-8")
    return {f["id"]: f for f in json.loads(text)["features"]}


def on_the_grid(geometry: dict[str, Any]) -> BaseGeometry:
    return shapely.transform(
        shapely.from_geojson(json.dumps(geometry)),
        lambda points: np.array([GRID.fixed(LatLon(lat, lon)) for lon, lat in points]),
    )


def truth() -> BaseGeometry:
    """Return the region in metres along the grid; true north is at an angle to it."""
    turn = GRID.convergence_rad
    matrix = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    return shapely.transform(TRUTH, lambda points: points @ matrix)


def test_boundary_is_that_of_the_region(results: Path) -> None:
    told = features(results)
    region, true = on_the_grid(told["boundary"]["geometry"]), truth()
    assert region.intersection(true).area / region.union(true).area > 0.98
    corners = shapely.get_coordinates(shapely.segmentize(region.boundary, 0.2))
    assert shapely.distance(shapely.points(corners), true.boundary).max() < 0.25
    values = told["boundary"]["properties"]
    assert values["parts"] == values["holes"] == 1
    assert values["area_m2"] == pytest.approx(TRUTH.area, rel=0.02)
    assert values["area_low_m2"] < values["area_m2"] < values["area_high_m2"]
    assert 0.05 <= values["uncertainty_m"] <= values["uncertainty_95_m"] < 0.3
    assert values["open_m"] == 0.0
    assert told["line 1"]["properties"]["hole"] is False
    assert told["line 2"]["properties"]["hole"] is True
    band = on_the_grid(told["band"]["geometry"])
    assert band.covers(region.boundary)
    assert json.loads((results / "summary.json").read_text())["boundary_m2"] == values["area_m2"]


def test_rings_run_as_rfc_7946_wants_them(results: Path) -> None:
    outer, hole = features(results)["boundary"]["geometry"]["coordinates"][0]
    assert shapely.LinearRing(outer).is_ccw
    assert not shapely.LinearRing(hole).is_ccw
    assert outer[0] == outer[-1]


def test_undecided_cells_are_marked_in_the_boundary(results: Path) -> None:
    told = features(results)
    cells = [
        f["properties"]
        for f in json.loads((results / "map.geojson").read_text())["features"]
        if f["properties"]["kind"] == "cell"
    ]
    once = {(c["row"], c["column"]) for c in cells if c["votes"] < 2}
    runs = told["undecided"]["properties"]["runs"]
    assert {(row, c) for row, first, last in runs for c in range(first, last + 1)} == once
    seen = {(c["row"], c["column"]) for c in cells}
    missing = told["unseen"]["properties"]["runs"]
    unseen = {(row, c) for row, first, last in missing for c in range(first, last + 1)}
    assert unseen
    assert not unseen & seen
    assert told["unseen"]["properties"]["cells"] == len(unseen)


def test_rasters_lie_where_the_boundary_lies(results: Path) -> None:
    rasterio = pytest.importorskip("rasterio")
    features_module = pytest.importorskip("rasterio.features")
    region = on_the_grid(features(results)["boundary"]["geometry"])
    origin = np.array([GRID.origin.east_m, GRID.origin.north_m])
    in_utm = shapely.transform(region, lambda points: origin + points * GRID.scale)
    with rasterio.open(results / rasters.ORTHO) as file:
        assert file.crs.to_epsg() == GRID.zone.epsg
        assert file.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
        assert file.overviews(1)
        assert file.transform.a == pytest.approx(round(GSD_M, 2))
        dark = (file.read(2) < 110) & (file.dataset_mask() > 0)
        there = features_module.geometry_mask([in_utm], dark.shape, file.transform, invert=True)
    assert (dark & there).sum() / (dark | there).sum() > 0.97
    shift = np.argwhere(dark).mean(axis=0) - np.argwhere(there).mean(axis=0)
    assert np.abs(shift).max() * GSD_M < 0.1
    with rasterio.open(results / rasters.PROBABILITY) as file:
        assert file.crs.to_epsg() == GRID.zone.epsg
        assert file.nodata == rasters.NOWHERE
        likely = file.read(1)
        there = features_module.geometry_mask([in_utm], likely.shape, file.transform, invert=True)
    assert likely.max() == pytest.approx(1.0)
    assert ((likely >= 0.5) & there).sum() / ((likely >= 0.5) | there).sum() > 0.99


def test_map_shows_the_ground(results: Path, field: Path, tmp_path: Path) -> None:
    image = np.asarray(Image.open(results / "map.png").convert("RGB")).astype(int)
    bare = np.abs(image - image.mean(axis=2, keepdims=True)).max(axis=2) < 3
    assert len(np.unique(image[bare])) > 60  # the noise of the photographs


def test_replay_leaves_a_report_and_a_geopackage_with_its_boundary(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    package, page = results / "map.gpkg", results / "report.html"
    told = features(results)["boundary"]["properties"]
    summary = json.loads((results / "summary.json").read_text("utf-8"))
    assert summary["begun_utc"] is None  # a camera's clock has no zone
    text = page.read_text("utf-8")
    assert "2024-05-01 10:00:00 by the camera&#39;s clock" in text
    assert f"{told['area_m2']:,.0f} m²" in text
    assert "boundary by pixels" in text
    assert "First picture" in text
    with contextlib.closing(sqlite3.connect(package)) as database:
        (area_m2,) = database.execute("SELECT area_m2 FROM boundary").fetchone()
        (frames,) = database.execute("SELECT count(*) FROM frames").fetchone()
        (places,) = database.execute("SELECT count(*) FROM tracks").fetchone()
    assert (area_m2, frames, places) == (told["area_m2"], summary["photographs_judged"], 1)
    before = package.read_bytes()
    assert main(["export", str(results), "--to", "gpkg"]) == 0
    assert package.read_bytes() == before
    assert main(["report", str(results)]) == 0
    assert page.read_text("utf-8") == text
    (results / "summary.json").write_text('{"completed": "<b>", "finding": "<script>"}')
    assert main(["report", str(results)]) == 0
    assert "&lt;script&gt;" in page.read_text("utf-8")


def test_replay_without_rasterio_writes_no_raster(
    field: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "rasterio", None)
    assert replayed(field, tmp_path / "map") == 0
    assert "probability.tif and ortho.tif: not written without rasterio" in (
        capsys.readouterr().err
    )
    assert (tmp_path / "map" / BOUNDARY_FILE).exists()
    assert not list((tmp_path / "map").glob("*.tif"))
    assert replayed(field, tmp_path / "none", "--ortho") == 2
    assert "'rasterio>=" in capsys.readouterr().err
    assert not (tmp_path / "none").exists()


def test_ctrl_c_in_the_mosaic_keeps_all_other_results(
    field: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("rasterio")

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(rasters, "mosaic", interrupted)
    assert replayed(field, tmp_path / "map") == 130
    err = capsys.readouterr().err
    assert "results written in " in err
    assert "interrupted: ortho.tif is not written; all other results" in err
    there = [path.name for path in (tmp_path / "map").iterdir()]
    others = {"journal.jsonl", "map.geojson", "map.kml", "map.png", "summary.json", "pictures.csv"}
    others |= {"map.gpkg", "report.html", "report.pdf", "judged.jpg"}
    others |= {"mosaic.webp", "mosaic.webp.aux.xml"}
    assert set(there) == {*others, BOUNDARY_FILE, rasters.PROBABILITY}


@pytest.fixture
def small_files() -> Iterator[None]:
    """Have the disk refuse files larger than the other results."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (600_000, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.usefixtures("small_files")
def test_full_disk_keeps_all_other_results(
    field: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("rasterio")
    assert replayed(field, tmp_path / "map", "--gsd", "0.03") == 0
    err = capfd.readouterr().err
    assert "ortho.tif is not written" in err
    assert "all other results are complete" in err
    assert "Traceback" not in err
    assert not (tmp_path / "map" / rasters.ORTHO).exists()
    assert (tmp_path / "map" / BOUNDARY_FILE).exists()
    assert not [path for path in (tmp_path / "map").iterdir() if path.name.startswith(".")]


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("photos")
    for seed, place in enumerate(((10.0, 10.0), (16.0, 14.0))):
        shot(folder / f"{seed}.jpg", seed, place)
    return folder


def replayed_as_derived(photos: Path, out: Path, *options: str) -> int:
    return main(["replay", str(photos), "--refine", "off", "--out", str(out), *options])


def no_memory(*_: object) -> None:
    raise MemoryError


def test_replay_out_of_memory_names_a_remedy(
    photos: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(Fusion, "levels", no_memory)
    assert replayed_as_derived(photos, tmp_path / "map") == 2
    *_, line = capsys.readouterr().err.splitlines()
    assert line.startswith(f"uavmap: memory ran out: {photos} is not mapped; ")
    assert "--workers 1, fewer pictures at a time, or larger cells" in line


def test_mosaic_out_of_memory_keeps_all_other_results(
    photos: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    pytest.importorskip("rasterio")
    monkeypatch.setattr(rasters, "mosaic", no_memory)
    assert replayed_as_derived(photos, tmp_path / "map") == 0
    told = "memory ran out: not all GeoTIFFs are written; try a coarser --gsd, or --no-ortho; all"
    assert told in capsys.readouterr().err
    there = {path.name for path in (tmp_path / "map").iterdir()}
    assert {"map.png", "report.html", "map.gpkg", rasters.PROBABILITY} <= there
    assert rasters.ORTHO not in there


def test_rasters_of_two_sites_take_the_room_of_both(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rasterio = pytest.importorskip("rasterio")
    folder = tmp_path / "photos"
    folder.mkdir()
    for seed, east_m in enumerate((0.0, 6.0, 700.0, 706.0)):
        shot(folder / f"{seed}.jpg", seed, (east_m, east_m))
    assert replayed_as_derived(folder, tmp_path / "map", "--no-ortho") == 0
    assert not (tmp_path / "map" / rasters.ORTHO).exists()
    path = tmp_path / "map" / rasters.PROBABILITY
    with rasterio.open(path) as file:
        assert min(file.shape) > 6_000  # at 0.11 m
        assert file.dtypes == ("float32",)
        assert (file.read(1, window=((2500, 3500), (2500, 3500))) == file.nodata).all()
    assert path.stat().st_size < 1_000_000  # of 150 million bytes
    told = json.loads((tmp_path / "map" / "boundary.geojson").read_text("utf-8"))
    assert told["features"][0]["properties"]["area_m2"] > 0.0
    capsys.readouterr()
    monkeypatch.setattr(rasters, "MAX_LEVELS_PX", 10_000_000)
    assert replayed_as_derived(folder, tmp_path / "again", "--no-ortho") == 0
    err = capsys.readouterr().err
    assert "probability.tif: not written: it would have " in err
    assert "at most 10,000,000 are written; boundary.geojson has the region; most" in err
    assert "replay each site by itself" in err
    assert not (tmp_path / "again" / rasters.PROBABILITY).exists()


def test_unexpected_name_or_height_is_reported_in_its_line(
    photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "photos"
    shutil.copytree(photos, folder)
    shot(folder / "a\nresults in nowhere.jpg", 7, xmp=xmp(RelativeAltitude="+0.01"))
    assert replayed_as_derived(folder, tmp_path / "map", "--no-ortho") == 0
    err = capsys.readouterr().err.splitlines()
    assert "a results in nowhere.jpg: its height is 0.01 m: a map needs 0.5 m at least; not" in (
        "\n".join(err)
    )
    assert not any(line.startswith("results in nowhere") for line in err)
