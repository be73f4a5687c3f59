"""Files of a flown map for catalogues, phones and print: read by programs of others."""

import json
import re
import shutil
import zipfile
from datetime import datetime
from pathlib import Path

import cv2
import fastkml
import lxml.etree
import numpy as np
import pyogrio
import pyproj
import pystac
import pytest
import rasterio
import shapely
from fastkml.utils import find_all
from pystac.validation.stac_validator import JsonSchemaSTACValidator
from rasterio.warp import Resampling, reproject, transform_bounds

from tests.support.wpml_schema import faults_of
from uavmap.output.results import flown_of
from uavmap.ui.cli import main

DATA = Path(__file__).parents[2] / "data"
PROJECTION = "https://stac-extensions.github.io/projection/v2.0.0/schema.json"
DPI = 150.0


def export_results(results, kind, out):
    assert main(["export", str(results), "--to", kind, "--out", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def results(tiny, tmp_path_factory):
    """Copy the results of a flight to a place where they may be changed."""
    return shutil.copytree(tiny.folder, tmp_path_factory.mktemp("export") / "tiny-1")


# --- KMZ ----------------------------------------------------------------------------------------
def test_kmz_lays_the_mosaic_where_the_geotiff_lies(results, tmp_path):
    file = export_results(results, "kmz", tmp_path / "map.kmz")
    with rasterio.open(results / "ortho.tif") as cog:
        edges = transform_bounds(cog.crs, "EPSG:4326", *cog.bounds)
        colours, there = cog.read((1, 2, 3)), cog.dataset_mask()
        system, transform = cog.crs, cog.transform
    with zipfile.ZipFile(file) as archive:
        assert archive.namelist() == ["doc.kml", "files/mosaic.png"]
        document = archive.read("doc.kml")
        picture = cv2.imdecode(
            np.frombuffer(archive.read("files/mosaic.png"), np.uint8), cv2.IMREAD_UNCHANGED
        )
    # by fastkml
    (overlay,) = find_all(fastkml.KML.from_string(document), of_type=fastkml.GroundOverlay)
    box = overlay.lat_lon_box
    assert overlay.icon.href == "files/mosaic.png"
    assert (box.west, box.south, box.east, box.north) == pytest.approx(edges, abs=1e-7)
    # by GDAL's LIBKML
    name = pyogrio.list_layers(file)[0, 0]
    bounds = pyogrio.raw.read(file, layer=name)[2]
    assert shapely.from_wkb(bounds[0]).bounds == pytest.approx(edges, abs=1e-7)
    # the picture is that of the GeoTIFF, as GDAL projects it
    high, wide = picture.shape[:2]
    west, south, east, north = edges
    step = (east - west) / wide, (south - north) / high
    target = {
        "src_transform": transform,
        "src_crs": system,
        "dst_crs": "EPSG:4326",
        "dst_transform": rasterio.Affine(step[0], 0.0, west, 0.0, step[1], north),
        "resampling": Resampling.bilinear,
    }
    shown, seen = np.zeros((3, high, wide), np.uint8), np.zeros((high, wide), np.uint8)
    reproject(colours, shown, **target)
    reproject(there, seen, **target)
    opaque = (picture[..., 3] == 255) & (seen == 255)
    assert opaque.sum() > 0.97 * max((picture[..., 3] == 255).sum(), (seen == 255).sum())
    off = np.abs(picture[..., 2::-1].astype(int) - shown.transpose(1, 2, 0))[opaque]
    assert off.mean() < 1.5


def test_kmz_is_valid_and_has_the_layers_of_the_kml(results, tmp_path):
    file = export_results(results, "kmz", tmp_path / "map.kmz")
    schema = Path(fastkml.__file__).parent / "schema" / "kml22gx.xsd"
    with zipfile.ZipFile(file) as archive:
        root = lxml.etree.fromstring(archive.read("doc.kml"))
    lxml.etree.XMLSchema(lxml.etree.parse(str(schema))).assertValid(root)
    kml = export_results(results, "kml", tmp_path / "map.kml")
    layers = [{name for name, _ in pyogrio.list_layers(one)} for one in (file, kml)]
    assert layers[1] <= layers[0]
    assert "explored" in layers[0]


# --- STAC ---------------------------------------------------------------------------------------
@pytest.fixture
def offline(monkeypatch):
    """Return a validator with all schemas at hand; any other request fails."""
    validator = JsonSchemaSTACValidator()
    schema = (DATA / "stac-projection-2.0.0.schema.json").read_text("utf-8")
    validator.schema_cache[PROJECTION] = json.loads(schema)

    def refuse(self, href, *more):
        raise AssertionError(f"asks for {href}")

    monkeypatch.setattr(pystac.stac_io.DefaultStacIO, "read_text_from_href", refuse)
    return validator


def test_stac_item_is_valid_and_moves_with_its_folder(results, tmp_path, offline):
    assert main(["export", str(results), "--to", "stac"]) == 0
    values = json.loads((results / "stac-item.json").read_text("utf-8"))
    assert values["stac_extensions"] == [PROJECTION]
    item = pystac.Item.from_dict(values)
    assert len(pystac.validation.validate(item, validator=offline)) == 2
    assert {"mosaic", "map", "geopackage", "thumbnail"} <= set(item.assets)
    moved = shutil.copytree(results, tmp_path / "elsewhere" / "again")
    for asset in values["assets"].values():
        assert asset["href"].startswith("./")
        assert (moved / asset["href"]).is_file()
    with rasterio.open(moved / values["assets"]["mosaic"]["href"]) as cog:
        mosaic = values["assets"]["mosaic"]
        assert mosaic["proj:code"] == f"EPSG:{cog.crs.to_epsg()}"
        assert mosaic["proj:shape"] == list(cog.shape)
        assert mosaic["proj:transform"] == list(cog.transform)[:6]
        assert mosaic["proj:bbox"] == list(cog.bounds)
        edges = transform_bounds(cog.crs, "EPSG:4326", *cog.bounds)
    west, south, east, north = values["bbox"]
    assert shapely.box(west, south, east, north).buffer(1e-6).covers(shapely.box(*edges))
    footprint = shapely.from_geojson(json.dumps(values["geometry"]))
    assert footprint.bounds == pytest.approx((west, south, east, north))


def test_stac_item_that_is_not_as_documented_is_noticed(results, offline):
    assert main(["export", str(results), "--to", "stac"]) == 0
    values = json.loads((results / "stac-item.json").read_text("utf-8"))
    values["assets"]["mosaic"]["proj:shape"] = [1]
    with pytest.raises(pystac.STACValidationError):
        pystac.validation.validate(pystac.Item.from_dict(values), validator=offline)


def test_stac_item_has_the_times_and_areas_of_the_summary(results):
    assert main(["export", str(results), "--to", "stac"]) == 0
    values = json.loads((results / "stac-item.json").read_text("utf-8"))
    summary = json.loads((results / "summary.json").read_text("utf-8"))
    found = values["properties"]
    assert found["datetime"] is None
    for name, known in (("start_datetime", "begun_utc"), ("end_datetime", "ended_utc")):
        apart = datetime.fromisoformat(found[name]) - datetime.fromisoformat(summary[known])
        assert abs(apart.total_seconds()) < 0.002
    for name in ("area_m2", "area_low_m2", "area_high_m2", "perimeter_m", "completed"):
        assert found[f"uavmap:{name}"] == summary[name]
    assert found["uavmap:unsure_area_m2"] == summary["cells_unsure_m2"]
    assert found["uavmap:clock"] == "simulated"


# --- geospatial PDF -----------------------------------------------------------------------------
def numbers(text):
    return [float(word) for word in text.split()]


def test_geopdf_has_the_home_where_it_is(results, tmp_path):
    """The dictionaries that GDAL writes are plain text: ISO 32000, measurement of a viewport."""
    data = export_results(results, "geopdf", tmp_path / "map.pdf").read_bytes()
    assert data.startswith(b"%PDF-")
    assert data.rstrip().endswith(b"%%EOF")
    text = data.decode("latin-1")
    (box,) = re.findall(r"/BBox \[ ([^]]+) \] /Measure", text)
    (degrees,) = re.findall(r"/GPTS \[ ([^]]+) \]", text)
    (parts,) = re.findall(r"/LPTS \[ ([^]]+) \]", text)
    flown = flown_of(results)
    zone = flown.data.grid.zone.epsg
    assert re.findall(r"/EPSG (\d+)", text) == [str(zone)]
    left, low, right, top = numbers(box)
    page = [
        (left + u * (right - left), low + v * (top - low))
        for u, v in np.reshape(numbers(parts), (4, 2))
    ]
    project = pyproj.Transformer.from_crs(4326, zone)  # latitude first
    ground = [project.transform(lat, lon) for lat, lon in np.reshape(numbers(degrees), (4, 2))]
    matrix, *_ = np.linalg.lstsq(np.column_stack([ground, np.ones(4)]), np.array(page))
    home = flown.data.start
    east, north = project.transform(home.lat_deg, home.lon_deg)
    x, y = np.array([east, north, 1.0]) @ matrix
    picture = picture_of(data)
    high = picture.shape[0]
    column, row = round(x / 72.0 * DPI), round(high - y / 72.0 * DPI)
    around = picture[row - 12 : row + 13, column - 12 : column + 13].max(axis=2)
    assert around[12, 12] > 200  # a white disc, a dark ring around it
    assert around.min() < 70
    ring = np.argwhere(around < 90).mean(axis=0)
    assert np.abs(ring - 12.0).max() < 1.0


def picture_of(data):
    begin = data.index(b"\xff\xd8\xff")
    end = data.index(b"endstream", begin)
    return cv2.imdecode(np.frombuffer(data[begin:end], np.uint8), cv2.IMREAD_COLOR)


# --- a flight over the region ---------------------------------------------------------------------
def test_wpml_of_a_flown_region_is_as_documented(results, tmp_path):
    assert faults_of(export_results(results, "wpml", tmp_path / "again.kmz").read_bytes()) == []
