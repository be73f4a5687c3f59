from __future__ import annotations

import math
from dataclasses import replace
from importlib import resources

import cv2
import numpy as np
import pytest

from missions.errors import MissionFileError, UavmapError
from missions.mission.checks import parse_mission
from missions.units import Quaternion
from sitl.camera.pinhole import Shot
from sitl.camera.render import render
from sitl.scenario import Setup
from sitl.world.tags import DICTIONARIES, TAG_OVER_FEET_M, TagPose, modules
from sitl.world.world import World, WorldSpec
from tests.unit.sitl.conftest import CAMERA, LENS_M, ORIGIN, decoded
from uavmap.runner.simulation import setup_of

PLAIN = WorldSpec(
    ORIGIN, 600.0, (), texture=0.0, sensor_noise=0.0, illumination=0.0, tag_m=1.2, seed=1
)


def shot(*tags, height_m=30.0, **changes):
    level = CAMERA.attitude(0.0, 0.0, 0.0)
    return replace(Shot(0.0, 0.0, height_m - LENS_M, level, 0.0, 0, tags=tags), **changes)


def tag(east_m=0.0, north_m=0.0, below_m=10.0, roll_deg=0.0, pitch_deg=0.0, yaw_deg=0.0, number=1):
    turned = Quaternion.from_euler(*map(math.radians, (roll_deg, pitch_deg, yaw_deg)))
    return TagPose(number, east_m, north_m, 30.0 - below_m, turned)


def gray(spec, taken):
    return decoded(render(World(spec), CAMERA, taken))


def extent(dark):
    rows, columns = dark.nonzero()
    return columns.min(), columns.max(), rows.min(), rows.max()


def test_pictures_without_a_marker_have_the_same_bytes():
    none = replace(PLAIN, tag_m=0.0)
    taken = render(World(none), CAMERA, shot())
    assert render(World(PLAIN), CAMERA, shot()) == taken
    # a marker beside the picture, behind the camera, or seen from below changes no byte either
    away = tag(east_m=50.0), tag(below_m=-3.0), tag(roll_deg=120.0)
    assert render(World(PLAIN), CAMERA, shot(*away)) == taken


def test_a_marker_is_where_it_should_be():
    # 2 m east, 3 m north: 40 px right of the middle, 60 px above; the black square is 24 px wide
    picture = gray(PLAIN, shot(tag(east_m=2.0, north_m=3.0)))
    assert extent(picture < 70) == pytest.approx((228, 251, 78, 101), abs=1)
    # the margin is a module of 4 px, brighter than the ground
    assert picture[89, 224:227].min() > 215
    assert picture[89, 220:222].max() < 205


def test_upper_edge_of_a_marker_is_towards_the_nose():
    large = replace(PLAIN, tag_m=6.0)  # modules of 20 px
    for quarters in range(4):
        seen = gray(large, shot(tag(yaw_deg=90.0 * quarters)))[70:230, 120:280]
        read = (seen[10::20, 10::20] > 130).astype(np.uint8)
        assert (np.rot90(read, quarters) == modules("DICT_4X4_50", 1)).all()


def test_tilted_marker_is_foreshortened():
    left, right, top, bottom = extent(gray(PLAIN, shot(tag(roll_deg=60.0))) < 70)
    assert right - left + 1 == pytest.approx(12, abs=2)
    assert bottom - top + 1 == pytest.approx(24, abs=2)


def test_higher_marker_hides_a_lower_one():
    high, low = tag(below_m=10.0, number=1), tag(below_m=20.0, number=2)
    only = gray(PLAIN, shot(high))
    assert np.abs(gray(PLAIN, shot(low, high)).astype(int) - only)[130:170, 180:220].max() <= 3
    assert (gray(PLAIN, shot(high, low)) == gray(PLAIN, shot(low, high))).all()


def test_marker_is_blurred_by_its_own_motion():
    camera_moves = 0.2  # m in an exposure: 4 px over a marker 10 m below
    along = (camera_moves / CAMERA.exposure_s, 0.0, 0.0)
    moving = {"moved_m": (camera_moves, 0.0, 0.0)}
    with_it = gray(PLAIN, shot(replace(tag(), velocity_m_s=along), **moving))
    left_behind = gray(PLAIN, shot(tag(), **moving))
    sharp = gray(PLAIN, shot(tag()))

    def steepest(picture):
        return np.abs(np.diff(picture[140, 180:220].astype(int))).max()

    assert steepest(with_it) > 0.9 * steepest(sharp)
    assert steepest(left_behind) < 0.6 * steepest(sharp)


@pytest.mark.parametrize("dictionary", DICTIONARIES)
def test_painted_marker_is_read_by_opencv(dictionary):
    large = replace(PLAIN, tag_m=3.0, tag_dictionary=dictionary)
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    picture = gray(large, shot(tag(number=7, yaw_deg=33.0)))
    _, numbers, _ = cv2.aruco.ArucoDetector(known).detectMarkers(picture)
    assert numbers.ravel().tolist() == [7]


def test_a_number_that_the_dictionary_lacks_is_refused():
    with pytest.raises(UavmapError, match="vehicle 50: DICT_4X4_50 has markers up to 49"):
        Setup(vehicles=50, tag_m=0.4).build()
    with pytest.raises(UavmapError, match="tag_dictionary 'QR': there is DICT_4X4_50"):
        Setup(tag_m=0.4, tag_dictionary="QR").build()
    assert len(Setup(vehicles=50, tag_m=0.4, tag_dictionary="DICT_4X4_100").build()) == 50


def test_marker_of_a_vehicle_is_where_it_is_at_the_exposure_of_another():
    """Vehicles are stepped one after the other; the first exposes at its own time."""
    first, second = Setup(vehicles=2, tag_m=0.4).build()
    first.step(0.05)
    (seen,) = first.world.carriers.others(1, first.t_s)
    east, north = first.world.plane.to_plane(second.truth.position)
    place = (seen.number, seen.east_m, seen.north_m, seen.up_m)
    assert place == pytest.approx((2, east, north, TAG_OVER_FEET_M))
    assert Setup(vehicles=2).build()[0].world.carriers.others(1, 0.0) == ()


def test_a_mission_file_turns_markers_on():
    shipped = resources.files("missions.shipped").joinpath("runway.toml").read_text("utf-8")
    assert setup_of(parse_mission(shipped, "runway"), seed=1).tag_m == 0.0
    marked = shipped.replace("[sim]", '[sim]\ntag_m = 0.4\ntag_dictionary = "DICT_5X5_50"')
    setup = setup_of(parse_mission(marked, "runway"), seed=1)
    assert (setup.tag_m, setup.tag_dictionary) == (0.4, "DICT_5X5_50")
    with pytest.raises(MissionFileError, match=r"sim\.tag_m"):
        parse_mission(marked.replace("tag_m = 0.4", "tag_m = -1"), "runway")
