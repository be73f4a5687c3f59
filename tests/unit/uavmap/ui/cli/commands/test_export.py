"""Files for ground stations: their content, and simulated autopilots that accept and fly them."""

import json
import math
from itertools import pairwise

import pytest
from pymavlink import mavwp
from pymavlink.dialects.v20 import ardupilotmega as mav
from shapely.geometry import LineString

from missions.flight.setting_of import setting_of
from missions.mission.places import homes
from missions.mission.schema import positions
from missions.units import LatLon
from tests.support.plan_schema import faults_of
from tests.support.small_missions import mission_text, square
from uavmap.load.mission_source import load
from uavmap.output.formats.ground_station_plan import clockwise
from uavmap.ui.cli import main

E7 = 1e-7
LONGEST_M = 500.0
"""Longest leg, m: no path around the hole leads along the rim of the fence."""
MISSION, FENCE, RALLY = 0, 1, 2
AUTO = 3
FENCE_RING = square(-20.0, -20.0, 120.0, 90.0)
HOLE = square(30.0, 10.0, 12.0, 20.0)


def text_of(vehicles=1, **more):
    text = mission_text(
        square(10.0, 0.0, 60.0, 40.0), FENCE_RING, [HOLE], vehicles=vehicles, **more
    )
    return text.replace("[start]", "[start]\namsl_m = 488.5")


def mission_file(tmp, vehicles=1, **more):
    path = tmp / "field.toml"
    path.write_text(text_of(vehicles, **more), "utf-8")
    return path, setting_of(load(str(path)))


def exported(tmp, *arguments, code=0):
    file = tmp / "field.plan"
    assert main(["export", *map(str, arguments), "--plan", str(file)]) == code
    return documented(file)


def documented(file):
    values = json.loads(file.read_text("utf-8"))
    assert faults_of(values) == []
    return values


def places_of(items):
    return [LatLon(*item["params"][4:6]) for item in items if item["frame"] != 2]


def near(one, other):
    return abs(one.lat_deg - other.lat_deg) < E7 and abs(one.lon_deg - other.lon_deg) < E7


# --- a mission ----------------------------------------------------------------------------------
def test_plan_has_the_keys_that_qgroundcontrol_documents(tmp_path):
    file, setting = mission_file(tmp_path)
    plan = exported(tmp_path, file)
    home = homes(setting.mission)[0]
    assert (plan["fileType"], plan["version"]) == ("Plan", 1)
    mission, fence, rally = plan["mission"], plan["geoFence"], plan["rallyPoints"]
    assert (mission["version"], fence["version"], rally["version"]) == (2, 2, 2)
    assert (mission["firmwareType"], mission["vehicleType"]) == (3, 2)
    assert mission["hoverSpeed"] == mission["cruiseSpeed"] == setting.mission.flight.speed_m_s
    assert mission["plannedHomePosition"] == pytest.approx(
        [home.lat_deg, home.lon_deg, 488.5], abs=E7
    )
    assert rally["points"] == [pytest.approx([home.lat_deg, home.lon_deg, 12.0], abs=E7)]
    assert [p["inclusion"] for p in fence["polygons"]] == [True, False]
    drawn = (setting.mission.fence.polygon, setting.mission.fence.holes[0])
    for polygon, ring in zip(fence["polygons"], drawn, strict=True):
        assert len(polygon["polygon"]) == len(ring)
        for vertex in ring:
            assert any(near(LatLon(*vertex), LatLon(*corner)) for corner in polygon["polygon"])
    for number, item in enumerate(mission["items"], start=1):
        assert (item["type"], item["doJumpId"]) == ("SimpleItem", number)
        assert len(item["params"]) == 7
        if item["frame"] != 2:
            assert (item["frame"], item["AltitudeMode"], item["Altitude"]) == (3, 1, 12.0)


def test_lanes_are_flown_in_their_order_and_no_leg_leaves_the_fence(tmp_path):
    file, setting = mission_file(tmp_path)
    items = exported(tmp_path, file)["mission"]["items"]
    commands = [item["command"] for item in items]
    assert commands[:2] == [mav.MAV_CMD_NAV_TAKEOFF, mav.MAV_CMD_DO_CHANGE_SPEED]
    assert commands[-1] == mav.MAV_CMD_NAV_RETURN_TO_LAUNCH
    begun = [i for i, item in enumerate(items) if item["command"] == 206 and item["params"][0] > 0]
    lanes = []
    for i in begun:  # waypoint, pictures on, waypoint, pictures off
        assert items[i + 2]["params"][0] == 0.0
        lanes.append((places_of(items[i - 1 : i]), places_of(items[i + 1 : i + 2])))
    assert len(lanes) == len(setting.lanes) > 4
    for lane, (start, end) in zip(setting.shares[0], lanes, strict=True):
        assert near(setting.grid.position(lane[0]), start[0])
        assert near(setting.grid.position(lane[1]), end[0])
    way = [setting.grid.fixed(place) for place in places_of(items)]
    allowed = setting.fence.shrunk(-0.02)  # degrees in the file are rounded
    assert all(allowed.covers(LineString([a, b])) for a, b in pairwise(way))
    assert sum(a.distance_to(b) for a, b in pairwise(way)) < LONGEST_M
    assert near(places_of(items)[-1], homes(setting.mission)[0])


def test_each_vehicle_has_a_file_a_height_and_a_rally_point_of_its_own(tmp_path):
    file, setting = mission_file(tmp_path, vehicles=3, layer_m=7.0)
    assert main(["export", str(file), "--plan", str(tmp_path / "team.plan")]) == 0
    assert not (tmp_path / "team.plan").exists()
    lanes = 0
    for number, home in enumerate(homes(setting.mission), start=1):
        plan = documented(tmp_path / f"team-{number}.plan")
        height_m = 12.0 + 7.0 * (number - 1)
        assert plan["rallyPoints"]["points"] == [
            pytest.approx([home.lat_deg, home.lon_deg, height_m], abs=E7)
        ]
        items = plan["mission"]["items"]
        assert {item["Altitude"] for item in items if item["frame"] != 2} == {height_m}
        assert near(places_of(items)[0], home)
        lanes += sum(item["command"] == 206 and item["params"][0] > 0 for item in items)
    assert lanes == len(setting.lanes)
    alone = exported(tmp_path, file, "--vehicle", 2)
    assert alone == json.loads((tmp_path / "team-2.plan").read_text("utf-8"))


def test_plan_of_a_px4_has_heights_above_the_sea(tmp_path):
    file, _ = mission_file(tmp_path)
    plan = exported(tmp_path, file, "--above-sea", "--firmware", "px4")
    assert plan["mission"]["firmwareType"] == 12
    assert plan["mission"]["globalPlanAltitudeMode"] == 2
    placed = [item for item in plan["mission"]["items"] if "Altitude" in item]
    assert {(i["frame"], i["AltitudeMode"], i["Altitude"]) for i in placed} == {(0, 2, 500.5)}
    assert plan["rallyPoints"]["points"][0][2] == 12.0  # rally points are above the home


def test_mission_planner_reads_the_waypoints(tmp_path):
    file, setting = mission_file(tmp_path)
    plan, rows = tmp_path / "field.plan", tmp_path / "field.waypoints"
    assert main(["export", str(file), "--plan", str(plan), "--waypoints", str(rows)]) == 0
    loader = mavwp.MAVWPLoader()
    items = json.loads(plan.read_text("utf-8"))["mission"]["items"]
    assert loader.load(str(rows)) == len(items) + 1
    home = loader.wp(0)
    assert (home.x, home.y, home.z) == pytest.approx(
        (*setting.mission.start.position, 488.5), abs=E7
    )
    for number, item in enumerate(items, start=1):
        row = loader.wp(number)
        assert (row.seq, row.command, row.frame) == (number, item["command"], item["frame"])
        params = [0.0 if value is None else value for value in item["params"]]
        found = (row.param1, row.param2, row.param3, row.param4, row.x, row.y, row.z)
        assert found == pytest.approx(params, abs=E7)


# --- what cannot be written ---------------------------------------------------------------------
@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ([], "no format"),
        (["--plan", "x.plan", "--waypoints", "x.plan"], "give each format its own file"),
        (["--waypoints", "x.waypoints", "--firmware", "px4"], "use --plan"),
        (["--plan", "x.plan", "--vehicle", "2"], "has 1"),
        (["--plan", "missing/x.plan"], "cannot be written"),
    ],
)
def test_impossible_export_is_refused_in_a_line(
    tmp_path, monkeypatch, refused, arguments, expected
):
    file, _ = mission_file(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert expected in refused("export", file, *arguments)
    assert [path.name for path in tmp_path.iterdir()] == ["field.toml"]


def test_existing_plan_is_not_overwritten_and_no_other_written(tmp_path, refused):
    file, _ = mission_file(tmp_path, vehicles=2)
    (tmp_path / "team-2.plan").write_text("mine")
    line = refused("export", file, "--plan", tmp_path / "team.plan")
    assert "team-2.plan: already exists" in line
    assert (tmp_path / "team-2.plan").read_text() == "mine"
    assert not (tmp_path / "team-1.plan").exists()


def test_heights_above_the_sea_need_the_height_of_the_start(tmp_path, refused):
    file, _ = mission_file(tmp_path)
    file.write_text(file.read_text("utf-8").replace("amsl_m = 488.5", ""), "utf-8")
    line = refused("export", file, "--above-sea", "--plan", tmp_path / "x.plan")
    assert "start.amsl_m is missing" in line


def test_export_plan_of_a_results_folder_is_refused_in_a_line(tmp_path, refused):
    line = refused("export", tmp_path, "--plan", tmp_path / "x.plan")
    assert "is a folder; give a mission file for a plan" in line
    assert not (tmp_path / "x.plan").exists()


def test_ring_over_the_antimeridian_is_clockwise():
    west, east = 179.999, -179.999
    ring = [LatLon(0.0, west), LatLon(0.0, east), LatLon(0.001, east), LatLon(0.001, west)]
    assert clockwise(ring) == ring[::-1]
    assert clockwise(ring[::-1]) == ring[::-1]


# --- the autopilots take it and fly it ----------------------------------------------------------
def messages_of(plan, *, home):
    """Return a plan as QGroundControl uploads it, by kind; an ArduPilot's begins with the home."""
    none = (0.0, 0.0, 0.0, 0.0)
    mission = [(0, 16, (*none, *plan["mission"]["plannedHomePosition"]))] if home else []
    for item in plan["mission"]["items"]:
        params = tuple(math.nan if value is None else value for value in item["params"])
        mission.append((item["frame"], item["command"], params))
    fence = [
        (0, 5001 if polygon["inclusion"] else 5002, (float(len(ring)), *none[1:], *corner, 0.0))
        for polygon in plan["geoFence"]["polygons"]
        for ring in [polygon["polygon"]]
        for corner in ring
    ]
    rally = [(3, 5100, (*none, *point)) for point in plan["rallyPoints"]["points"]]
    return {
        kind: [message(seq, kind, *row) for seq, row in enumerate(rows)]
        for kind, rows in {MISSION: mission, FENCE: fence, RALLY: rally}.items()
    }


def message(seq, kind, frame, command, params):
    *p, x, y, z = params
    return mav.MAVLink_mission_item_int_message(
        1, 1, seq, frame, command, 0, 1, *p, round(x * 1e7), round(y * 1e7), z, kind
    )


def upload(vehicle, items, kind):
    vehicle.send(mav.MAVLink_mission_count_message(1, 1, len(items), kind))
    while True:
        for answer in vehicle.receive():
            if answer.get_type() in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):
                vehicle.send(items[answer.seq])
                break
            if answer.get_type() == "MISSION_ACK":
                assert answer.type == mav.MAV_MISSION_ACCEPTED, answer
                return
        else:
            vehicle.run(0.1)


def download(vehicle, kind):
    vehicle.send(mav.MAVLink_mission_request_list_message(1, 1, kind))
    count = vehicle.expect("MISSION_COUNT", mission_type=kind).count
    items = []
    for seq in range(count):
        vehicle.send(mav.MAVLink_mission_request_int_message(1, 1, seq, kind))
        items.append(vehicle.expect("MISSION_ITEM_INT", seq=seq))
    return items


def test_px4_accepts_mission_fence_and_rally_points_and_reports_them(tmp_path, sitl_fleet):
    """An ArduPilot gets them from MAVSDK, in `tests/e2e`."""
    file, setting = mission_file(tmp_path)
    plan = exported(tmp_path, file, "--firmware", "px4")
    start = setting.mission.start
    (vehicle,) = sitl_fleet(1, autopilot="px4", home=(*start.position, 488.5, 0.0))
    vehicle.run(6.0)
    sent = messages_of(plan, home=False)
    for kind, items in sent.items():
        upload(vehicle, items, kind)
    for kind, items in sent.items():
        for one, other in zip(download(vehicle, kind), items, strict=True):
            assert (one.command, one.x, one.y, one.z) == (other.command, other.x, other.y, other.z)
            assert one.param1 == pytest.approx(other.param1)
    corners = {(m.x, m.y) for m in sent[FENCE]}
    for place in positions(setting.mission.fence.polygon):
        assert (round(place.lat_deg * 1e7), round(place.lon_deg * 1e7)) in corners


def test_exported_search_is_flown_from_take_off_to_the_ground(tmp_path, sitl_fleet):
    file, setting = mission_file(tmp_path)
    plan = exported(tmp_path, file)
    (vehicle,) = sitl_fleet(1, home=(*setting.mission.start.position, 488.5, 0.0), seed=3)
    vehicle.run(6.0)
    for kind, items in messages_of(plan, home=True).items():
        upload(vehicle, items, kind)
    assert vehicle.command(mav.MAV_CMD_DO_SET_MODE, 1, 4) == 0
    assert vehicle.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1) == 0
    assert vehicle.command(mav.MAV_CMD_DO_SET_MODE, 1, AUTO) == 0
    assert vehicle.command(mav.MAV_CMD_MISSION_START) == 0
    flown = []

    def landed():
        truth = vehicle.truth
        flown.append(setting.grid.fixed(truth.position))
        return len(flown) > 100 and truth.landed and not truth.armed

    vehicle.until(landed, timeout_s=400.0)
    for lane in setting.lanes:
        for end in lane:
            assert min(end.distance_to(place) for place in flown) < 3.0
    assert all(setting.fence.contains(place) for place in flown)
    assert flown[-1].distance_to(setting.grid.fixed(homes(setting.mission)[0])) < 2.0
