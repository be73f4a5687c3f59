"""Replays at their limits: no memory, sites far apart, an end while two things are reckoned."""

from __future__ import annotations

import json
import shutil
import threading
from pathlib import Path

import pytest

from tests.unit.uavmap.photos.sources.test_replay_robust import shot, xmp
from uavmap.photos.ground import rasters
from uavmap.photos.workers import StoppedError, beside
from uavmap.ui.cli import main
from vision.raster import Fusion


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("photos")
    for seed, place in enumerate(((10.0, 10.0), (16.0, 14.0))):
        shot(folder / f"{seed}.jpg", seed, place)
    return folder


def replayed(photos: Path, out: Path, *options: str) -> int:
    return main(["replay", str(photos), "--refine", "off", "--out", str(out), *options])


def no_memory(*_: object) -> None:
    raise MemoryError


def test_where_memory_runs_out_a_line_says_what_helps(
    photos: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(Fusion, "levels", no_memory)
    assert replayed(photos, tmp_path / "map") == 2
    *_, line = capsys.readouterr().err.splitlines()
    assert line.startswith(f"uavmap: memory ran out: {photos} is not mapped; ")
    assert "--workers 1, fewer pictures at a time, or larger cells" in line


def test_where_it_runs_out_for_the_mosaic_all_else_is_there(
    photos: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    pytest.importorskip("rasterio")
    monkeypatch.setattr(rasters, "mosaic", no_memory)
    assert replayed(photos, tmp_path / "map") == 0
    told = "memory ran out: not all GeoTIFFs are written; try a coarser --gsd, or --no-ortho; all"
    assert told in capsys.readouterr().err
    there = {path.name for path in (tmp_path / "map").iterdir()}
    assert {"map.png", "report.html", "map.gpkg", rasters.PROBABILITY} <= there
    assert rasters.ORTHO not in there


def test_two_sites_take_the_room_of_what_they_show(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rasterio = pytest.importorskip("rasterio")
    folder = tmp_path / "photos"
    folder.mkdir()
    for seed, east_m in enumerate((0.0, 6.0, 700.0, 706.0)):
        shot(folder / f"{seed}.jpg", seed, (east_m, east_m))
    assert replayed(folder, tmp_path / "map", "--no-ortho") == 0
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
    monkeypatch.setattr(rasters, "MOST_LEVELS_PX", 10_000_000)
    assert replayed(folder, tmp_path / "again", "--no-ortho") == 0
    err = capsys.readouterr().err
    assert "probability.tif: not written: it would have " in err
    assert "at most 10,000,000 are written; boundary.geojson says where the region is; most" in err
    assert "replay each site by itself" in err
    assert not (tmp_path / "again" / rasters.PROBABILITY).exists()


def test_what_is_reckoned_beside_ends_when_nobody_waits_for_it() -> None:
    began, stopped = threading.Event(), threading.Event()

    def endless(go_on: object) -> None:
        assert callable(go_on)
        began.set()
        try:
            while True:
                go_on()
        except StoppedError:
            stopped.set()
            raise

    def interrupted() -> None:
        with beside(endless):
            began.wait()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert stopped.is_set()


def test_a_name_or_a_height_that_nobody_expects_is_told_in_its_line(
    photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "photos"
    shutil.copytree(photos, folder)
    shot(folder / "a\nresults in nowhere.jpg", 7, xmp=xmp(RelativeAltitude="+0.01"))
    assert replayed(folder, tmp_path / "map", "--no-ortho") == 0
    err = capsys.readouterr().err.splitlines()
    assert "a results in nowhere.jpg: its height is 0.01 m: a map needs 0.5 m at least; not" in (
        "\n".join(err)
    )
    assert not any(line.startswith("results in nowhere") for line in err)
