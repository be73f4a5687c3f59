"""A GeoTIFF becomes the lattice of a mission; impossible ground is refused with its place."""

import math
import sys

import numpy as np
import pytest
from pyproj import Transformer

from missions.errors import MissionFileError
from missions.flight.setting_of import setting_of
from missions.geo.grid import Grid
from missions.units import GridPoint, Pose, Quaternion
from tests.support.photographs import write_photo
from tests.support.small_missions import START, mission_text, square
from uavmap.load import dem
from uavmap.load.mission_source import load
from uavmap.photos.sources.picture_record import above_ground
from uavmap.ui.cli import main

rasterio = pytest.importorskip("rasterio")

GRID = Grid.at(START, 4.0)
BASE_M = 512.0
"""Height of the start above the sea, m: only differences from it count."""


def ground_m(east_m, north_m):
    return 0.08 * east_m + 4.0 * np.sin(north_m / 30.0)


def geotiff(path, *, epsg=32632, heights=None, nodata=None, pixel=3.0, south_m=-120.0):
    """Write a model around the start in any system; pixels have the heights of `ground_m`."""
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
    write(path, band, system, transform=transform, nodata=nodata)


def write(path, band, crs, count=1, **how):
    """Write a model of this band, at any place unless a transform is given."""
    how = {"crs": crs, "transform": rasterio.Affine(3.0, 0.0, 0.0, 0.0, -3.0, 0.0), **how}
    height, width = band.shape
    with rasterio.open(
        path, "w", driver="GTiff", width=width, height=height, count=count, dtype="float32", **how
    ) as file:
        for index in range(count):
            file.write(band, index + 1)


def mission_file(folder, above="ground"):
    text = mission_text(square(-4, 10, 24, 16), square(-40, -40, 100, 110), altitude_m=14.0)
    text = text.replace("[flight]", f'[flight]\nheight_above = "{above}"')
    path = folder / "field.toml"
    path.write_text(text + '\n[terrain]\ndem = "dem.tif"  # of 2024\n', "utf-8")
    return path


def refused(folder):
    with pytest.raises(MissionFileError) as error:
        load(str(mission_file(folder)))
    return str(error.value)


@pytest.mark.parametrize("epsg", [32632, 4326, 3035])
def test_any_coordinate_system_gives_the_same_ground(tmp_path, epsg):
    geotiff(tmp_path / "dem.tif", epsg=epsg)
    mission = load(str(mission_file(tmp_path)))
    (tmp_path / "dem.tif").unlink()  # a mission in a journal needs no file
    ground = mission.ground
    assert ground.step_m == pytest.approx(3.0, abs=0.11)
    for east_m, north_m in ((0.0, 0.0), (33.0, -17.0), (-38.0, 65.0), (55.0, 60.0)):
        told_m = ground.height_m(GridPoint(east_m, north_m))
        assert told_m == pytest.approx(ground_m(east_m, north_m), abs=0.1), (epsg, east_m, north_m)


def test_check_reports_heights_and_slopes_of_the_ground(tmp_path, capsys):
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
        ({"heights": _gap}, "not possible on Earth"),
        ({"heights": _spike}, "an implausible slope"),
        ({"heights": _zero}, "an implausible slope"),
        ({"south_m": -45.0}, "it has no height in"),
        ({"epsg": None}, "names no coordinate system"),
        ({"pixel": 120.0, "south_m": -480.0}, "more than 100 m; use a finer model"),
    ],
)
def test_invalid_ground_is_refused_with_file_and_place(tmp_path, how, words):
    geotiff(tmp_path / "dem.tif", **how)
    said = refused(tmp_path)
    assert "terrain.dem = 'dem.tif'" in said
    assert words in said


@pytest.mark.parametrize("how", ["band", "vertical"])
def test_heights_in_feet_become_metres(tmp_path, how):
    def in_feet(band):
        band /= 0.3048

    geotiff(tmp_path / "dem.tif", heights=in_feet)
    with rasterio.open(tmp_path / "dem.tif", "r+") as file:
        if how == "band":
            file.units = ("ft",)
        else:  # NAVD88 in feet of the US survey
            file.crs = rasterio.crs.CRS.from_user_input("EPSG:32632+6360")
    ground = load(str(mission_file(tmp_path))).ground
    for place in (GridPoint(33.0, -17.0), GridPoint(-38.0, 65.0)):
        assert ground.height_m(place) == pytest.approx(ground_m(*place), abs=0.1)
    with rasterio.open(tmp_path / "dem.tif", "r+") as file:
        file.units = ("fathom",)
    assert "its heights are in 'fathom'" in refused(tmp_path)


def test_invalid_or_distant_model_is_refused(tmp_path):
    level = np.full((9, 9), 500.0, np.float32)
    write(tmp_path / "dem.tif", level, rasterio.crs.CRS.from_epsg(32632), count=3)
    assert "it has 3 bands" in refused(tmp_path)
    site = rasterio.crs.CRS.from_wkt('LOCAL_CS["site",UNIT["metre",1]]')
    write(tmp_path / "dem.tif", level, site)
    assert "its coordinate system, 'site', has no place on Earth" in refused(tmp_path)
    other_side = rasterio.crs.CRS.from_proj4("+proj=ortho +lat_0=-48 +lon_0=-169")
    write(tmp_path / "dem.tif", level, other_side)
    assert "no height at start.position" in refused(tmp_path)


def test_fine_model_is_read_as_means_and_no_more_than_needed(tmp_path, monkeypatch):
    def stones(band):
        band[::2] += 0.6
        band[1::2] -= 0.6

    geotiff(tmp_path / "dem.tif", heights=stones, pixel=0.25)
    shapes = []
    means = dem._means
    monkeypatch.setattr(
        dem,
        "_means",
        lambda *asked: shapes.append(means(*asked).shape) or means(*asked),
    )
    ground = load(str(mission_file(tmp_path))).ground
    assert ground.step_m == pytest.approx(2.0, abs=0.11)
    assert all(rows * columns <= 1.3 * ground.heights_m.size for rows, columns in shapes), shapes
    for place in (GridPoint(33.0, -17.0), GridPoint(-38.0, 65.0)):
        assert ground.height_m(place) == pytest.approx(ground_m(*place), abs=0.15)


def test_gaps_outside_of_the_fence_are_no_cliffs(tmp_path):
    def hill_and_gap(band):
        rows, columns = np.mgrid[: band.shape[0], : band.shape[1]]
        band += 0.7 * np.abs(columns - rows)
        band[(rows < 13) & (columns < 60)] = -9999.0

    geotiff(tmp_path / "dem.tif", heights=hill_and_gap, nodata=-9999.0)
    assert load(str(mission_file(tmp_path))).surveyed is not None


def test_impossible_fence_is_refused_over_ground_as_well(tmp_path, capsys):
    geotiff(tmp_path / "dem.tif")
    path = mission_file(tmp_path)
    text = path.read_text("utf-8")
    begin = text.index("polygon = [[", text.index("[fence]")) + len("polygon = [[")
    far = text[:begin] + "0.0, 101.0" + text[text.index("]", begin) :]
    path.write_text(far, "utf-8")
    assert main(["check", str(path)]) == 2
    assert "fence.polygon = [0, 101]" in capsys.readouterr().err


def test_files_that_are_no_geotiff_are_refused_in_a_line(tmp_path, capsys, monkeypatch):
    assert "there is no such file" in refused(tmp_path)
    (tmp_path / "dem.tif").write_bytes(b"II*\x00 not really")
    assert "cannot be read as a GeoTIFF" in refused(tmp_path)
    monkeypatch.setitem(sys.modules, "rasterio", None)
    assert "'rasterio>=" in refused(tmp_path)
    assert main(["check", str(tmp_path / "field.toml")]) == 2
    assert "Traceback" not in capsys.readouterr().err


def test_photographs_are_read_from_their_height_above_the_ground_below(tmp_path):
    geotiff(tmp_path / "dem.tif")
    setting = setting_of(load(str(mission_file(tmp_path))))
    place = GridPoint(30.0, 40.0)
    taken = Pose(GRID.position(place), 50.0, Quaternion.from_euler(0.0, -math.pi / 2, 0.0))
    told = above_ground(taken, setting)
    assert told.height_m == pytest.approx(50.0 - ground_m(30.0, 40.0), abs=0.1)
    level = setting_of(load(str(mission_file(tmp_path, above="home"))))
    assert above_ground(taken, level) is taken


def test_photographs_over_a_terrain_are_registered_on_it(tmp_path, capsys):
    geotiff(tmp_path / "dem.tif")
    (tmp_path / "photos").mkdir()
    place = {1: "N", 2: (START.lat_deg, 0.0, 0.0), 3: "E", 4: (START.lon_deg, 0.0, 0.0)}
    write_photo(tmp_path / "photos" / "a.jpg", gps=place)
    out = tmp_path / "map"
    mission = mission_file(tmp_path)
    main(["replay", str(tmp_path / "photos"), "--mission", str(mission), "--out", str(out)])
    assert "registration: none of 1 pictures could be refined" in capsys.readouterr().err


def test_plans_for_ground_stations_are_refused(tmp_path, capsys):
    geotiff(tmp_path / "dem.tif")
    plan = tmp_path / "x.plan"
    assert main(["export", str(mission_file(tmp_path)), "--plan", str(plan)]) == 2
    assert "heights in a plan are above home" in capsys.readouterr().err
    assert not plan.exists()
