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
    """Return a ring of true east and north metres from the start, as TOML."""
    places = [PLANE.to_wgs84(east, north) for east, north in corners]
    return "[" + ", ".join(f"[{p.lat_deg:.8f}, {p.lon_deg:.8f}]" for p in places) + "]"


def rectangle(west: float, south: float, east: float, north: float) -> str:
    return ring((west, south), (east, south), (east, north), (west, north))


def text(**changes: str) -> str:
    """Return a good mission with some of its lines changed; two underscores stand for a dot."""
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


def place(east: float, north: float) -> str:
    """Return a position of true east and north metres from the start, as TOML."""
    at = PLANE.to_wgs84(east, north)
    return f"[{at.lat_deg}, {at.lon_deg}]"


ALL = {"search__find": "'all'", "strategy": "'swath'"}
NOTCHED = ring((-30, -30), (130, -30), (130, 110), (50, 110), (50, 60), (40, 60), (-30, 110))
HOLE = f"[{rectangle(40, 40, 60, 60)}]"
SIM_HOLE = f"[{{polygon = {rectangle(0, 0, 20, 20)}, holes = [{rectangle(15, 5, 25, 9)}]}}]"
SHARED_URL = "[{url = 'udpin://:1'}, {url = 'udpin://:2'}, {url = 'udpin://:1'}]"
FAULTS = {
    "every patch is found by swath only": (
        {"search__find": "'all'"},
        'search.find = "all" is for strategy = "swath", not \'rdfs\'; leave it out, or set '
        'strategy = "swath"',
    ),
    "layers of a search are for find all": (
        {"search__altitude_m": "50"}, 'search.altitude_m = 50: is for search.find = "all"',
    ),
    "the search is above the map": (
        {**ALL, "search__altitude_m": "13"},
        "search.altitude_m = 13: the lowest layer of the search is at 13 m, and has to be "
        "team.layer_m",
    ),
    "the search is below the ceiling": (
        {**ALL, "search__altitude_m": "130"},
        "search.altitude_m = 130: the highest layer of the search is at 130 m, above "
        "fence.ceiling_m = 120",
    ),
    "an unknown strategy lists the known ones": (
        {"strategy": "'rdsf'"},
        "strategy = 'rdsf': unknown; did you mean 'rdfs'? known: " + ", ".join(sorted(STRATEGIES)),
    ),
    "an unknown detector lists the known ones": (
        {"detector__name": "'x'"}, "detector.name = 'x': unknown; known: paved, threshold",
    ),
    "a region slower than the vehicles": ({"drift__speed_m_s": "1.0"}, "drift.speed_m_s = 1: "),
    "layers farther apart than the separation": (
        {"team__layer_m": "4.0", "vehicles": "[{}, {}]"}, "team.layer_m = 4: ",
    ),
    "a URL of one vehicle only": (
        {"vehicles": SHARED_URL}, "vehicles[2].url = 'udpin://:1': also the URL of vehicles[0]",
    ),
    "beyond the UTM grid": (
        {"start__position": "[-80.58, 37.2]"},
        "start.position = [-80.58, 37.2]: latitude -80.58 is outside 80 S", "swapped?",
    ),
    "a far box is taken for a swapped one": (
        {"search__box": "[[11.0, 48.0], [11.0, 48.001], [11.001, 48.001]]"},
        "search.box = [11, 48]: ", "are latitude and longitude swapped?",
    ),
    "a far home": ({"vehicles": "[{home = [11.0, 48.0]}]"}, "vehicles[0].home = [11, 48]: "),
    "a hole of the truth in its polygon": (
        {"sim__roi": SIM_HOLE}, "sim.roi[0].holes[0]: not inside sim.roi[0].polygon",
    ),
    "a box outside the fence": (
        {"search__box": rectangle(0, 0, 140, 80)},
        "search.box: not inside fence.polygon (up to 10.0 m outside)",
    ),
    "a box in a hole": (
        {"search__box": rectangle(45, 45, 55, 55), "fence__holes": HOLE},
        "search.box: lies wholly in fence.holes[0]",
    ),
    "a box through a notch": ({"fence__polygon": NOTCHED}, "search.box: not inside fence.polygon"),
    "a start inside the fence": (
        {"start__position": place(-40, 0)}, "start.position = ", "outside fence.polygon",
    ),
    "no home in a hole": (
        {"fence__holes": f"[{rectangle(-5, -5, 5, 5)}]"},
        "start.position = ", "inside fence.holes[0]",
    ),
    "homes keep the margin": (
        {"vehicles": f"[{{home = {place(-29, 0)}}}]"},
        "vehicles[0].home = ", "1.0 m from the fence, nearer than fence.margin_m (2)",
    ),
    # 17 gaps of 8 m are 136 m, the fence ends at 130
    "the row of vehicles in the fence": (
        {"vehicles": "[" + ", ".join(["{}"] * 18) + "]"},
        "vehicles[17] (in the row from the start) = ",
    ),
    "homes lie apart": (
        {"vehicles": f"[{{}}, {{home = {place(0, 3)}}}]"},
        "vehicles[1].home: 3.0 m from start.position",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("changes", "begin", "more"), [(c, b, m) for c, b, *m in FAULTS.values()],
                         ids=list(FAULTS))  # fmt: skip
def test_a_fault_is_one_line_that_names_the_key(changes, begin, more):
    line = fault(**changes)
    assert line.startswith(begin)
    assert all(part in line for part in more)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"team__layer_m": "4.0"},  # a lone vehicle needs no layers
        {"search__box": ring((0, 0), (80, 0), (80, 60), (0, 60), (0, 0))},  # a repeated corner
        {"search__box": rectangle(-30, -30, 130, 110)},  # the fence's edge
        {"fence__holes": HOLE},  # a hole in the box
    ],
)
def test_a_good_mission_is_good(changes):
    assert parse_mission(text(**changes), "m.toml").strategy == "rdfs"


# --- places ----------------------------------------------------------------------------------
def test_a_swapped_start_is_reported_against_the_others():
    assert len(faults(start__position="[11.0, 48.0]")) == 2


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
def test_polygons_neither_cross_themselves_nor_are_flat(key, changes):
    def one(shape: str) -> str:
        return fault(**{name: form.format(shape) for name, form in changes.items()})

    assert one(BOW_TIE).startswith(f"{key}: crosses or touches itself")
    assert one(LINE).startswith(f"{key}: has no area")


def test_a_crossing_is_shown_in_degrees():
    found = re.search(r"near \[([\d.]+), ([\d.]+)\]", fault(search__box=BOW_TIE))
    assert found
    east_m, north_m = PLANE.to_plane(LatLon(float(found[1]), float(found[2])))
    assert math.hypot(east_m - 40, north_m - 40) < 0.5


def test_all_faults_come_at_once():
    assert len(faults(strategy="'x'", drift__speed_m_s="2", search__box=LINE)) == 3


# --- homes -----------------------------------------------------------------------------------
@pytest.mark.parametrize(("separation_m", "gap_m"), [("3.0", 8.0), ("5.0", 10.0)])
def test_vehicles_stand_in_a_row_towards_grid_east(separation_m, gap_m):
    changes = {"team__separation_m": separation_m, "vehicles": "[{}, {}, {}]"}
    places = homes(parse_mission(text(**changes), "m.toml"))
    grid = Grid.at(START, 4.0)
    assert places[0] == START
    for i, place in enumerate(places):
        assert grid.fixed(place) == pytest.approx((i * gap_m, 0.0), abs=1e-6)


def test_a_given_home_is_kept():
    place = PLANE.to_wgs84(0, 30)
    vehicles = f"[{{}}, {{home = [{place.lat_deg!r}, {place.lon_deg!r}]}}, {{}}]"
    found = homes(parse_mission(text(vehicles=vehicles), "m.toml"))
    assert found[1] == place
    assert Grid.at(START, 4.0).fixed(found[2]).east_m == pytest.approx(16.0, abs=1e-6)
