"""Mission files, one value against the other. One fault at a time is put into a good mission."""

from __future__ import annotations

import math
import re

import pytest

from missions.errors import MissionFileError
from missions.geo.geodesy import LocalPlane
from missions.geo.grid import Grid
from missions.mission.checks import STRATEGIES, parse_mission
from missions.mission.places import homes
from missions.units import LatLon

START = LatLon(48.0, 11.0)
PLANE = LocalPlane(START)


def ring(*corners: tuple[float, float]) -> str:
    """A ring of true east and north metres from the start, as TOML."""
    places = [PLANE.to_wgs84(east, north) for east, north in corners]
    return "[" + ", ".join(f"[{p.lat_deg:.8f}, {p.lon_deg:.8f}]" for p in places) + "]"


def rectangle(west: float, south: float, east: float, north: float) -> str:
    return ring((west, south), (east, south), (east, north), (west, north))


def text(**changes: str) -> str:
    """A good mission, with some of its lines changed; dots are written as two underscores."""
    lines = {
        "start.position": f"[{START.lat_deg}, {START.lon_deg}]",
        "search.box": rectangle(0, 0, 100, 80),
        "fence.polygon": rectangle(-30, -30, 130, 110),
    } | {key.replace("__", "."): value for key, value in changes.items()}
    return "\n".join(f"{key} = {value}" for key, value in lines.items())


def faults(**changes: str) -> list[str]:
    with pytest.raises(MissionFileError) as caught:
        parse_mission(text(**changes), "m.toml")
    lines = str(caught.value).splitlines()
    assert all(line.startswith("m.toml: ") for line in lines)
    return [line.removeprefix("m.toml: ") for line in lines]


def fault(**changes: str) -> str:
    (line,) = faults(**changes)
    return line


def test_the_good_mission_is_good() -> None:
    assert parse_mission(text(), "m.toml").strategy == "rdfs"


# --- names -----------------------------------------------------------------------------------
def test_every_patch_is_found_by_swath_only() -> None:
    assert fault(search__find="'all'") == (
        'search.find = "all" is for strategy = "swath", not \'rdfs\'; leave it out, or set '
        'strategy = "swath"'
    )


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"search__altitude_m": "50"}, 'search.altitude_m = 50: is for search.find = "all"'),
        (
            {"search__find": "'all'", "search__altitude_m": "13", "strategy": "'swath'"},
            "search.altitude_m = 13: the lowest layer of the search is at 13 m, and has to be "
            "team.layer_m",
        ),
        (
            {"search__find": "'all'", "search__altitude_m": "130", "strategy": "'swath'"},
            "search.altitude_m = 130: the highest layer of the search is at 130 m, above "
            "fence.ceiling_m = 120",
        ),
    ],
)
def test_layers_of_a_search_lie_above_those_of_the_map(given: dict[str, str], said: str) -> None:
    assert fault(**given).startswith(said)


def test_an_unknown_strategy_lists_the_known_ones() -> None:
    assert fault(strategy="'rdsf'") == (
        f"strategy = 'rdsf': unknown; did you mean 'rdfs'? known: {', '.join(sorted(STRATEGIES))}"
    )


def test_an_unknown_detector_lists_the_known_ones() -> None:
    assert fault(detector__name="'x'") == "detector.name = 'x': unknown; known: paved, threshold"


def test_names_can_be_handed_in() -> None:
    mission = parse_mission(
        text(strategy="'greedy'", detector__name="'nn'"),
        "m.toml",
        strategies={"greedy"},
        detectors=["nn"],
    )
    assert (mission.strategy, mission.detector.name) == ("greedy", "nn")


# --- speeds and team -------------------------------------------------------------------------
def test_the_region_must_be_slower_than_the_vehicles() -> None:
    assert fault(drift__speed_m_s="1.0").startswith("drift.speed_m_s = 1: ")


def test_layers_must_lie_further_apart_than_the_separation() -> None:
    assert fault(team__layer_m="4.0", vehicles="[{}, {}]").startswith("team.layer_m = 4: ")


def test_a_lone_vehicle_needs_no_layers() -> None:
    parse_mission(text(team__layer_m="4.0"), "m.toml")


def test_two_vehicles_cannot_share_a_url() -> None:
    line = fault(vehicles="[{url = 'udpin://:1'}, {url = 'udpin://:2'}, {url = 'udpin://:1'}]")
    assert line.startswith("vehicles[2].url = 'udpin://:1': also the URL of vehicles[0]")


# --- places ----------------------------------------------------------------------------------
def test_beyond_the_utm_grid_is_a_fault() -> None:
    line = fault(start__position="[-80.58, 37.2]")
    assert line.startswith("start.position = [-80.58, 37.2]: latitude -80.58 is outside 80 S")
    assert "swapped?" in line


def test_a_far_box_is_taken_for_a_swapped_one() -> None:
    line = fault(search__box="[[11.0, 48.0], [11.0, 48.001], [11.001, 48.001]]")
    assert line.startswith("search.box = [11, 48]: ")
    assert line.endswith("are latitude and longitude swapped?")


def test_a_swapped_start_is_reported_against_the_others() -> None:
    assert len(faults(start__position="[11.0, 48.0]")) == 2


def test_a_far_home_is_a_fault() -> None:
    assert fault(vehicles="[{home = [11.0, 48.0]}]").startswith("vehicles[0].home = [11, 48]: ")


# --- polygons --------------------------------------------------------------------------------
BOW_TIE = ring((0, 0), (80, 80), (80, 0), (0, 80))
LINE = ring((0, 0), (10, 0), (20, 0))


@pytest.mark.parametrize(
    ("key", "changes"),
    [
        ("search.box", {"search__box": "{}"}),
        ("fence.polygon", {"fence__polygon": "{}"}),
        ("fence.holes[1]", {"fence__holes": "[" + rectangle(5, 5, 9, 9) + ", {}]"}),
        ("sim.roi[0].polygon", {"sim__roi": "[{{polygon = {}}}]"}),
        (
            "sim.roi[0].holes[0]",
            {"sim__roi": "[{{polygon = " + rectangle(-1, -1, 90, 90) + ", holes = [{}]}}]"},
        ),
    ],
)
def test_polygons_neither_cross_themselves_nor_are_flat(key: str, changes: dict[str, str]) -> None:
    def one(shape: str) -> str:
        return fault(**{name: form.format(shape) for name, form in changes.items()})

    assert one(BOW_TIE).startswith(f"{key}: crosses or touches itself")
    assert one(LINE).startswith(f"{key}: has no area")


def test_a_crossing_is_shown_in_degrees() -> None:
    found = re.search(r"near \[([\d.]+), ([\d.]+)\]", fault(search__box=BOW_TIE))
    assert found
    east_m, north_m = PLANE.to_plane(LatLon(float(found[1]), float(found[2])))
    assert math.hypot(east_m - 40, north_m - 40) < 0.5


def test_a_ring_may_repeat_its_first_corner() -> None:
    box = ring((0, 0), (80, 0), (80, 60), (0, 60), (0, 0))
    parse_mission(text(search__box=box), "m.toml")


def test_a_hole_of_the_truth_lies_in_its_polygon() -> None:
    roi = f"[{{polygon = {rectangle(0, 0, 20, 20)}, holes = [{rectangle(15, 5, 25, 9)}]}}]"
    assert fault(sim__roi=roi).startswith("sim.roi[0].holes[0]: not inside sim.roi[0].polygon")


# --- fence -----------------------------------------------------------------------------------
def test_a_box_outside_the_fence_says_by_how_much() -> None:
    line = fault(search__box=rectangle(0, 0, 140, 80))
    assert line.startswith("search.box: not inside fence.polygon (up to 10.0 m outside)")


def test_a_box_may_share_the_fence_s_edge() -> None:
    parse_mission(text(search__box=rectangle(-30, -30, 130, 110)), "m.toml")


def test_a_box_may_hold_a_hole_but_not_lie_in_one() -> None:
    parse_mission(text(fence__holes=f"[{rectangle(40, 40, 60, 60)}]"), "m.toml")
    assert fault(
        search__box=rectangle(45, 45, 55, 55), fence__holes=f"[{rectangle(40, 40, 60, 60)}]"
    ).startswith("search.box: lies wholly in fence.holes[0]")


def test_a_box_that_leaves_through_a_notch_is_outside() -> None:
    notched = ring((-30, -30), (130, -30), (130, 110), (50, 110), (50, 60), (40, 60), (-30, 110))
    assert fault(fence__polygon=notched).startswith("search.box: not inside fence.polygon")


def test_the_start_stands_inside_the_fence() -> None:
    place = PLANE.to_wgs84(-40, 0)
    line = fault(start__position=f"[{place.lat_deg}, {place.lon_deg}]")
    assert line.startswith("start.position = ")
    assert "outside fence.polygon" in line


def test_no_home_in_a_hole() -> None:
    line = fault(fence__holes=f"[{rectangle(-5, -5, 5, 5)}]")
    assert line.startswith("start.position = ")
    assert "inside fence.holes[0]" in line


def test_homes_keep_the_margin() -> None:
    place = PLANE.to_wgs84(-29, 0)
    line = fault(vehicles=f"[{{home = [{place.lat_deg}, {place.lon_deg}]}}]")
    assert line.startswith("vehicles[0].home = ")
    assert "1.0 m from the fence, nearer than fence.margin_m (2)" in line


def test_the_row_of_vehicles_must_fit_into_the_fence() -> None:
    lines = faults(vehicles="[" + ", ".join(["{}"] * 18) + "]")
    # 17 gaps of 8 m are 136 m, the fence ends at 130
    assert len(lines) == 1
    assert lines[0].startswith("vehicles[17] (in the row from the start) = ")


def test_homes_lie_apart() -> None:
    place = PLANE.to_wgs84(0, 3)
    line = fault(vehicles=f"[{{}}, {{home = [{place.lat_deg}, {place.lon_deg}]}}]")
    assert line.startswith("vehicles[1].home: 3.0 m from start.position")


def test_all_faults_come_at_once() -> None:
    assert len(faults(strategy="'x'", drift__speed_m_s="2", search__box=LINE)) == 3


# --- homes -----------------------------------------------------------------------------------
@pytest.mark.parametrize(("separation_m", "gap_m"), [("3.0", 8.0), ("5.0", 10.0)])
def test_vehicles_stand_in_a_row_towards_grid_east(separation_m: str, gap_m: float) -> None:
    changes = {"team__separation_m": separation_m, "vehicles": "[{}, {}, {}]"}
    places = homes(parse_mission(text(**changes), "m.toml"))
    grid = Grid.at(START, 4.0)
    assert places[0] == START
    for i, place in enumerate(places):
        assert grid.fixed(place) == pytest.approx((i * gap_m, 0.0), abs=1e-6)


def test_a_given_home_is_kept() -> None:
    place = PLANE.to_wgs84(0, 30)
    vehicles = f"[{{}}, {{home = [{place.lat_deg!r}, {place.lon_deg!r}]}}, {{}}]"
    found = homes(parse_mission(text(vehicles=vehicles), "m.toml"))
    assert found[1] == place
    assert Grid.at(START, 4.0).fixed(found[2]).east_m == pytest.approx(16.0, abs=1e-6)
