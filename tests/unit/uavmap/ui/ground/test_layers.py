"""Every format of a map beneath shows the right ground at the right place."""

from __future__ import annotations

import asyncio
import math
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from pyproj import Transformer

from missions.errors import UavmapError
from missions.geo.grid import Grid
from missions.geo.web_mercator import share_of
from missions.units import LatLon
from uavmap.output.drawing.mosaic_file import MOSAIC, utm_transform, write_mosaic
from uavmap.ui.app.flights import tiles_option
from uavmap.ui.app.grounds import Grounds
from uavmap.ui.app.visitor import App
from uavmap.ui.app.workspace import Workspace
from uavmap.ui.ground.layer import open_layer
from vision.raster import Raster

START = LatLon(47.3, 8.5)
GRID = Grid.at(START, 4.0)
SIDE = 200
PITCH_M = 0.5
RASTER = Raster(-50.0, 50.0, PITCH_M, SIDE, SIDE)
_LEFT = 40
"""Number of columns without content."""


def ground() -> Any:
    """Paint ground: red is the column, green the row; the first columns are empty."""
    ramp = np.arange(SIDE, dtype=np.uint8)
    image = np.zeros((SIDE, SIDE, 4), np.uint8)
    image[..., 0], image[..., 1], image[..., 2], image[..., 3] = ramp, ramp[:, None], 90, 255
    image[:, :_LEFT] = 0
    return image


def place(column: float, row: float) -> LatLon:
    step, _, west, _, down, north = utm_transform(RASTER, GRID)
    back = Transformer.from_crs(f"EPSG:{GRID.zone.epsg}", "EPSG:4326", always_xy=True)
    lon, lat = back.transform(west + step * column, north + down * row)
    return LatLon(lat, lon)


def place_in_tiles(at: LatLon, zoom: int) -> tuple[float, float]:
    right, down = share_of(at.lat_deg, at.lon_deg)
    return float(right) * 2**zoom, float(down) * 2**zoom


def geotiff(folder: Path, name: str = "field.tif", driver: str = "GTiff") -> Path:
    rasterio = pytest.importorskip("rasterio")
    image, path = ground(), folder / name
    profile = {"driver": "GTiff", "width": SIDE, "height": SIDE, "count": 3, "dtype": "uint8",
               "crs": f"EPSG:{GRID.zone.epsg}",
               "transform": rasterio.Affine(*utm_transform(RASTER, GRID))}  # fmt: skip
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True), rasterio.open(path, "w", **profile) as file:
        file.write(image[..., :3].transpose(2, 0, 1))
        file.write_mask(image[..., 3])
    if driver == "COG":
        from rasterio.shutil import copy  # noqa: PLC0415

        copy(path, folder / f"cog-{name}", driver="COG", compress="deflate")
        path = folder / f"cog-{name}"
    return path


def cog(folder: Path) -> Path:
    return geotiff(folder, driver="COG")


def mosaic(folder: Path) -> Path:
    write_mosaic(folder, ground(), RASTER, GRID)
    return folder / MOSAIC


def tiles_of(folder: Path) -> tuple[int, dict[tuple[int, int], bytes]]:
    """Return the ground as tiles of one level, in PNG."""
    with closing(open_layer(geotiff(folder, "source.tif"))) as layer:
        zoom = layer.zooms[-1]
        corners = [place_in_tiles(place(*at), zoom) for at in ((0, 0), (SIDE, SIDE))]
        (left, top), (right, bottom) = (map(math.floor, corner) for corner in corners)
        found = {
            (x, y): data
            for x in range(left, right + 1)
            for y in range(top, bottom + 1)
            if (data := layer.tile(zoom, x, y)) is not None
        }
    (folder / "source.tif").unlink()
    return zoom, found


def mbtiles(folder: Path) -> Path:
    zoom, found = tiles_of(folder)
    path = folder / "field.mbtiles"
    with closing(sqlite3.connect(path)) as database:
        database.execute("CREATE TABLE metadata (name TEXT, value TEXT)")
        database.execute("INSERT INTO metadata VALUES ('attribution', '(c) the makers')")
        database.execute(
            "CREATE TABLE tiles (zoom_level INT, tile_column INT, tile_row INT, tile_data BLOB)"
        )
        for (x, y), data in found.items():
            values = zoom, x, 2**zoom - 1 - y, data
            database.execute("INSERT INTO tiles VALUES (?, ?, ?, ?)", values)
        database.commit()
    return path


def pmtiles(folder: Path) -> Path:
    writing = pytest.importorskip("pmtiles.writer")
    from pmtiles.tile import Compression, TileType, zxy_to_tileid  # noqa: PLC0415

    zoom, found = tiles_of(folder)
    path, middle = folder / "field.pmtiles", place(SIDE / 2, SIDE / 2)
    with path.open("wb") as file:
        writer = writing.Writer(file)
        for tile_id, data in sorted((zxy_to_tileid(zoom, *at), data) for at, data in found.items()):
            writer.write_tile(tile_id, data)
        sides = {f"{end}_{axis}_e7": int(1e7 * value) for end in ("min", "max")
                 for axis, value in (("lat", middle.lat_deg), ("lon", middle.lon_deg))}  # fmt: skip
        header = {"tile_type": TileType.PNG, "tile_compression": Compression.NONE,
                  "center_zoom": zoom, "center_lon_e7": 0, "center_lat_e7": 0,
                  **sides}  # fmt: skip
        writer.finalize(header, {"attribution": "(c) the makers"})
    return path


@pytest.mark.parametrize("make", [geotiff, cog, mosaic, mbtiles, pmtiles])
def test_tile_has_the_colour_of_each_place_and_its_gaps(make: Any, tmp_path: Path) -> None:
    with closing(open_layer(make(tmp_path))) as layer:
        zoom = layer.zooms[-1]
        lossy = 14 if make is mosaic else 5
        for column, row in ((60, 20), (100, 100), (180, 60), (150, 190)):
            x, y = place_in_tiles(place(column, row), zoom)
            data = layer.tile(zoom, math.floor(x), math.floor(y))
            assert data is not None
            tile = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
            found = tile[int(256 * (y % 1.0)), int(256 * (x % 1.0))].astype(int)
            assert abs(found[2] - column) <= lossy
            assert abs(found[1] - row) <= lossy
        x, y = place_in_tiles(place(10, 100), zoom)
        data = layer.tile(zoom, math.floor(x), math.floor(y))
        if data is not None:
            tile = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
            assert tile[int(256 * (y % 1.0)), int(256 * (x % 1.0)), 3] == 0
        middle = LatLon(*layer.middle)
        assert abs(middle.lat_deg - START.lat_deg) < 1e-3
        assert abs(middle.lon_deg - START.lon_deg) < 1e-3
        coarse = layer.tile(zoom - 3, *(n // 8 for n in map(int, place_in_tiles(middle, zoom))))
        assert (coarse is not None) == (len(layer.zooms) > 1)


def test_pixel_edge_of_a_level_is_no_coarser_than_that_of_the_picture(tmp_path: Path) -> None:
    with closing(open_layer(geotiff(tmp_path))) as layer:
        m_per_px = 40075016.7 * math.cos(math.radians(START.lat_deg)) / 256 / 2 ** layer.zooms[-1]
        assert PITCH_M / 2 < m_per_px <= 1.08 * PITCH_M


def test_files_that_show_no_ground_are_refused_in_a_line(tmp_path: Path) -> None:
    rasterio = pytest.importorskip("rasterio")
    heights = {"driver": "GTiff", "width": 4, "height": 4, "count": 1, "dtype": "float32",
               "crs": "EPSG:32632", "transform": rasterio.Affine(1, 0, 9, 0, -1, 9)}  # fmt: skip
    with rasterio.open(tmp_path / "heights.tif", "w", **heights) as file:
        file.write(np.zeros((1, 4, 4), np.float32))
    cv2.imwrite(str(tmp_path / "photograph.tif"), np.zeros((4, 4, 3), np.uint8))
    for name in ("text.tif", "text.mbtiles", "text.pmtiles", "mosaic.webp", "drawing.kml"):
        (tmp_path / name).write_text("no map")
    for name, said in (("heights.tif", "float32"), ("text.tif", "GeoTIFF"), ("none.tif", "GeoTIFF"),
                       ("photograph.tif", "has no place"),
                       ("text.mbtiles", "MBTiles"), ("text.pmtiles", "PMTiles"),
                       ("mosaic.webp", "the mosaic"), ("drawing.kml", "not a map")):  # fmt: skip
        with pytest.raises(UavmapError, match=said) as refusal:
            open_layer(tmp_path / name)
        assert str(tmp_path / name) in str(refusal.value)
        assert "\n" not in str(refusal.value)


def test_file_of_another_format_under_the_name_of_a_geotiff_is_refused(tmp_path: Path) -> None:
    elsewhere = geotiff(tmp_path, "elsewhere.tif")
    (tmp_path / "field.tif").write_text(
        '<VRTDataset rasterXSize="4" rasterYSize="4"><SRS>EPSG:32632</SRS>'
        '<VRTRasterBand dataType="Byte" band="1"><SimpleSource>'
        f"<SourceFilename>{elsewhere}</SourceFilename>"
        "</SimpleSource></VRTRasterBand></VRTDataset>"
    )
    with pytest.raises(UavmapError, match="cannot be read as GeoTIFF"):
        open_layer(tmp_path / "field.tif")


def test_maps_of_a_folder_are_listed_and_the_one_of_a_place_is_found(tmp_path: Path) -> None:
    geotiff(tmp_path)
    (tmp_path / "a.mbtiles").write_text("no map")
    flown = tmp_path / "results" / "field-1"
    flown.mkdir(parents=True)
    (flown / "journal.jsonl").write_text("")
    mosaic(flown)
    grounds = Grounds(Workspace(tmp_path))
    assert grounds.files() == ["a.mbtiles", "field.tif"]
    assert grounds.mosaics() == ["results/field-1/mosaic.webp"]
    app = App(Workspace(tmp_path), None)
    for name, at in (("here", place(100, 100)), ("away", LatLon(47.0, 8.5))):
        box, fence = (
            [[at.lat_deg + n, at.lon_deg + e] for n, e in ((-d, -d), (-d, d), (d, d), (d, -d))]
            for d in (0.0002, 0.0003)
        )
        (tmp_path / f"{name}.toml").write_text(
            f"[start]\nposition = [{at.lat_deg}, {at.lon_deg}]\n[search]\nbox = {box}\n"
            f"[fence]\npolygon = {fence}\n"
        )
    assert asyncio.run(tiles_option(app, "here.toml")) == ["--tiles", "field.tif"]
    assert asyncio.run(tiles_option(app, "away.toml")) == []
    zoom = grounds.facts("field.tif").zooms[-1]
    x, y = map(math.floor, place_in_tiles(place(100, 100), zoom))
    assert grounds.tile("field.tif", zoom, x, y)
    assert grounds.tile("results/field-1/mosaic.webp", zoom, x, y)
    for name in ("../field.tif", "none.tif", "a.mbtiles", "field\0.tif"):
        assert grounds.tile(name, zoom, x, y) is None
    for far in (-1, 2**zoom, 10**400):
        assert grounds.tile("field.tif", zoom, far, y) is None
