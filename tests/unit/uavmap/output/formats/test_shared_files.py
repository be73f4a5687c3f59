"""KMZ, STAC and geospatial PDF: their requirements, and the messages without them."""

import json
import sys
import zipfile
from dataclasses import replace

import cv2
import numpy as np
import pytest
import rasterio

from missions.errors import OutputError
from missions.units import LatLon
from tests.unit.uavmap.output.flown_folders import folder_of
from tests.unit.uavmap.output.formats.test_exports import flown_at
from tests.unit.uavmap.output.maps import make_map
from uavmap.output.documents import files_of
from uavmap.output.drawing.mosaic_file import ORTHO, Ground, finest_ground, raster_of, write_mosaic
from uavmap.output.facts.flown_mission import Calendar
from uavmap.output.formats.kmz_encoder import along_meridians
from uavmap.output.results import flown_of
from uavmap.photos.ground.rasters import COLOURS, write_cog
from uavmap.ui.cli import main
from vision.raster import Raster

RED = (200, 30, 40)


@pytest.fixture
def folder(tmp_path):
    return folder_of(tmp_path)


def painted(raster):
    """Return a mosaic with one red square in the green, and no picture at its west end."""
    image = np.zeros((raster.rows, raster.columns, 4), np.uint8)
    image[:, 20:] = (60, 120, 60, 255)
    image[40:60, 100:120] = (*RED, 255)
    return image


def lay_mosaic(folder):
    flown = flown_of(folder)
    raster = raster_of(flown.setting)
    write_mosaic(folder, painted(raster), raster, flown.data.grid)
    return flown, raster


# --- KMZ ----------------------------------------------------------------------------------------
def test_kmz_without_a_mosaic_has_the_map_alone_and_a_notice(folder, tmp_path, capsys):
    file = tmp_path / "map.kmz"
    assert main(["export", str(folder), "--to", "kmz", "--out", str(file)]) == 0
    with zipfile.ZipFile(file) as archive:
        assert archive.namelist() == ["doc.kml"]
        assert b"GroundOverlay" not in archive.read("doc.kml")
    assert "has no mosaic" in capsys.readouterr().err


def test_kmz_without_rasterio_has_the_mosaic_of_the_flight(folder, monkeypatch):
    lay_mosaic(folder)
    monkeypatch.setitem(sys.modules, "rasterio", None)
    (data,) = files_of(flown_of(folder), "kmz").values()
    (folder / "x.kmz").write_bytes(data)
    with zipfile.ZipFile(folder / "x.kmz") as archive:
        png = np.frombuffer(archive.read("files/mosaic.png"), np.uint8)
    picture = cv2.imdecode(png, cv2.IMREAD_UNCHANGED)
    assert picture.shape[2] == 4
    assert (picture[..., 3] == 0).any()
    assert (picture[..., 2] > 150).any()


@pytest.mark.parametrize("start", [LatLon(47.6, 9.53), LatLon(-17.0, 179.9994), LatLon(69.0, 20.0)])
def test_overlay_has_the_square_where_the_mosaic_has_it(start):
    data = make_map(start=start)
    raster = Raster(-40.0, 60.0, 0.5, 200, 180)
    overlay = along_meridians(Ground(raster, painted(raster)), data)
    red = (overlay.image[..., 0] > 150) & (overlay.image[..., 3] == 255)
    row, column = np.argwhere(red).mean(axis=0) + 0.5
    high, wide = red.shape
    lon = overlay.west + column / wide * (overlay.east - overlay.west)
    lat = overlay.north - row / high * (overlay.north - overlay.south)
    middle = data.grid.fixed(LatLon(lat, lon))
    assert middle.east_m == pytest.approx(raster.west_m + 110 * raster.pitch_m, abs=0.1)
    assert middle.north_m == pytest.approx(raster.north_m - 50 * raster.pitch_m, abs=0.1)
    assert overlay.east - overlay.west < 0.01


def test_large_geotiff_is_shrunk_by_a_whole_number_in_its_place(folder):
    flown, raster = lay_mosaic(folder)
    block = raster.whole, np.ascontiguousarray(painted(raster).transpose(2, 0, 1))
    write_cog(folder / ORTHO, raster, flown.data.grid, 0.0, COLOURS, [block])
    most = max(raster.columns, raster.rows) // 2
    ground = finest_ground(folder, flown.data.grid, most)
    assert ground is not None
    assert max(ground.image.shape[:2]) <= most
    times = ground.raster.pitch_m / raster.pitch_m
    assert times == pytest.approx(round(times))
    assert ground.raster.west_m == pytest.approx(raster.west_m, abs=1e-6)
    assert ground.raster.north_m == pytest.approx(raster.north_m, abs=1e-6)
    red = np.argwhere(ground.image[..., 0] > 150).mean(axis=0) + 0.5
    assert red * times == pytest.approx([50.0, 110.0], abs=times)


# --- what is missing ----------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("kind", "module"), [("stac", "pystac"), ("geopdf", "rasterio"), ("stac", "rasterio")]
)
def test_export_without_its_extra_names_the_command_that_installs_it(
    folder, monkeypatch, refused, kind, module
):
    (folder / ORTHO).write_bytes(b"")
    monkeypatch.setitem(sys.modules, module, None)
    line = refused("export", folder, "--to", kind)
    assert f"--to {kind} needs {module}" in line
    assert "pip install" in line


def test_geopdf_by_a_gdal_without_pdf_is_refused(folder, monkeypatch, refused):
    monkeypatch.setattr(rasterio.Env, "drivers", lambda self: {"GTiff": "GeoTIFF"})
    line = refused("export", folder, "--to", "geopdf")
    assert "writes no PDF" in line
    assert "pip install" in line


def test_geotiff_that_cannot_be_read_is_refused_for_a_catalogue(folder, refused):
    (folder / ORTHO).write_bytes(b"no GeoTIFF")
    line = refused("export", folder, "--to", "stac")
    assert f"{ORTHO}: cannot be read" in line


def test_stac_item_lies_in_the_folder_of_its_assets(folder, tmp_path, refused):
    line = refused("export", folder, "--to", "stac", "--out", tmp_path / "item.json")
    assert "names the files beside it" in line
    name = folder / "mine.json"
    assert main(["export", str(folder), "--to", "stac", "--out", str(name)]) == 0
    assert json.loads(name.read_text("utf-8"))["id"] == folder.name


def test_stac_item_of_a_camera_without_a_time_zone_states_it(tmp_path):
    flown = flown_at(make_map(), tmp_path)
    by_camera = Calendar(0.0, clock="camera")
    (data,) = files_of(replace(flown, calendar=by_camera), "stac").values()
    found = json.loads(data)["properties"]
    assert found["uavmap:clock"] == "camera"
    assert found["start_datetime"] == "1970-01-01T00:00:00Z"


def test_stac_item_without_any_date_is_refused(tmp_path):
    flown = flown_at(make_map(), tmp_path)
    with pytest.raises(OutputError, match="a STAC item needs one"):
        files_of(replace(flown, calendar=Calendar(None)), "stac")
