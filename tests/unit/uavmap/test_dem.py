"""A GeoTIFF becomes the lattice of a mission; what cannot be ground is refused with its place."""

from __future__ import annotations

import math
import sys

import numpy as np
import pytest
from pyproj import Transformer

from missions.errors import MissionFileError
from missions.ground.grid import Grid
from missions.state import Setting
from missions.units import GridPoint, Pose, Quaternion
from tests.small_missions import START, mission_text, square
from tests.unit.uavmap.photographs import write_photo
from uavmap.cli import main
from uavmap.mission_source import load_source
from uavmap.offline.above_ground import above_ground

rasterio = pytest.importorskip("rasterio")

GRID = Grid.at(START, 4.0)
BASE_M = 512.0
"""Of the sea's level: what counts is the difference to the start."""


def ground_m(east_m, north_m):
    return 0.08 * east_m + 4.0 * np.sin(north_m / 30.0)


def geotiff(path, *, epsg=32632, heights=None, nodata=None, pixel=3.0, south_m=-120.0):
    """A model around the start in any system; heights of `ground_m`, at the middles of pixels."""
    system = rasterio.crs.CRS.from_epsg(epsg) if epsg else None
    to_utm = Transformer.from_crs(epsg or 32632, GRID.zone.epsg, always_xy=True)
    here = Transformer.from_crs(4326, epsg or 32632, always_xy=True)
    x0, y0 = here.transform(START.lon_deg, START.lat_deg)
    metre_x, metre_y = (1.0, 1.0)
    if epsg == 4326:
        metre_y = 1.0 / 111_200.0
        metre_x = metre_y / math.cos(math.radians(START.lat_deg))
    count = round(-2 * south_m / pixel)
    west, north = x0 + south_m * metre_x, y0 - south_m * metre_y
    columns, rows = np.meshgrid(np.arange(count) + 0.5, np.arange(count) + 0.5)
    x, y = west + columns * pixel * metre_x, north - rows * pixel * metre_y
    utm_x, utm_y = to_utm.transform(x, y)
    east_m = (utm_x - GRID.origin.east_m) / GRID.scale
    north_m = (utm_y - GRID.origin.north_m) / GRID.scale
    band = (BASE_M + ground_m(east_m, north_m)).astype(np.float32)
    if heights is not None:
        heights(band)
    transform = rasterio.Affine(pixel * metre_x, 0.0, west, 0.0, -pixel * metre_y, north)
    with rasterio.open(
        path, "w", driver="GTiff", width=count, height=count, count=1, dtype="float32",
        crs=system, transform=transform, nodata=nodata,
    ) as file:  # fmt: skip
        file.write(band, 1)


def mission_file(folder, above="ground"):
    text = mission_text(square(-4, 10, 24, 16), square(-40, -40, 100, 110), altitude_m=14.0)
    text = text.replace("[flight]", f'[flight]\nheight_above = "{above}"')
    path = folder / "field.toml"
    path.write_text(text + '\n[terrain]\ndem = "dem.tif"  # of 2024\n', "utf-8")
    return path


def refused(folder):
    with pytest.raises(MissionFileError) as error:
        load_source(str(mission_file(folder))).parse()
    return str(error.value)


@pytest.mark.parametrize("epsg", [32632, 4326, 3035])
def test_any_coordinate_system_gives_the_same_ground(tmp_path, epsg):
    geotiff(tmp_path / "dem.tif", epsg=epsg)
    source = load_source(str(mission_file(tmp_path)))
    (tmp_path / "dem.tif").unlink()  # what a journal keeps needs no file
    ground = source.parse().ground
    assert ground.step_m == pytest.approx(3.0, abs=0.11)
    for east_m, north_m in ((0.0, 0.0), (33.0, -17.0), (-38.0, 65.0), (55.0, 60.0)):
        told_m = ground.height_m(GridPoint(east_m, north_m))
        assert told_m == pytest.approx(ground_m(east_m, north_m), abs=0.1), (epsg, east_m, north_m)


def test_check_tells_of_the_ground(tmp_path, capsys):
    geotiff(tmp_path / "dem.tif")
    assert main(["check", str(mission_file(tmp_path))]) == 0
    told = capsys.readouterr().out
    assert "ground in the fence: -7." in told
    assert "slopes up to 15" in told
    assert "flown above the ground: up to" in told
    assert main(["check", str(mission_file(tmp_path, above="home")), "--json"]) == 0
    assert '"followed": false' in capsys.readouterr().out


def _gap(band):
    band[30:34, 40:44] = -9999.0


def _spike(band):
    band[40, 40] += 60.0


def _zero(band):
    band[38:42, 38:42] = 0.0


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"heights": _gap, "nodata": -9999.0}, "% of fence.polygon, for example at 48.000"),
        ({"heights": _gap}, "no ground of this Earth"),
        ({"heights": _spike}, "no ground rises so"),
        ({"heights": _zero}, "no ground rises so"),
        ({"south_m": -45.0}, "it has no height in"),
        ({"epsg": None}, "does not say its coordinate system"),
        ({"pixel": 120.0, "south_m": -480.0}, "more than 100; take a finer model"),
    ],
)
def test_what_is_no_ground_is_refused_with_file_and_place(tmp_path, how, words):
    geotiff(tmp_path / "dem.tif", **how)
    said = refused(tmp_path)
    assert "terrain.dem = 'dem.tif'" in said
    assert words in said


def test_files_that_are_no_geotiff_are_refused_in_a_line(tmp_path, capsys, monkeypatch):
    assert "there is no such file" in refused(tmp_path)
    (tmp_path / "dem.tif").write_bytes(b"II*\x00 not really")
    assert "cannot be read as a GeoTIFF" in refused(tmp_path)
    monkeypatch.setitem(sys.modules, "rasterio", None)
    assert "install uavmap[geo]" in refused(tmp_path)
    assert main(["check", str(tmp_path / "field.toml")]) == 2
    assert "Traceback" not in capsys.readouterr().err


def test_photographs_are_read_from_their_height_above_the_ground_below(tmp_path):
    geotiff(tmp_path / "dem.tif")
    setting = Setting.of(load_source(str(mission_file(tmp_path))).parse())
    place = GridPoint(30.0, 40.0)
    taken = Pose(GRID.position(place), 50.0, Quaternion.from_euler(0.0, -math.pi / 2, 0.0))
    told = above_ground(taken, setting)
    assert told.height_m == pytest.approx(50.0 - ground_m(30.0, 40.0), abs=0.1)
    level = Setting.of(load_source(str(mission_file(tmp_path, above="home"))).parse())
    assert above_ground(taken, level) is taken


def test_photographs_over_a_terrain_keep_their_tags(tmp_path, capsys):
    """Registration takes the ground for a plane, which a terrain is not."""
    geotiff(tmp_path / "dem.tif")
    (tmp_path / "photos").mkdir()
    place = {1: "N", 2: (START.lat_deg, 0.0, 0.0), 3: "E", 4: (START.lon_deg, 0.0, 0.0)}
    write_photo(tmp_path / "photos" / "a.jpg", gps=place)
    out = tmp_path / "map"
    mission = mission_file(tmp_path)
    main(["replay", str(tmp_path / "photos"), "--mission", str(mission), "--out", str(out)])
    assert "over a terrain poses are as tagged" in capsys.readouterr().err
    assert not (out / "registration.json").exists()


def test_plans_for_ground_stations_are_refused(tmp_path, capsys):
    geotiff(tmp_path / "dem.tif")
    plan = tmp_path / "x.plan"
    assert main(["export", str(mission_file(tmp_path)), "--plan", str(plan)]) == 2
    assert "heights of a plan are above home" in capsys.readouterr().err
    assert not plan.exists()
