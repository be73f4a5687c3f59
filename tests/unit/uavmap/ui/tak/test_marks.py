"""Marks for TAK: types, names, colours, rings, motion. No socket."""

import math
from xml.etree import ElementTree as ET

import pytest
from shapely.geometry import Point

from tests.support.page.board_flight import RING, BoardFlight, record
from uavmap.output.drawing import palette
from uavmap.ui.tak.marks import (
    AIRCRAFT,
    MAX_POINTS,
    MAX_RINGS,
    OTHER,
    OTHER_DRONE,
    Marks,
    argb,
)
from uavmap.ui.tak.outbox import Outbox


def detail(mark):
    return ET.fromstring(mark.detail)


def by_name(marks):
    return {mark.uid[len("uavmap-") + 37 :]: mark for mark in marks}


def places(mark):
    return [link.attrib["point"] for link in detail(mark).iter("link")]


def test_aircraft_flying_has_type_course_speed_and_any_known_height():
    flight, marks = BoardFlight(), Marks(simulated=False, utc_s=lambda: 100.0)
    flight.board.set_vehicle(2, record(at_s=10.0, e=0.0, n=0.0))
    list(marks.aircraft(flight.live()))
    flight.board.set_vehicle(2, record(at_s=11.0, e=-5.0, n=0.0))
    (mark,) = marks.aircraft(flight.live())
    assert (mark.cot_type, mark.how, mark.fix_utc_s) == (AIRCRAFT, "m-g", 100.0)
    assert detail(mark).find("contact").attrib["callsign"] == "runway 2"
    motion = {k: float(v) for k, v in detail(mark).find("track").attrib.items()}
    grid = flight.live().grid
    west_deg = 270.0 + math.degrees(grid.convergence_rad)
    assert motion == {"course": pytest.approx(west_deg, abs=0.06), "speed": 5.0}
    words = detail(mark).findtext("remarks")
    assert words == "flying; 12 m above home; 512 m above mean sea level; battery 80 %"
    assert detail(mark).find("status").attrib["battery"] == "80"


def test_aircraft_that_stands_keeps_its_course_and_a_silent_one_has_none():
    flight, marks = BoardFlight(), Marks(simulated=False)
    for at_s, north_m in ((10.0, 0.0), (11.0, 4.0), (12.0, 4.1)):
        flight.board.set_vehicle(1, record(at_s=at_s, n=north_m))
        (mark,) = marks.aircraft(flight.live())
    motion = detail(mark).find("track").attrib
    assert motion["speed"] == "0.1"
    assert math.cos(math.radians(float(motion["course"]))) > 0.99
    flight.board.set_vehicle(1, record(at_s=30.0, n=80.0))
    (mark,) = marks.aircraft(flight.live())
    assert detail(mark).find("track") is None


def test_aircraft_without_a_new_fix_keeps_the_time_of_its_fix():
    flight, now = BoardFlight(), iter(range(100, 200))
    marks = Marks(simulated=False, utc_s=lambda: float(next(now)))
    flight.board.set_vehicle(1, record())
    (first,) = marks.aircraft(flight.live())
    flight.board.set_vehicle(1, record(doing="flying home"))
    (second,) = marks.aircraft(flight.live())
    assert (first.fix_utc_s, second.fix_utc_s) == (100.0, 100.0)
    assert first != second


def test_aircraft_that_never_answered_is_not_sent():
    flight = BoardFlight()
    flight.board.set_vehicle(1, record(phase="offline", at_s=0.0))
    assert not list(Marks(simulated=False).aircraft(flight.live()))


@pytest.mark.parametrize(
    ("landed", "words", "fix"),
    [(True, "landed; the flight is over", False), (False, "last known place; the flight", True)],
)
def test_aircraft_at_the_end_is_landed_or_last_known(landed, words, fix):
    flight = BoardFlight()
    flight.board.set_vehicle(1, record(landed=landed))
    (mark,) = Marks(simulated=False).aircraft(flight.live(), "the flight is over")
    assert detail(mark).findtext("remarks").startswith(words)
    assert (mark.fix_utc_s is not None) == fix
    assert mark.stale_s == (60 if landed else 15)


def test_simulated_flight_is_marked_everywhere():
    flight = BoardFlight()
    flight.board.set_vehicle(1, record())
    flight.cells("explored", (0, 0))
    marks = Marks(simulated=True)
    live = flight.live()
    for mark in (marks.unit(live), *marks.aircraft(live), *marks.shapes(live)):
        assert mark.how == "m-s"
        assert detail(mark).find("contact").attrib["callsign"].startswith("SIM runway")
        assert detail(mark).findtext("remarks").startswith("simulated")


def test_region_with_a_hole_is_two_closed_rings_without_fill():
    flight = BoardFlight()
    flight.cells("explored", *RING)
    flight.cells("unsure", (1, 1), (9, 9))
    found = by_name(Marks(simulated=False).shapes(flight.live()))
    assert list(found) == ["region-1", "region-1-hole-1", "unsure-1", "unsure-2"]
    for name, corners in (("region-1", 5), ("region-1-hole-1", 5), ("unsure-1", 5)):
        points = places(found[name])
        assert len(points) == corners
        assert points[0] == points[-1]
        assert found[name].cot_type == "u-d-f"
        assert found[name].stale_s == 24 * 3600
    region, unsure = detail(found["region-1"]), detail(found["unsure-1"])
    assert region.find("strokeColor").attrib["value"] == str(argb(palette.OUTLINE))
    assert region.find("fillColor") is None
    colour = palette.STATES["unsure"]
    assert unsure.find("fillColor").attrib["value"] == str(argb(colour, 64))
    assert detail(found["region-1-hole-1"]).find("strokeStyle").attrib["value"] == "dashed"
    assert region.findtext("remarks") == "128 m²; 128 m² in all; exploring"


def test_largest_piece_is_the_first_and_the_smallest_are_left_out():
    flight = BoardFlight()
    flight.cells("explored", *((5 * k, 0) for k in range(50)), (100, 1))
    found = by_name(Marks(simulated=False).shapes(flight.live()))
    assert len(found) == MAX_RINGS
    words = detail(found["region-1"]).findtext("remarks")
    assert words.startswith("32 m²; 816 m² in all")
    assert words.endswith("the 40 largest of 50 rings")


def test_lines_are_thinned_and_a_path_begins_at_its_vehicle():
    flight = BoardFlight()
    flight.board.set_vehicle(1, record(e=100.0, n=0.0))
    for k in range(3000):  # 300 lanes of 20 m, a point every 2 m
        lane, along_m = divmod(2.0 * k, 20.0)
        flight.board.add_point(1, along_m if lane % 2 else 18.0 - along_m, 2.0 * lane)
    flight.board.set_field("path 1", [1e9, 120.0, 0.0, 1e9, 120.0, 30.0])
    found = by_name(Marks(simulated=False).shapes(flight.live()))
    assert list(found) == ["track-1", "path-1"]
    assert len(places(found["track-1"])) == MAX_POINTS
    end = flight.live().on_earth(Point(18.0, 598.0))
    assert places(found["track-1"])[-1] == f"{end.y:.7f},{end.x:.7f}"
    assert len(places(found["path-1"])) == 3
    flight.board.set_field("path 1", [])
    assert list(by_name(Marks(simulated=False).shapes(flight.live()))) == ["track-1"]


def test_uids_depend_on_the_mission_alone():
    one, other = BoardFlight(), BoardFlight()
    one.cells("explored", (0, 0))
    other.cells("explored", (7, 7))
    other.board.set_field("t_s", 500.0)
    uids = [{m.uid for m in Marks(simulated=False).shapes(f.live())} for f in (one, other)]
    assert uids[0] == uids[1]


def traffic(**changed):
    known = {
        "ident": "3C6444 DLH1",
        "name": "DLH1",
        "e": 0.0,
        "n": 0.0,
        "up": 90,
        "toward_deg": 270.0,
        "speed_m_s": 50.0,
        "words": "DLH1, 0 m N of the start, 90 m up",
    }
    return known | changed


def test_traffic_has_the_uid_of_an_adsb_gateway_its_motion_and_is_not_ours_to_delete():
    flight = BoardFlight()
    drone = traffic(ident="00ff", name="00ff", e=100.0, speed_m_s=None, toward_deg=None)
    flight.board.set_field("traffic", [traffic(), drone])
    first, second = Marks(simulated=False).traffic(flight.live())
    assert (first.uid, first.cot_type, first.how) == ("ICAO-3C6444", OTHER, "m-g")
    assert detail(first).find("contact").attrib["callsign"] == "DLH1"
    assert detail(first).find("track").attrib == {"course": "270.0", "speed": "50.0"}
    assert detail(first).findtext("remarks").endswith("90 m up; received by runway")
    start = flight.live().start
    assert (first.lat_deg, first.lon_deg) == pytest.approx((start.lat_deg, start.lon_deg), abs=1e-6)
    assert (second.uid, second.cot_type) == ("uavmap-traffic-00ff", OTHER_DRONE)
    assert second.lon_deg > first.lon_deg
    assert detail(second).find("track") is None
    outbox = Outbox()
    outbox.put("traffic", [first, second], every_s=5.0)
    outbox.put("traffic", [second], every_s=5.0)
    assert outbox.next(0.0) == second


def test_traffic_of_a_simulation_has_uids_of_its_own():
    flight = BoardFlight()
    flight.board.set_field("traffic", [traffic()])
    (mark,) = Marks(simulated=True).traffic(flight.live())
    assert (mark.uid, mark.how) == ("SIM-ICAO-3C6444", "m-s")
