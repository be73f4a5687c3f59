"""Photographs to a map: painted ones with known ground, and real ones if present."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest
from PIL import Image

from missions.events import FrameLost, FrameSeen
from missions.flight.setting_of import setting_of
from missions.flight.state import Setting
from missions.geo.grid import Grid
from missions.mission.checks import parse_mission
from missions.units import Cell, GridPoint
from tests.support.journals import META
from tests.support.photographs import dji, write_photo
from tests.support.shown_lines import ShownLines
from tests.support.small_missions import CELL_M, START, Points, ring, square
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import JOURNAL
from uavmap.load.mission_source import load
from uavmap.photos.picture_replay import judge_pictures
from uavmap.photos.scratch_file import Spool
from uavmap.photos.sources.inventory import gather, open_source

REAL = Path(__file__).resolve().parents[4] / "../shared/data/brighton_beach"
GEOD = pyproj.Geod(ellps="WGS84")
GRID = Grid.at(START, CELL_M)

ROI = (6.0, 27.0, 5.0, 20.0)
"""West, east, south and north of the painted region, metres true east and north of the start."""
WIDTH, HEIGHT, FILM_MM, UP_M = 640, 360, 20, 40.0
# the 35 mm equivalent is by the diagonal; a picture of 16:9 is cut from a sensor of 4:3
GSD_M = UP_M * math.hypot(36.0, 24.0) / FILM_MM / math.hypot(WIDTH, 0.75 * WIDTH)


def in_roi(east: np.ndarray, north: np.ndarray) -> np.ndarray:
    west_m, to_east_m, south_m, to_north_m = ROI
    return (east > west_m) & (east < to_east_m) & (north > south_m) & (north < to_north_m)


def paint(
    east_m: float,
    north_m: float,
    yaw_deg: float,
    seed: int = 4,
    region: Callable[[np.ndarray, np.ndarray], np.ndarray] = in_roi,
    levels: tuple[float, float] = (80.0, 200.0),
) -> Image.Image:
    """Render the picture of a camera that points straight down: dark region, bright ground."""
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH]
    right = (columns + 0.5 - WIDTH / 2) * GSD_M
    ahead = (HEIGHT / 2 - rows - 0.5) * GSD_M
    yaw = math.radians(yaw_deg)
    east = east_m + right * math.cos(yaw) + ahead * math.sin(yaw)
    north = north_m - right * math.sin(yaw) + ahead * math.cos(yaw)
    inside = region(east, north)
    noise = np.random.default_rng(seed).normal(0.0, 5.0, inside.shape)
    gray = np.clip(np.where(inside, *levels) + noise, 0, 255).astype(np.uint8)
    return Image.fromarray(gray).convert("RGB")


def geotag(east_m: float, north_m: float) -> dict[int, object]:
    azimuth_deg = math.degrees(math.atan2(east_m, north_m))
    lon, lat, _ = GEOD.fwd(START.lon_deg, START.lat_deg, azimuth_deg, math.hypot(east_m, north_m))
    return {1: "N", 2: (lat, 0.0, 0.0), 3: "E", 4: (lon, 0.0, 0.0)}


def shot(
    path: Path,
    seed: int = 0,
    place: tuple[float, float] = (14.0, 12.0),
    yaw_deg: float = 0.0,
    **tags: object,
) -> Path:
    """Write a photograph from 40 m; `tags` change its tags."""
    known: dict[str, object] = {
        "gps": geotag(*place),
        "taken": f"2024:05:01 10:00:{seed % 60:02}",
        "film_mm": FILM_MM,
        "xmp": dji(RelativeAltitude=f"{UP_M:+.2f}", GimbalYawDegree=f"{yaw_deg:+.2f}"),
    }
    if "image" not in tags:
        known["image"] = paint(*place, yaw_deg, seed=seed)
    return write_photo(path, **{**known, **tags})  # type: ignore[arg-type]


def painted(folder: Path) -> Path:
    """Write four photographs in a row, by heading; the last but one shows other ground."""
    folder.mkdir()
    places = [(10.0, 10.0, 0.0), (16.0, 14.0, 90.0), (20.0, 8.0, 213.0), (14.0, 16.0, -45.0)]
    for number, (east_m, north_m, yaw_deg) in enumerate(places):
        image = paint(east_m, north_m, yaw_deg)
        shot(folder / f"{number}.jpg", number, (east_m, north_m), yaw_deg, image=image)
    return folder


FIELD, FENCE = square(-10, -10, 60, 50), square(-30, -30, 100, 90)


def field_text(
    recorded: str = "evidence",
    detector: str = "intensity = 140, dilations = 0",
    box: Points = FIELD,
    fence: Points = FENCE,
) -> str:
    """Return a mission file for these photographs."""
    return f"""
        start.position = [{START.lat_deg}, {START.lon_deg}]
        search.box = {ring(GRID, box)}
        fence.polygon = {ring(GRID, fence)}
        flight.altitude_m = {UP_M}
        camera = {{width_px = {WIDTH}, height_px = {HEIGHT}, mounting = "gimbal"}}
        detector = {{{detector}, share = 0.5, view = "all"}}
        votes = {{frames = 3, positive = 2, recorded = "{recorded}"}}
    """


def setting(recorded: str = "evidence") -> Setting:
    return setting_of(parse_mission(field_text(recorded), "painted"))


def replayed(images: Path, made: Setting, journal: Journal, out: Path) -> dict[str, Any]:
    with Spool() as spool:
        return judge_pictures(gather(open_source(images)), made, spool).written(journal, out)


def map_region(images: Path, made: Setting, out: Path) -> tuple[dict[str, Any], dict[Cell, str]]:
    """Return the summary, and the states of the cells in the map."""
    with Journal.create(out / JOURNAL, META) as journal:
        summary = replayed(images, made, journal, out)
    features = json.loads((out / "map.geojson").read_text())["features"]
    states = {
        Cell(f["properties"]["column"], f["properties"]["row"]): f["properties"]["state"]
        for f in features
        if f["properties"]["kind"] == "cell"
    }
    return summary, states


def inside_m(cell: Cell) -> float:
    """Return the depth of a cell's centre inside the painted region, m; negative outside."""
    place = GRID.position(GRID.centre_of(cell))
    azimuth, _, metres = GEOD.inv(START.lon_deg, START.lat_deg, place.lon_deg, place.lat_deg)
    east_m = metres * math.sin(math.radians(azimuth))
    north_m = metres * math.cos(math.radians(azimuth))
    west_m, to_east_m, south_m, to_north_m = ROI
    return min(east_m - west_m, to_east_m - east_m, north_m - south_m, to_north_m - north_m)


def test_painted_photographs_give_the_right_cells(tmp_path: Path) -> None:
    summary, states = map_region(painted(tmp_path / "images"), setting(), tmp_path / "out")
    assert summary["photographs"] == 4
    assert summary["completed"]
    assert len(states) > 60
    # an error of a metre, or of the meridian convergence (1.5 degrees here), shows at this margin
    wrong = [
        (cell, state)
        for cell, state in states.items()
        if abs(inside_m(cell)) > 0.5 and (state == "explored") != (inside_m(cell) > 0.0)
    ]
    assert wrong == []
    assert sum(state == "explored" for state in states.values()) == summary["cells_roi"]
    assert summary["cells_roi"] == pytest.approx(21.0 * 15.0 / CELL_M**2, abs=6)


def test_photographs_of_the_same_second_all_count(tmp_path: Path) -> None:
    images = tmp_path / "images"
    images.mkdir()
    for number in range(2):
        place = (16.0, 12.0 + number)
        shot(images / f"{number}.jpg", number, place, taken="2024:05:01 10:00:00")
    summary, _ = map_region(images, setting(), tmp_path / "out")
    assert summary["cells_roi"] > 10  # two votes are needed
    with Journal.open(tmp_path / "out" / JOURNAL) as journal:
        times = [e.t_s for e in journal.events() if isinstance(e, FrameSeen)]
    assert times[0] < times[1]


def row(folder: Path, *images: Image.Image) -> Path:
    """Write photographs of one place, a second apart."""
    folder.mkdir()
    for number, image in enumerate(images):
        shot(folder / f"{number}.jpg", number, (16.0, 12.0), image=image)
    return folder


def test_replay_that_judged_nothing_is_not_complete(tmp_path: Path) -> None:
    cap = Image.new("RGB", (WIDTH, HEIGHT), (0, 0, 0))
    summary, states = map_region(row(tmp_path / "images", cap, cap), setting(), tmp_path / "out")
    assert (summary["photographs"], summary["photographs_judged"]) == (2, 0)
    assert summary["completed"] is False
    assert states == {}


def test_photograph_that_is_no_evidence_is_named_and_the_others_are_judged(
    tmp_path: Path, log_lines: ShownLines
) -> None:
    good = paint(16.0, 12.0, 0.0, seed=1)
    cap = Image.new("RGB", (WIDTH, HEIGHT), (0, 0, 0))
    images = row(tmp_path / "images", good, good, cap, paint(16.0, 12.0, 0.0, seed=2))
    with Journal.create(tmp_path / JOURNAL, META) as journal:
        summary = replayed(images, setting(), journal, tmp_path)
        lost = [e for e in journal.events() if isinstance(e, FrameLost)]
    assert [line.split(":")[0] for line in log_lines if "not judged" in line] == [
        "1.jpg",
        "2.jpg",
    ]
    assert [("stalled" in e.reason, "dark" in e.reason) for e in lost] == [
        (True, False),
        (False, True),
    ]
    assert summary["photographs_judged"] == 2
    assert not summary["completed"]
    assert summary["cells_roi"] > 10  # two votes are needed, and two there are


def test_first_photographs_of_a_place_decide(tmp_path: Path) -> None:
    """By the paper's rule, two of three: mistakes in thirty more pictures change nothing."""
    meadow = [paint(400.0, 12.0, 0.0, seed=n) for n in range(3)]
    wrong = [paint(16.0, 12.0, 0.0, seed=10 + n) for n in range(6)]
    images = row(tmp_path / "images", *meadow, *wrong)
    summary, _ = map_region(images, setting("count"), tmp_path / "out")
    assert summary["completed"]
    assert (summary["decided_by"], summary["cells_roi"]) == ("count", 0)
    assert "belief" not in (tmp_path / "out" / "map.geojson").read_text()


# --- real photographs ------------------------------------------------------------------------
ROAD = [
    (79, 51), (66, 30), (100, 31), (91, 63), (53, 10), (44, 0),
    (33, -12), (20, 14), (27, 22), (110, 37), (75, 47), (68, 26),
]  # fmt: skip
NO_ROAD = [
    (50, 30), (80, 35), (20, 60), (40, 90), (0, 50), (85, 10),
    (65, -20), (35, 10), (64, 51), (82, 66), (12, 74), (60, 100),
]  # fmt: skip
"""Places picked by eye, metres from the start: grass, wood, shrubs and water."""


@pytest.mark.skipif(not REAL.is_dir(), reason=f"no photographs in {REAL}")
def test_real_photographs_map_the_road(tmp_path: Path) -> None:
    made = setting_of(load("road"))
    # poses of the tags: the places were picked by eye on that map
    _, states = map_region(REAL, made, tmp_path / "out")

    def state(place: tuple[int, int]) -> str:
        return states[made.grid.cell_of(GridPoint(float(place[0]), float(place[1])))]

    found = sum(state(place) == "explored" for place in ROAD)
    spared = sum(state(place) == "non-roi" for place in NO_ROAD)
    assert found >= 11, [p for p in ROAD if state(p) != "explored"]
    assert spared >= 11, [p for p in NO_ROAD if state(p) != "non-roi"]
