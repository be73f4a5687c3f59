"""The prior of a mission file: its forms, its faults, and the share of every lane."""

from __future__ import annotations

import pytest
from shapely.geometry import Polygon

from missions.errors import MissionFileError
from missions.flight.setting_of import setting_of
from missions.geo.fence import Fence
from missions.mission.checks import parse_mission
from missions.mission.places import prior_of
from missions.mission.schema import parse_fields
from missions.planning.search.lanes import lanes
from missions.planning.search.prior import EVEN_SHARE, Area, LikelyLane, Spot, likely_lanes
from missions.units import GridPoint
from tests.support.small_missions import mission_text, square
from tests.unit.missions.mission.test_mission_file import HEAD, faults
from uavmap.runner.preflight.plan_figures import first_sighting_s

BOX = [GridPoint(*xy) for xy in ((0.0, 0.0), (100.0, 0.0), (100.0, 44.0), (0.0, 44.0))]
OPEN = Fence.from_rings([GridPoint(*xy) for xy in square(-500, -500, 1000, 1000)], [], 0.0)
LANES = lanes(BOX, 4.0, OPEN)


def shown(*prior: Spot | Area) -> tuple[LikelyLane, ...]:
    return likely_lanes(LANES, BOX, prior, 4.0, 3)


def test_lane_over_a_narrow_spot_has_all_but_the_even_part():
    found = shown(Spot(GridPoint(20.0, 28.0), 1.5))
    assert found[2].probability == pytest.approx(1 - EVEN_SHARE * 0.75, abs=0.01)
    # the third lane is flown eastward; a tenth of a quarter of the probability lies evenly
    assert found[2].middle_m == pytest.approx(20.0, abs=1.0)
    assert found[2].turned.middle_m == pytest.approx(80.0, abs=1.0)


def test_weights_are_those_of_the_places_and_not_of_their_size():
    small = Area(Polygon([(0, 0), (100, 0), (100, 10), (0, 10)]), 1.0)
    large = Spot(GridPoint(50.0, 40.0), 1.5, 3.0)
    found = shown(small, large)
    rest = EVEN_SHARE / 4
    assert found[0].probability == pytest.approx(0.25 * (1 - EVEN_SHARE) + rest, abs=0.03)
    assert found[3].probability == pytest.approx(0.75 * (1 - EVEN_SHARE) + rest, abs=0.03)


def test_a_hole_of_an_area_holds_nothing():
    ring = [(0, 0), (100, 0), (100, 44), (0, 44)]
    cut = Polygon(ring, [[(-0.0, 10.0), (100, 10), (100, 34), (0, 34)]])
    found = shown(Area(cut))
    assert found[1].probability < found[0].probability / 4


def test_lanes_of_a_box_along_north_have_the_same_weights():
    turned = [GridPoint(p.north_m, p.east_m) for p in BOX]
    along_north = likely_lanes(
        lanes(turned, 4.0, OPEN), turned, [Spot(GridPoint(28.0, 20.0), 1.5)], 4.0, 3
    )
    straight = shown(Spot(GridPoint(20.0, 28.0), 1.5))
    assert [lane.probability for lane in along_north] == pytest.approx(
        [lane.probability for lane in straight], abs=1e-9
    )


def test_place_that_no_lane_shows_is_left_out():
    (only,) = likely_lanes(LANES[:1], BOX, [Spot(GridPoint(50.0, 40.0), 3.0)], 4.0, 3)
    assert only.probability == pytest.approx(1.0)
    assert only.middle_m == pytest.approx(50.0, abs=1.0)


# --- the key ---------------------------------------------------------------------------------
def test_a_position_alone_is_a_list_of_one_place():
    short = parse_fields(HEAD + "search.prior = [48.0005, 11.0005]\n", "m.toml")
    long = parse_fields(HEAD + "search.prior = [{position = [48.0005, 11.0005]}]\n", "m.toml")
    assert short.search.prior == long.search.prior
    assert parse_fields(HEAD, "m.toml").search.prior == ()


def test_a_point_without_a_spread_has_half_of_the_shorter_side():
    mission = parse_mission(HEAD + "search.prior = [48.0005, 11.0005]\n", "m.toml")
    (spot,) = prior_of(mission, setting_of(mission).grid)
    assert isinstance(spot, Spot)
    assert spot.spread_m == pytest.approx(37.3, abs=1.5)  # 0.001 degrees of longitude, turned


FAULTS = {
    "[]": "at least 1",
    "[98.0, 11.0]": "search.prior[0].position[0] = 98.0: input should be less",
    '"where.geojson"': "search.prior = 'where.geojson': a GeoJSON file is read only beside",
    "[{weight = 2.0}]": "search.prior[0]: give it either a position or a polygon",
    "[{position = [48.0, 11.0], weight = 0}]": "search.prior[0].weight = 0: input should be gr",
    "[{position = [48.0, 11.0], spread_m = -1}]": "search.prior[0].spread_m = -1: input should",
    "[{position = [48.0, 11.0], wait = 1}]": "search.prior[0].wait: unknown key; did you mean 'we",
    "[{polygon = [[48.0, 11.0], [48.0, 11.1]]}]": "search.prior[0].polygon: 2 given, at least 3",
}


@pytest.mark.parametrize("value", FAULTS)
def test_a_fault_names_key_value_and_remedy(value):
    (line,) = faults(HEAD + f"search.prior = {value}\n")
    assert FAULTS[value] in line


RING = "[[48.0002, 11.0002], [48.0002, 11.0008], [48.0008, 11.0008]]"
OF_THE_WHOLE = {
    "[48.1, 11.0]": "search.prior: lies outside of search.box; move it, widen its spread_m",
    "[11.0005, 48.0005]": "are latitude and longitude swapped?",
    f"[{{polygon = {RING}, holes = [[[48.5, 11.0], [48.5, 11.001], [48.501, 11.0]]]}}]": "km from",
    f"[{{polygon = {RING}, holes = [[[48.0, 11.0], [48.0, 11.001], [48.001, 11.0]]]}}]": (
        "search.prior[0].holes: not inside search.prior[0].polygon"
    ),
    "[{polygon = [[48.0, 11.0], [48.001, 11.001], [48.001, 11.0], [48.0, 11.0012]]}]": (
        "search.prior[0].polygon: crosses or touches itself"
    ),
}


@pytest.mark.parametrize("value", OF_THE_WHOLE)
def test_a_prior_must_have_to_do_with_the_box(value):
    with pytest.raises(MissionFileError) as caught:
        parse_mission(HEAD + f"search.prior = {value}\n", "m.toml")
    assert OF_THE_WHOLE[value] in str(caught.value)


def test_one_place_in_the_box_is_enough():
    text = HEAD + "search.prior = [{position = [48.1, 11.0]}, {position = [48.0, 11.0]}]\n"
    assert len(parse_mission(text, "m.toml").search.prior) == 2


def test_mission_without_a_prior_has_no_expected_time_of_sighting():
    text = mission_text(square(0, 0, 60, 40), square(-60, -60, 200, 200))
    setting = setting_of(parse_mission(text, "m.toml"))
    assert setting.likely == ()
    assert first_sighting_s(setting) is None
