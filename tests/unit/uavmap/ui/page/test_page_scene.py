"""Tiles from a file under the map: the right ground at the right place."""

import math
import sqlite3
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np
import pytest

from missions.errors import OutputError
from missions.flight.setting_of import setting_of
from missions.units import GridPoint, LatLon
from uavmap.load.mission_source import load
from uavmap.output.drawing.mosaic_file import raster_of
from uavmap.ui.page.page_scene import background_from_mosaic, background_from_tiles, scene_of

MISSION = str(Path(__file__).parents[4] / "data" / "speck.toml")
ZOOM = 18


@pytest.fixture(scope="module")
def setting():
    return setting_of(load(MISSION))


def tile_of(place, zoom):
    """Return the tile of a place by the usual formula, with the hyperbolic sine."""
    y = math.asinh(math.tan(math.radians(place.lat_deg))) / math.pi
    return (place.lon_deg + 180.0) / 360.0 * 2**zoom, (1.0 - y) / 2.0 * 2**zoom


def written(path, around, kind="png", zoom=ZOOM):
    """Write tiles around a place: red is the column in a tile, green its row."""
    ramp = np.arange(256, dtype=np.uint8)
    tile = np.dstack([np.zeros((256, 256), np.uint8), np.repeat(ramp, 256).reshape(256, 256),
                      np.tile(ramp, (256, 1))])  # fmt: skip
    data = cv2.imencode(".png", tile)[1].tobytes()
    x, y = (math.floor(part) for part in tile_of(around, zoom))
    with closing(sqlite3.connect(path)) as database:
        database.execute("CREATE TABLE metadata (name TEXT, value TEXT)")
        database.execute("INSERT INTO metadata VALUES ('format', ?)", (kind,))
        database.execute(
            "CREATE TABLE tiles (zoom_level INT, tile_column INT, tile_row INT, tile_data BLOB)"
        )
        for column in range(x - 2, x + 3):
            for row in range(y - 2, y + 3):
                values = (zoom, column, 2**zoom - 1 - row, data)
                database.execute("INSERT INTO tiles VALUES (?, ?, ?, ?)", values)
        database.commit()
    return path


def test_points_of_the_ground_are_where_the_tiles_have_them(setting, tmp_path):
    found = background_from_tiles(written(tmp_path / "a.mbtiles", setting.mission.home), setting)
    image = cv2.imdecode(np.frombuffer(found.jpeg, np.uint8), cv2.IMREAD_COLOR)
    rows, columns = image.shape[:2]
    m_per_px = found.width_m / columns
    assert found.height_m / rows == pytest.approx(m_per_px, rel=0.002)
    seen = 0
    for east_m in np.linspace(found.west_m + 5, found.west_m + found.width_m - 5, 9):
        for north_m in np.linspace(found.north_m - 5, found.north_m - found.height_m + 5, 9):
            x, y = tile_of(setting.grid.position(GridPoint(float(east_m), float(north_m))), ZOOM)
            red, green = 256 * (x % 1.0) - 0.5, 256 * (y % 1.0) - 0.5
            if not (6 < red < 250 and 6 < green < 250):
                continue  # a ramp begins anew
            at = image[
                int((found.north_m - north_m) / m_per_px), int((east_m - found.west_m) / m_per_px)
            ]
            assert abs(float(at[2]) - red) < 5
            assert abs(float(at[1]) - green) < 5
            seen += 1
    assert seen > 40


def test_unusable_tiles_are_refused_in_a_line(setting, tmp_path):
    home = setting.mission.home
    for name, expected, make in (
        ("vector", "vector tiles", lambda p: written(p, home, "pbf")),
        ("far", "no tile at the place", lambda p: written(p, LatLon(-30.0, 100.0))),
        ("text", "cannot be read", lambda p: p.write_text("no tiles")),
        ("missing", "cannot be read", lambda p: None),
    ):
        path = tmp_path / f"{name}.mbtiles"
        make(path)
        with pytest.raises(OutputError, match=expected) as refusal:
            background_from_tiles(path, setting)
        assert str(path) in str(refusal.value)
        assert "\n" not in str(refusal.value)


def test_coarser_zoom_is_used_where_there_is_no_finer(setting, tmp_path):
    assert background_from_tiles(
        written(tmp_path / "b.mbtiles", setting.mission.home, zoom=12), setting
    ).jpeg


def test_scene_without_a_mosaic_has_none(setting, tmp_path):
    assert background_from_mosaic(tmp_path / "ortho.tif", setting) is None
    (tmp_path / "ortho.tif").write_bytes(b"no GeoTIFF")
    assert background_from_mosaic(tmp_path / "ortho.tif", setting) is None


def test_scene_has_the_place_of_the_mosaic_around_the_fence(setting):
    place = scene_of(setting, None, raster_of(setting))["mosaic"]
    for corner in setting.mission.fence.polygon:
        point = setting.grid.fixed(LatLon(*corner))
        assert 0.0 < point.east_m - place["west"] < place["width_m"]
        assert 0.0 < place["north"] - point.north_m < place["height_m"]
    assert scene_of(setting)["mosaic"] is None
