"""Waypoint files of DJI aircraft follow its documentation and keep inside the fence."""

import io
import zipfile
from dataclasses import replace
from itertools import pairwise

import pytest
import shapely
from shapely.geometry import LineString

from missions.flight.setting_of import setting_of
from missions.mission.places import homes
from missions.mission.views import rows_across
from missions.planning.search.lanes import along_east
from missions.units import GridPoint, LatLon
from tests.support.wpml_schema import (
    TEMPLATE,
    WAYLINES,
    faults_of,
    opened,
    places,
    tag,
    text,
)
from tests.unit.uavmap.output.flown_folders import EVENTS, PLAN, folder_of
from tests.unit.uavmap.output.formats.test_exports import flown_at
from tests.unit.uavmap.output.maps import make_map
from tests.unit.uavmap.ui.cli.commands.test_export import mission_file, text_of
from uavmap.output.formats.follow_up import follow_up_flight
from uavmap.output.formats.wpml_encoder import AIRCRAFT
from uavmap.output.results import flown_of
from uavmap.ui.cli import main


def export_wpml(tmp, *arguments):
    file = tmp / "field.kmz"
    assert main(["export", *map(str, arguments), "--wpml", str(file)]) == 0
    return documented(file)


def documented(file):
    data = file.read_bytes()
    assert faults_of(data) == []
    return opened(data)


def path_of(document, grid):
    return [grid.fixed(LatLon(lat, lon)) for lon, lat in places(document)]


def spans_of(document):
    """Return the waypoints between which pictures are taken, and their distance."""
    return [
        (
            int(text(group, "actionGroupStartIndex")),
            int(text(group, "actionGroupEndIndex")),
            float(text(group, "actionTrigger", "actionTriggerParam")),
        )
        for group in document.iter(tag("actionGroup"))
        if text(group, "actionTrigger", "actionTriggerType") == "multipleDistance"
    ]


def assert_inside(path, fence):
    allowed = fence.shrunk(-0.02)  # degrees in the file are rounded
    assert all(allowed.covers(LineString(leg)) for leg in pairwise(path))


# --- of a mission -------------------------------------------------------------------------------
def test_wpml_of_a_mission_flies_the_search_lanes_inside_the_fence(tmp_path):
    file, setting = mission_file(tmp_path)
    files = export_wpml(tmp_path, file)
    for document in files.values():
        path = path_of(document, setting.grid)
        home = setting.grid.fixed(homes(setting.mission)[0])
        assert path[0].distance_to(home) < 0.01
        assert path[-1].distance_to(home) < 0.01
        assert_inside(path, setting.fence)
        spans = spans_of(document)
        assert len(spans) == len(setting.shares[0]) > 4
        for lane, (first, last, every_m) in zip(setting.shares[0], spans, strict=True):
            assert path[first].distance_to(lane[0]) < 0.01
            assert path[last].distance_to(lane[1]) < 0.01
            assert every_m == setting.mission.grid.cell_m
    waylines = files[WAYLINES]
    heights = {e.text for e in waylines.iter(tag("executeHeight"))}
    assert heights == {f"{setting.mission.altitude_m(0):g}"}
    speeds = {float(e.text or "") for e in waylines.iter(tag("waypointSpeed"))}
    assert speeds == {setting.mission.flight.speed_m_s}
    turned = next(files[TEMPLATE].iter(tag("gimbalPitchRotateAngle")))
    assert turned.text == "-90"


def test_wpml_of_several_vehicles_has_a_file_and_a_height_each(tmp_path):
    file, setting = mission_file(tmp_path, vehicles=3, layer_m=7.0)
    assert main(["export", str(file), "--wpml", str(tmp_path / "team.kmz")]) == 0
    lanes = 0
    for number in (1, 2, 3):
        waylines = documented(tmp_path / f"team-{number}.kmz")[WAYLINES]
        heights = {e.text for e in waylines.iter(tag("executeHeight"))}
        assert heights == {f"{12.0 + 7.0 * (number - 1):g}"}
        lanes += len(spans_of(waylines))
    assert lanes == len(setting.lanes)


@pytest.mark.parametrize("drone", AIRCRAFT)
def test_wpml_names_the_aircraft_and_its_camera(tmp_path, drone):
    file, _ = mission_file(tmp_path)
    for document in export_wpml(tmp_path, file, "--drone", drone).values():
        info = [
            int(text(document, "missionConfig", *path))
            for path in (
                ("droneInfo", "droneEnumValue"),
                ("droneInfo", "droneSubEnumValue"),
                ("payloadInfo", "payloadEnumValue"),
            )
        ]
        assert info == list(AIRCRAFT[drone])


def test_wpml_and_plan_are_written_together_or_not_at_all(tmp_path, refused):
    file, _ = mission_file(tmp_path)
    plan, wpml = tmp_path / "field.plan", tmp_path / "field.kmz"
    plan.write_text("mine")
    line = refused("export", file, "--plan", plan, "--wpml", wpml)
    assert "field.plan: already exists" in line
    assert not wpml.exists()
    assert "is given twice" in refused("export", file, "--plan", wpml, "--wpml", wpml)
    assert "above the take-off" in refused("export", file, "--wpml", wpml, "--above-sea")


def test_wpml_of_a_mission_that_is_too_fast_is_refused(tmp_path, refused):
    file, _ = mission_file(tmp_path)
    text = text_of().replace("speed_m_s = 5.0", "speed_m_s = 16.0\nmax_airspeed_m_s = 20.0")
    file.write_text(text, "utf-8")
    line = refused("export", file, "--wpml", tmp_path / "x.kmz")
    assert "flight.speed_m_s = 16" in line
    assert "up to 15 m/s" in line


# --- over a mapped region -----------------------------------------------------------------------
@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return folder_of(tmp_path_factory.mktemp("wpml"))


def test_wpml_of_results_flies_over_the_whole_region_and_its_margin(folder, tmp_path, capsys):
    file = tmp_path / "again.kmz"
    assert main(["export", str(folder), "--to", "wpml", "--out", str(file)]) == 0
    flown = flown_of(folder)
    setting, grid = flown.setting, flown.data.grid
    waylines = documented(file)[WAYLINES]
    path = path_of(waylines, grid)
    assert_inside(path, setting.fence)
    assert path[0].distance_to(grid.fixed(homes(setting.mission)[0])) < 0.01
    heights = {e.text for e in waylines.iter(tag("executeHeight"))}
    assert heights == {f"{setting.mission.altitude_m(0):g}"}
    around = flown.extent.outline.buffer(grid.cell_m, join_style="mitre")
    corners = [GridPoint(*place) for place in around.envelope.exterior.coords[:-1]]
    rows = rows_across(setting.mission, grid, east_ahead=along_east(corners))
    lanes = [LineString([path[first], path[last]]) for first, last, _ in spans_of(waylines)]
    seen = shapely.union_all([lane.buffer(rows * grid.cell_m / 2.0) for lane in lanes])
    assert seen.covers(flown.extent.outline)
    output = capsys.readouterr().err
    assert "a picture each" in output
    assert "% sideways" in output


@pytest.mark.parametrize("member", [2, None])
def test_follow_up_begins_at_the_home_of_its_own_vehicle(tmp_path, member):
    _, setting = mission_file(tmp_path, vehicles=3, layer_m=7.0)
    data = make_map(start=setting.mission.home)
    flown = flown_at(replace(data, grid=setting.grid), tmp_path)
    flight = follow_up_flight(replace(flown, setting=setting_of(setting.mission, member)))
    vehicle = 0 if member is None else member - 1
    assert flight.home == homes(setting.mission)[vehicle]
    assert flight.items[0].height_m == setting.mission.altitude_m(vehicle)


def test_wpml_of_results_without_a_region_is_refused_in_a_line(tmp_path, refused):
    before = [event for event in EVENTS if event.t_s < 15.0]
    folder = folder_of(tmp_path, before, PLAN)
    line = refused("export", folder, "--to", "wpml")
    assert "has no region; export" in line
    assert not (folder / "follow-up.kmz").exists()


# --- the checker --------------------------------------------------------------------------------
BREAKS = {
    "another namespace": ("wpmz/1.0.2", "wpmz/9.9.9"),
    "no finish": ("<wpml:finishAction>goHome</wpml:finishAction>", ""),
    "a finish that nobody documents": ("goHome", "flyAway"),
    "no action for a lost link": (
        "<wpml:executeRCLostAction>goBack</wpml:executeRCLostAction>",
        "",
    ),
    "too low a take-off": ("Height>12<", "Height>1<"),
    "an index left out": ("<wpml:index>3</wpml:index>", "<wpml:index>4</wpml:index>"),
    "latitude first": ("<coordinates>11.", "<coordinates>211."),
    "pictures at no distance": ("actionTriggerParam>4<", "actionTriggerParam>0<"),
    "an action after the last waypoint": ("EndIndex>2<", "EndIndex>999<"),
    "an aircraft that nobody documents": ("droneEnumValue>77<", "droneEnumValue>1<"),
    "an element that nobody documents": ("<Folder>", "<Folder><wpml:fence>1</wpml:fence>"),
    "a standstill": ("autoFlightSpeed>", "autoFlightSpeed>-"),
}


@pytest.mark.parametrize("fault", BREAKS)
def test_checker_finds_each_undocumented_change(tmp_path, fault):
    file, _ = mission_file(tmp_path)
    export_wpml(tmp_path, file)
    old, new = BREAKS[fault]
    buffer = io.BytesIO()
    with (
        zipfile.ZipFile(tmp_path / "field.kmz") as source,
        zipfile.ZipFile(buffer, "w") as target,
    ):
        for name in source.namelist():
            before = source.read(name).decode()
            assert old in before, name
            target.writestr(name, before.replace(old, new))
    assert faults_of(buffer.getvalue())
