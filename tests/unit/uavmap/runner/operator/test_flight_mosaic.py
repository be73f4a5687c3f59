"""The mosaic that a flight leaves in its results."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pytest
import rasterio

from missions.flight.setting_of import setting_of
from missions.units import GridPoint
from tests.failing_disk import failing_disk
from tests.support.small_missions import mission, square
from tests.unit.vision.scene import nadir_pose
from uavmap.journal.kept_frames import ROOM_MIB, KeptFrame
from uavmap.output.drawing.mosaic_file import MOSAIC, Ground, raster_of
from uavmap.output.drawing.scene import View
from uavmap.runner.operator.flight_mosaic import FlightMosaic

MISSION = square(-10, 16, 40, 30), square(-60, -60, 160, 160)
SETTING = setting_of(mission(*MISSION))
GRID = SETTING.grid
LOG = "uavmap.flight"


def plain(level: int) -> np.ndarray:
    return np.full((240, 320, 3), (level, level // 2, 10), np.uint8)  # blue, green, red


def frame(east_m: float, north_m: float, height_m: float = 12.0, vehicle: int = 1) -> KeptFrame:
    pose, _ = nadir_pose(GRID, GridPoint(east_m, north_m), height_m, 30.0)
    return KeptFrame("", vehicle, 1.0, pose, 80.0)


def fly(folder: Path, *pictures: tuple[KeptFrame, int], again: bool = False) -> None:
    mosaic = FlightMosaic(folder, SETTING, waits=True)
    mosaic.begin(SETTING, again=again)
    for kept, level in pictures:
        mosaic.keep(kept, plain(level))
    mosaic.end()


def at(folder: Path, east_m: float, north_m: float) -> list[int]:
    ground = Ground.read(folder, GRID)
    assert ground is not None
    raster = ground.raster
    row = int((raster.north_m - north_m) / raster.pitch_m)
    return ground.image[row, int((east_m - raster.west_m) / raster.pitch_m)].tolist()


def near(level: int) -> list[object]:
    return [*(pytest.approx(value, abs=4) for value in (10, level // 2, level)), 255]


def test_mosaic_shows_pictures_of_all_vehicles_where_they_were_taken(tmp_path):
    fly(tmp_path, (frame(10.0, 20.0), 100), (frame(-30.0, 60.0, vehicle=2), 200))
    assert at(tmp_path, 10.0, 20.0) == near(100)
    assert at(tmp_path, -30.0, 60.0) == near(200)
    assert at(tmp_path, 40.0, -40.0)[3] == 0
    assert [path.suffix for path in sorted(tmp_path.iterdir())] == [".webp", ".xml"]


def test_mosaic_lies_for_gdal_where_the_grid_has_it(tmp_path):
    fly(tmp_path, (frame(10.0, 20.0), 100))
    place = GRID.zone.lon_lat
    with rasterio.open(tmp_path / MOSAIC) as file:
        assert file.crs.to_epsg() == GRID.zone.epsg
        seen = np.argwhere(file.read(4) > 0)
        east, north = file.transform @ (seen.mean(axis=0)[::-1] + 0.5)
    ((lon, lat),) = place(np.array([[east, north]]))
    middle = GRID.position(GridPoint(10.0, 20.0))
    assert (lat, lon) == pytest.approx((middle.lat_deg, middle.lon_deg), abs=2e-6)


def test_mosaic_lower_picture_shows_in_any_order(tmp_path):
    low, high = (frame(10.0, 20.0), 100), (frame(12.0, 20.0, 40.0), 200)
    for folder, order in (("a", (low, high)), ("b", (high, low))):
        (tmp_path / folder).mkdir()
        fly(tmp_path / folder, *order)
        assert at(tmp_path / folder, 10.0, 20.0) == near(100)
        assert at(tmp_path / folder, 30.0, 20.0) == near(200)


def test_mosaic_of_a_resumed_flight_continues_and_of_a_repeated_one_restarts(tmp_path):
    fly(tmp_path, (frame(10.0, 20.0), 100))
    fly(tmp_path, (frame(-30.0, 60.0), 200))
    assert (at(tmp_path, 10.0, 20.0), at(tmp_path, -30.0, 60.0)) == (near(100), near(200))
    fly(tmp_path, (frame(-30.0, 60.0), 200), again=True)
    assert at(tmp_path, 10.0, 20.0)[3] == 0


def test_mosaic_leaves_out_pictures_of_the_same_ground(tmp_path):
    fly(tmp_path, (frame(10.0, 20.0), 100), (frame(10.5, 20.0), 200))
    assert at(tmp_path, 10.0, 20.0) == near(100)


def test_mosaic_of_a_drifting_region_is_left_out_with_a_line(tmp_path, caplog):
    setting = setting_of(mission(*MISSION, drift_m_s=0.3))
    mosaic = FlightMosaic(tmp_path, setting, waits=True)
    with caplog.at_level("INFO", LOG):
        mosaic.begin(setting, again=False)
        mosaic.keep(frame(10.0, 20.0), plain(100))
        mosaic.end()
    assert caplog.messages == [f"{MOSAIC} is left out: the region drifts over the ground"]
    assert list(tmp_path.iterdir()) == []


class Usage(NamedTuple):
    free: int


def test_mosaic_leaves_the_last_room_to_the_journal(tmp_path, caplog, monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda path: Usage(ROOM_MIB * 2**20 - 1))
    with caplog.at_level("INFO", LOG):
        fly(tmp_path, (frame(10.0, 20.0), 100), (frame(40.0, 20.0), 100))
    (line,) = caplog.messages
    assert f"({ROOM_MIB} MiB are needed for the journal)" in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("fails_at", [1, 7])  # in the first file, and in the last one
def test_mosaic_disk_refuses_once_is_reported_and_written_the_next_time(fails_at, tmp_path, caplog):
    with failing_disk(tmp_path, fails_at) as disk, caplog.at_level("INFO", LOG):
        fly(tmp_path, *((frame(10.0 * k, 20.0), 100) for k in range(4)))
    assert disk.failed
    (line,) = caplog.messages
    assert line == f"{tmp_path / MOSAIC} cannot be written (Input/output error); it is tried again"
    assert at(tmp_path, 30.0, 20.0) == near(100)


def test_mosaic_picture_that_cannot_be_decoded_costs_the_mosaic_only(tmp_path, caplog):
    mosaic = FlightMosaic(tmp_path, SETTING, waits=True)
    with caplog.at_level("INFO", LOG):
        mosaic.keep(frame(10.0, 20.0), b"no picture")
        mosaic.end()
        mosaic.keep(frame(40.0, 20.0), plain(100))  # one that arrives late
    (line,) = caplog.messages
    assert "is not continued (ImageError: " in line


def test_mosaic_that_is_damaged_or_has_no_place_is_none(tmp_path):
    fly(tmp_path, (frame(10.0, 20.0), 100))
    place = next(tmp_path.glob("*.xml"))
    for text in ("", "<GeoTransform>1, 2</GeoTransform>", "<GeoTransform>0, -1, 0, 0, 0, 0"):
        place.write_text(text)
        assert Ground.read(tmp_path, GRID) is None
    fly(tmp_path, (frame(10.0, 20.0), 100))
    (tmp_path / MOSAIC).write_bytes(b"no picture")
    assert Ground.read(tmp_path, GRID) is None


def test_mosaic_beneath_a_view_lies_as_on_its_raster():
    raster = raster_of(SETTING)
    assert raster is not None
    image = np.zeros((raster.rows, raster.columns, 4), np.uint8)
    cv2.rectangle(image, (400, 300), (700, 500), (250, 120, 10, 255), -1)
    corner_m = raster.west_m + 400 * raster.pitch_m, raster.north_m - 300 * raster.pitch_m
    view = View(corner_m[0] - 5.0, corner_m[1] + 5.0, 2.0, 200, 150)  # coarser, half a metre
    rows, columns = np.nonzero(Ground(raster, image).beneath(view)[..., 3])
    low, high = 10.0, 10.0 + 301 * raster.pitch_m * 2.0
    assert (columns.min(), columns.max() + 1) == pytest.approx((low, high), abs=1.5)
    assert rows.min() == pytest.approx(low, abs=1.5)
