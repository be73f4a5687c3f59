"""Areas as every tool writes them: each becomes the same field, and a mission that can be flown."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
import pytest
import shapely
from shapely.geometry import Polygon

from missions.mission.checks import parse_mission
from missions.units import LatLon
from tests.prose import ROOT
from tests.support.areas.area_files import FIELD, HOME, HOME_INSIDE, KINDS, POND
from uavmap.load.areas.drawing import Positions
from uavmap.load.areas.drones import CAMERAS, DRONES
from uavmap.load.areas.formats import FORMATS, SUFFIXES
from uavmap.load.areas.layout import LayoutOptions, lay_out
from uavmap.load.areas.mission_text import AircraftFigures, FlightChoices, compose
from uavmap.load.areas.reading import read_area_file

AREAS = ROOT / "tests/data/areas"
BESIDE_A_SHAPEFILE = {".dbf", ".shx", ".prj", ".cpg", ".qmd", ".xml"}
SIM = AircraftFigures("the simulator's", 80.0, 640, 480, 0.2, "fixed", 60.0, 300.0, 12.0, 6.0)
HOMES = {
    "kml_with_roles": HOME,
    "qgc_survey_with_fence": HOME,
    "qgc_waypoints": HOME,
    "qgc_survey_with_circles": HOME,
    "qgc_of_2017": HOME,
    "mission_planner_waypoints": HOME,
    "mission_planner_fence": HOME_INSIDE,
    "mission_planner_old_fence": HOME_INSIDE,
    "qgc_of_3_2": HOME,
    "qgc_fence_alone": HOME_INSIDE,
    "qgc_corridor": HOME,
    "qgc_survey_and_structure": HOME,
    "mission_planner_splines": HOME,
    "mission_planner_fence_with_circle": HOME_INSIDE,
    "mavproxy_waypoints": HOME,
    "mavproxy_fence": HOME_INSIDE,
    "osmand_walk": HOME,
}
FENCES = {
    "kml_with_roles", "qgc_survey_with_fence", "qgc_survey_with_circles", "qgc_of_2017",
    "mission_planner_fence", "mission_planner_old_fence", "geopackage_with_roles",
    "qgc_fence_alone", "mission_planner_fence_with_circle", "mavproxy_fence",
}  # fmt: skip
KEEP_OUT = {
    "kml_with_roles", "kml_with_hole", "qgc_survey_with_fence", "qgc_survey_with_circles",
    "mission_planner_fence", "shapefile_with_hole", "geopackage_with_roles",
    "mission_planner_fence_with_circle",
}  # fmt: skip


def metres(ring: Positions | tuple[tuple[float, float], ...]) -> Polygon:
    """Return a ring near the field in metres, to a thousandth of its size."""
    points = [(p.lon_deg, p.lat_deg) if isinstance(p, LatLon) else p for p in ring]
    scale = np.array([111_320.0 * np.cos(np.radians(52.4565)), 111_320.0])
    return shapely.transform(Polygon(points), lambda xy: (xy - np.array(FIELD[0])) * scale)


@pytest.mark.parametrize("kind", KINDS)
def test_file_of_each_kind_becomes_the_field_and_a_mission(kind, tmp_path):
    drawing = read_area_file(str(KINDS[kind](tmp_path)))
    (area,) = drawing.areas
    # to half a metre: a datum other than WGS84 is known no better
    assert metres(area.ring).hausdorff_distance(metres(FIELD)) < 0.5
    assert bool(drawing.fences) == (kind in FENCES)
    if kind in HOMES:
        assert drawing.home is not None
        assert (drawing.home.lon_deg, drawing.home.lat_deg) == pytest.approx(HOMES[kind], abs=1e-7)
    else:
        assert drawing.home is None

    layout = lay_out(drawing, LayoutOptions())
    mission = parse_mission(compose("field", kind, layout, SIM, FlightChoices()), kind)
    box, fence = (metres(tuple(LatLon(*v) for v in ring)) for ring in (
        mission.search.box, mission.fence.polygon
    ))  # fmt: skip
    assert box.area > 0.9 * metres(FIELD).area
    assert fence.contains(box)
    assert len(mission.fence.holes) == (1 if kind in KEEP_OUT else 0)
    for hole in mission.fence.holes:
        pond = metres(tuple(LatLon(*v) for v in hole))
        assert pond.intersection(metres(POND)).area > 0.3 * pond.area


@pytest.mark.parametrize("drone", DRONES)
def test_every_drone_of_the_table_can_fly_a_field(drone, tmp_path):
    layout = lay_out(read_area_file(str(KINDS["geojson_io"](tmp_path))), LayoutOptions(vehicles=2))
    values = asdict(DRONES[drone])
    figures = AircraftFigures(**{**asdict(CAMERAS[values.pop("camera")]), **values})
    mission = parse_mission(compose("f", "f", layout, figures, FlightChoices(vehicles=2)), drone)
    assert len(mission.vehicles) == 2
    assert mission.altitude_m(1) <= 60.0


def test_format_of_areas_has_its_suffixes_a_sample_and_a_row_of_its_page():
    """The app takes these files, and a command that wants a mission names the remedy."""
    samples = {path.suffix.lower() for path in AREAS.rglob("*.*") if path.is_file()}
    page = (ROOT / "docs/reference/areas.md").read_text("utf-8")
    assert samples - BESIDE_A_SHAPEFILE <= set(SUFFIXES)
    for name in (each.suffixes[0] for each in FORMATS if each.suffixes):
        assert name in samples, f"a file {name} in tests/data/areas"
        assert f"`{name}`" in page, f"a row for {name} in docs/reference/areas.md"
