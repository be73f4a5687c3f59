"""Zones of files and the fence of a mission: which become holes, do not matter, or are refused."""

import json
import re
import shutil
from pathlib import Path

import pytest
from shapely.geometry import Point

from missions.errors import MissionFileError
from missions.geo.grid import Grid
from missions.mission import flyable
from missions.mission.flyable import fence_of
from missions.mission.places import grid_of
from missions.units import GridPoint
from tests.support.small_missions import START, mission_text, square
from uavmap.load.areas.zones import CORNERS
from uavmap.load.mission_source import load
from uavmap.runner.preflight.plan_figures import zone_lines

ED269 = Path(__file__).parents[4] / "data" / "zones-ed269.json"
GRID = Grid.at(START, 4.0)
FENCE = square(-40, -40, 160, 160)


def write(folder, *features, keys="", start="", own="", **root):
    """Write a mission beside a file of zones; return it loaded."""
    if features:
        values = {"type": "FeatureCollection", "features": list(features), **root}
        (folder / "zones.json").write_text(json.dumps(values), "utf-8")
    text = mission_text(square(20, 20, 60, 60), FENCE, holes=[square(-30, 90, 10, 10)])
    text = text.replace("[fence]\n", f'[fence]\nzones = "zones.json"\n{keys}')
    text = text.replace("[start]\n", f"[start]\n{start}")
    if own:
        text = re.sub(r"^ *holes = .*$", own, text, count=1, flags=re.MULTILINE)
    path = folder / "field.toml"
    path.write_text(text, "utf-8")
    return load(str(path))


def lon_lat(points):
    places = [GRID.position(GridPoint(*point)) for point in (*points, next(iter(points)))]
    return [[place.lon_deg, place.lat_deg] for place in places]


def plain(points, **properties):
    geometry = {"type": "Polygon", "coordinates": [lon_lat(points)]}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def layered(points, *, lower, reference, uom="m", name="Layer"):
    """Return a feature of ED-318."""
    layer = {"lower": lower, "lowerReference": reference, "upper": 9000, "uom": uom}
    feature = plain(points, identifier="T1", type="PROHIBITED", variant="COMMON")
    feature["properties"]["name"] = [
        {"text": "Schicht", "lang": "de-DE"},
        {"text": name, "lang": "en-GB"},
    ]
    return {**feature, "geometry": {**feature["geometry"], "layer": layer}}


def holes(mission):
    return fence_of(mission, grid_of(mission)).outer.interiors


def allows(mission, east_m, north_m):
    return fence_of(mission, grid_of(mission)).contains(GridPoint(east_m, north_m))


def test_file_of_an_authority_becomes_holes_and_lines_with_names(tmp_path):
    shutil.copy(ED269, tmp_path / "zones.json")
    mission = write(tmp_path)
    pump, birds, sector = zone_lines(mission)
    assert pump == (
        "zone 'Pump house': prohibited, from 0 m AGL to 120 m AGL; in zones.json: the fence leaves "
        "it out"
    )
    assert "at some times only, which counts as always" in birds
    assert birds.startswith("zone 'Birds': conditional, from 0 m AGL to 149.96 m AMSL")
    assert sector.endswith("it begins above fence.ceiling_m, and does not matter")
    assert len(holes(mission)) == 3  # and that of the mission
    assert not allows(mission, 21.5, 59.5)
    assert not allows(mission, 80.0, 15.0)
    assert allows(mission, 0.0, 0.0)


def test_circle_is_left_out_as_a_whole_and_hardly_more(tmp_path):
    centre = lon_lat([(60.0, 60.0)])[0]
    circle = {"type": "Point", "coordinates": centre, "extent": {"subType": "Circle", "radius": 20}}
    feature = {"type": "Feature", "properties": {"name": "Mast"}, "geometry": circle}
    mission = write(tmp_path, feature)
    outer = fence_of(mission, grid_of(mission)).outer
    assert not outer.intersects(Point(60.0, 60.0).buffer(19.99))
    assert len(holes(mission)) == 2
    assert max(len(ring.coords) for ring in holes(mission)) == CORNERS + 1


def test_zone_over_the_rim_of_the_fence_is_a_hole_inside_of_it(tmp_path):
    mission = write(tmp_path, plain(square(90, -100, 300, 150), name="Road"))
    fence = fence_of(mission, grid_of(mission))
    assert fence.outer.is_valid
    assert not fence.contains(GridPoint(100.0, 0.0))
    assert fence.route(GridPoint(0.0, 0.0), GridPoint(100.0, 0.0)) is None
    assert fence.route(GridPoint(0.0, 0.0), GridPoint(100.0, 100.0)) is not None


def test_zones_that_overlap_each_other_and_a_hole_are_one_hole(tmp_path):
    one, two = plain(square(60, 60, 30, 10), name="A"), plain(square(70, 50, 10, 30), name="B")
    three = plain(square(-35, 95, 10, 10), name="C")
    mission = write(tmp_path, one, two, three)
    assert fence_of(mission, grid_of(mission)).outer.is_valid
    assert len(holes(mission)) == 2
    assert mission.fence.zones[0].holes == mission.fence.zones[1].holes


@pytest.mark.parametrize(
    ("lower", "reference", "start", "counts"),
    [
        (119.9, "AGL", "", True),
        (120.0, "AGL", "", False),
        (700.0, "AMSL", "", True),  # the height of the start is unknown
        (620.0, "AMSL", "amsl_m = 500.0\n", False),
        (619.0, "AMSL", "amsl_m = 500.0\n", True),
        (700.0, "WGS84", "amsl_m = 500.0\n", True),
        (710.0, "WGS84", "amsl_m = 500.0\n", False),
        (500.0, "SFC", "", True),
        (5000.0, "SFC", "amsl_m = 500.0\n", False),
        (None, "AGL", "", True),
        ("high", "AGL", "", True),
    ],
)
def test_zone_matters_unless_it_begins_above_the_ceiling(tmp_path, lower, reference, start, counts):
    feature = layered(square(60, 60, 20, 20), lower=lower, reference=reference)
    mission = write(tmp_path, feature, start=start)
    (zone,) = mission.fence.zones
    assert (zone.name, zone.effect) == ("Layer", "hole" if counts else "above")
    assert len(holes(mission)) == 1 + counts


def test_limits_in_feet_are_converted_and_an_unknown_unit_is_a_hole(tmp_path):
    area = square(60, 60, 20, 20)
    feet = write(tmp_path, layered(area, lower=390, reference="AGL", uom="ft"))
    assert feet.fence.zones[0].effect == "hole"  # 118.9 m
    higher = write(tmp_path, layered(area, lower=394, reference="AGL", uom="ft"))
    assert higher.fence.zones[0].effect == "above"
    levels = write(tmp_path, layered(area, lower=394, reference="AGL", uom="FL"))
    assert levels.fence.zones[0].effect == "hole"


def test_zone_allowed_by_the_mission_is_no_hole_and_is_named(tmp_path):
    feature = plain(square(60, 60, 20, 20), name="Mine")
    mission = write(tmp_path, feature, keys='allowed_zones = ["Mine"]\n')
    assert len(holes(mission)) == 1
    assert zone_lines(mission)[0].endswith("it is flown in, by fence.allowed_zones")


@pytest.mark.parametrize(
    ("area", "refused"),
    [
        (square(-10, -10, 20, 20), "start.position = [48, 11]: inside zone 'Farm'"),
        (square(1, -50, 20, 100), "1.0 m from zone 'Farm'"),
        (square(10, 10, 200, 200), "search.box: lies wholly in zone 'Farm'"),
        (square(5, -50, 8, 200), "with zone 'Farm' leave no part of it"),
        (square(-900, -900, 2000, 2000), "inside zone 'Farm'"),
    ],
)
def test_zone_that_leaves_no_mission_refuses_it_by_name(tmp_path, area, refused):
    with pytest.raises(MissionFileError, match=r"field\.toml") as error:
        write(tmp_path, plain(area, name="Farm"))
    assert refused in str(error.value)


def test_zone_that_cuts_off_a_part_of_the_box_is_named_in_the_warning(tmp_path):
    mission = write(tmp_path, plain(square(40, 40, 20, 20), name="Farm"))
    (warning,) = (w for w in flyable.warnings(mission, grid_of(mission)) if "search.box" in w)
    assert "with zone 'Farm' cut them off" in warning


@pytest.mark.parametrize(
    ("content", "refused"),
    [
        ("[1, 2", "not JSON"),
        ("[]", "no list of features"),
        ('{"features": [7]}', "features[0]: no feature"),
        ('{"features": [{"geometry": {"type": "Polygon", "coordinates": [[[11, 48]]]}}]}', "three"),
        ('{"features": [{"geometry": {"type": "Curve"}}]}', "geometry of type 'Curve'"),
        (
            '{"features": [{"geometry": {"type": "Point", "coordinates": [480, 11], '
            '"extent": {"radius": 5}}}]}',
            "check whether they are swapped",
        ),
        (
            '{"features": [{"geometry": [{"horizontalProjection": {"type": "Circle", '
            '"center": [11, 48], "radius": 0}}]}]}',
            "radius = 0",
        ),
        (
            '{"features": [{"properties": {"type": "PROHIBITED", "radius": 500}, "geometry": '
            '{"type": "Point", "coordinates": [11, 48]}}]}',
            "a zone without an area",
        ),
        ('{"features": [{"restriction": "PROHIBITED", "geometry": []}]}', "a zone without an area"),
        (
            '{"features": [{"geometry": [{"horizontalProjection": {"type": "Circle", '
            f'"center": [11, 48], "radius": {10**400}}}}}]}}]}}',
            "give a number",
        ),
        (
            '{"crs": {"type": "name", "properties": {"name": "EPSG:25832"}}, "features": []}',
            "WGS84",
        ),
    ],
)
def test_file_that_is_not_understood_refuses_the_mission(tmp_path, content, refused):
    (tmp_path / "zones.json").write_text(content, "utf-8")
    with pytest.raises(MissionFileError) as error:
        write(tmp_path)
    text = str(error.value)
    assert text.startswith(f"{tmp_path / 'field.toml'}:")
    assert refused in text
    assert "fence.zones: 'zones.json'" in text


def test_file_that_is_missing_refuses_the_mission(tmp_path):
    with pytest.raises(MissionFileError, match="cannot be read"):
        write(tmp_path)


@pytest.mark.parametrize("crs", [None, {"type": "name", "properties": {"name": "EPSG:4326"}}])
def test_file_that_names_its_degrees_is_read(tmp_path, crs):
    mission = write(tmp_path, plain(square(20, 20, 10, 10), name="Pond"), crs=crs)
    assert not allows(mission, 25, 25)


def test_limit_without_a_unit_counts_as_from_the_ground(tmp_path):
    high = layered(square(20, 20, 10, 10), lower=500, reference="AGL", uom=None)
    assert not allows(write(tmp_path, high), 25, 25)


def test_own_hole_that_crosses_itself_is_left_to_the_check_of_places(tmp_path):
    bow = [[48.0001, 11.0001], [48.0002, 11.0002], [48.0001, 11.0002], [48.0002, 11.0001]]
    zone = plain(square(20, 20, 10, 10), name="Pond")
    with pytest.raises(MissionFileError, match=r"fence.holes\[0\]: crosses"):
        write(tmp_path, zone, own=f"holes = [{bow}]")


def test_circle_beyond_the_antimeridian_is_a_hole(tmp_path):
    ring = lambda d: [[-17.0 - d, 179.99 - d], [-17.0 - d, 179.99 + d],  # noqa: E731
                      [-17.0 + d, 179.99 + d], [-17.0 + d, 179.99 - d]]  # fmt: skip
    (tmp_path / "field.toml").write_text(
        "[start]\nposition = [-17.0, 179.99]\n"
        f"[search]\nbox = {ring(0.0005)}\n[fence]\npolygon = {ring(0.001)}\nzones = 'zones.json'\n"
    )
    circle = {"type": "Circle", "center": [-179.99, -17.0], "radius": 2200.0}
    zone = {"name": "Atoll", "geometry": [{"horizontalProjection": circle}]}
    (tmp_path / "zones.json").write_text(json.dumps({"features": [zone]}), "utf-8")
    with pytest.raises(MissionFileError, match="Atoll"):  # it reaches the start, 2,128 m away
        load(str(tmp_path / "field.toml"))
