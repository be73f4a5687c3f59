"""The autopilot's own fence: set, read back, restored; or kept, and compared with the mission."""

from __future__ import annotations

import asyncio
import json

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav
from shapely.geometry import Point, Polygon

from missions.events import Airborne, Arrived, Guarded
from missions.flight.setting_of import setting_of
from missions.mission.checks import parse_mission
from missions.orders import FlyTo, Hold, TakeOff
from missions.units import GridPoint, LatLon
from tests.support.field import BOTH, Field, mission_of, on_field
from tests.support.fleet_rig import field_text
from tests.support.flights import fly
from tests.support.running import by
from uavmap.aircraft.path_stream import StreamTimeout
from uavmap.mavlink.mission_transfer import Item, Kind, MissionTransfer, same_items
from uavmap.runner.preflight.autopilot_fence import shapes_of
from uavmap.runner.preflight.autopilot_setup import FILE, AutopilotSetup
from uavmap.runner.preflight.finding import Finding, Level, could_fly

FENCE, RALLY = mav.MAV_MISSION_TYPE_FENCE, mav.MAV_MISSION_TYPE_RALLY
OLD = tuple(
    Item(mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, LatLon(lat, lon), 3.0)
    for lat, lon in ((47.99, 10.99), (48.01, 10.99), (48.0, 11.02))
)
OLD_RALLY = (
    Item(mav.MAV_CMD_NAV_RALLY_POINT, LatLon(48.001, 11.001), frame=3, height_m=30.0),
)  # fmt: skip
HEIGHT = {"ardupilot": ("RTL_ALT", 100.0), "px4": ("RTL_RETURN_ALT", 1.0)}
CEILING = {"ardupilot": "FENCE_ALT_MAX", "px4": "GF_MAX_VER_DIST"}


def texts(found: list[Finding], level: Level = Level.BAD) -> list[str]:
    return [finding.line() for finding in found if finding.level is level]


@pytest.mark.parametrize("autopilot", BOTH)
@by(on_field, mission_of)
async def test_fence_is_set_around_the_mission_and_restored(field, /, autopilot, tmp_path):
    transfer = MissionTransfer(field.links[0].session)
    await transfer.upload(Kind.FENCE, OLD)
    await transfer.upload(Kind.RALLY, OLD_RALLY)
    names = (*HEIGHT[autopilot][:1], CEILING[autopilot])
    before = [field.parameter(0, name) for name in names]
    setup = field.setup(1, tmp_path)
    found = await setup.apply()
    assert could_fly(found)
    items = await transfer.download(Kind.FENCE)
    ((including, shape),) = shapes_of(field.setting, items)
    assert including
    outer = field.setting.fence.outer
    assert shape.covers(outer)
    assert shape.exterior.distance(outer) == pytest.approx(plan_m(found), abs=0.51)
    assert field.parameter(0, CEILING[autopilot]) >= 22.0
    (rally,) = await transfer.download(Kind.RALLY)
    assert field.setting.grid.fixed(rally.position).distance_to(GridPoint(0.0, 0.0)) < 3.0
    assert "is put back at the end" in field.lines[0]
    plan = json.loads((tmp_path / "fence-before-1.plan").read_text("utf-8"))
    (polygon,) = plan["geoFence"]["polygons"]
    assert polygon["polygon"] == [[i.position.lat_deg, i.position.lon_deg] for i in OLD]
    assert plan["rallyPoints"]["points"] == [[48.001, 11.001, 30.0]]
    await setup.restore()
    assert same_items(OLD, await transfer.download(Kind.FENCE))
    assert same_items(OLD_RALLY, await transfer.download(Kind.RALLY))
    assert [field.parameter(0, name) for name in names] == before
    assert not (tmp_path / FILE).exists()


def plan_m(found: list[Finding]) -> float:
    """Return the distance outside, as the operator sees it, m."""
    (text,) = [f.found for f in found if f.what == "fence" and f.level is Level.OK]
    return float(text.split(" m outside")[0].split()[-1])


@pytest.mark.parametrize("autopilot", BOTH)
@by(on_field, lambda autopilot: mission_of(autopilot, 3))
async def test_vehicles_of_a_team_return_in_their_own_layers(field, /, autopilot, tmp_path):
    name, scale = HEIGHT[autopilot]
    found_m = field.parameter(0, name) / scale
    setups = [field.setup(number, tmp_path) for number in (1, 2, 3)]
    for setup in setups:
        assert could_fly(await setup.apply())
    heights_m = [field.parameter(i, name) / scale for i in range(3)]
    assert heights_m == [12.0, 18.0, 24.0]
    assert [field.parameter(i, CEILING[autopilot]) for i in range(3)] == [34.0] * 3
    for setup in setups:
        await setup.restore()
    assert [field.parameter(i, name) / scale for i in range(3)] == [found_m] * 3


@by(on_field, lambda: parse_mission(field_text(), "field"))
async def test_member_is_warned_of_air_that_its_autopilot_does_not_know(field, /, tmp_path):
    field.setting = setting_of(field.setting.mission, 2)
    (line,) = texts(await field.setup(2, tmp_path).apply(), Level.WARN)
    assert "fence: the air over the pads of vehicles 1, 3 is narrower than 32 m" in line
    assert "fence.holes" not in line


@by(on_field, lambda: mission_of("ardupilot"))
async def test_settings_of_a_killed_flight_are_not_taken_for_the_pilots(field, /, tmp_path):
    field.put(0, "FENCE_ALT_MAX", 77.0)
    assert could_fly(await field.setup(1, tmp_path).apply())
    assert field.parameter(0, "FENCE_ALT_MAX") == 25.0
    later = field.setup(1, tmp_path)  # another process, on the same folder
    assert could_fly(await later.apply())
    await later.restore()
    assert field.parameter(0, "FENCE_ALT_MAX") == 77.0
    assert field.count(0, FENCE) == field.count(0, RALLY) == 0


@by(on_field, lambda: mission_of("ardupilot"))
async def test_guid_timeout_of_a_killed_flight_is_restored_by_resume(field, /, tmp_path):
    """A real ArduCopter kept 1 s for ever after a kill, even if the flight was resumed."""
    assert could_fly(await field.setup(1, tmp_path).apply())
    session = field.links[0].session
    await StreamTimeout("sim", session, field.lines.append).shorten()
    assert field.parameter(0, "GUID_TIMEOUT") == 1.0
    later = field.setup(1, tmp_path)
    assert could_fly(await later.apply())
    assert await later.restore()
    assert field.parameter(0, "GUID_TIMEOUT") == 3.0


@by(on_field, lambda: mission_of("ardupilot"))
async def test_guid_timeout_is_restored_where_the_fence_is_kept(field, /, tmp_path):
    await MissionTransfer(field.links[0].session).upload(Kind.FENCE, OLD)
    setup = field.setup(1, tmp_path)
    await setup.save_timeout()
    field.put(0, "GUID_TIMEOUT", 1.0)
    assert could_fly(await setup.apply())
    assert field.count(0, FENCE) == 4
    assert await setup.restore()
    assert (field.count(0, FENCE), field.parameter(0, "GUID_TIMEOUT")) == (3, 3.0)


def has_uid(field: Field, number: int) -> None:
    """Give the aircraft at the end of the link the hardware number that it reports."""
    codec = mav.MAVLink(None, srcSystem=1, srcComponent=1)
    version = mav.MAVLink_autopilot_version_message(
        0, 0x040602FF, 0, 0, 0, bytes(8), bytes(8), bytes(8), 0, 0, number, bytes(18)
    )
    field.links[0].session.feed(version.pack(codec))


def test_another_aircraft_keeps_its_own_settings(tmp_path):
    mission, names = mission_of("ardupilot"), ("FENCE_ENABLE", "RTL_ALT", "FENCE_ALT_MAX")

    async def crashes(field: Field) -> None:
        has_uid(field, 1)
        field.put(0, "FENCE_ALT_MAX", 33.0)
        await MissionTransfer(field.links[0].session).upload(Kind.RALLY, OLD_RALLY)
        assert could_fly(await field.setup(1, tmp_path).apply())

    async def goes_on(field: Field) -> None:
        has_uid(field, 2)
        for name, value in zip(names, (1.0, 5000.0, 120.0), strict=True):
            field.put(0, name, value)
        setup = field.setup(1, tmp_path)
        assert could_fly(await setup.apply())
        assert not await setup.restore()
        assert [field.parameter(0, name) for name in names] == [1.0, 5000.0, 120.0]
        assert field.count(0, RALLY) == 0
        assert "keeps the settings of an aircraft that is not connected" in field.lines[-1]

    async def is_mended(field: Field) -> None:
        has_uid(field, 1)
        assert await field.setup(1, tmp_path).restore()
        assert field.parameter(0, "FENCE_ALT_MAX") == 33.0
        assert field.count(0, RALLY) == 1
        assert not (tmp_path / FILE).exists()

    for act in (crashes, goes_on, is_mended):
        on_field(act, mission)


@by(on_field, lambda: mission_of("ardupilot"))
async def test_settings_are_not_restored_on_an_armed_vehicle(field, /, tmp_path):
    setup = field.setup(1, tmp_path)
    assert could_fly(await setup.apply())
    session = field.links[0].session
    await session.command(mav.MAV_CMD_DO_SET_MODE, 1, 4)
    await session.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    await session.until(lambda: session.view.armed, 5.0)
    await setup.restore()
    assert "stay (its motors are armed)" in field.lines[-1]
    assert field.count(0, FENCE) == 4
    assert (tmp_path / FILE).exists()


@by(on_field, lambda: mission_of("ardupilot"))
async def test_restore_motors_off_and_no_landing_reported_leaves_the_settings(field, /, tmp_path):
    setup = field.setup(1, tmp_path)
    assert could_fly(await setup.apply())
    session = field.links[0].session
    assert not session.view.armed
    stream = mav.MAVLINK_MSG_ID_EXTENDED_SYS_STATE
    await session.command(mav.MAV_CMD_SET_MESSAGE_INTERVAL, stream, -1)
    session.view.landed_state = mav.MAV_LANDED_STATE_IN_AIR
    assert not await setup.restore()
    assert "stay (it has not reported that it is on the ground)" in field.lines[-1]
    assert field.count(0, FENCE) == 4


@by(on_field, lambda: mission_of("ardupilot"))
async def test_restore_waits_for_the_landing_to_be_reported(field, /, tmp_path):
    setup = field.setup(1, tmp_path)
    assert could_fly(await setup.apply())
    field.links[0].session.view.landed_state = mav.MAV_LANDED_STATE_IN_AIR  # as of a second ago
    assert await setup.restore()
    assert not (tmp_path / FILE).exists()


@by(on_field, lambda: mission_of("ardupilot"))
async def test_autopilot_that_keeps_its_own_ceiling_is_reported(field, /, tmp_path):
    parameters = field.vehicles[0]._ap.parameters
    row = parameters.by_name["FENCE_ALT_MAX"]
    parameters.by_name["FENCE_ALT_MAX"] = type(row)(row.name, row.default, row.type, True)
    found = await field.setup(1, tmp_path).apply()
    (line,) = texts(found)
    assert line.startswith("bad   FENCE_ALT_MAX: could not be set (wanted: 25)")
    assert found[-1].binding


# --- kept ------------------------------------------------------------------------------------
@by(on_field, lambda: mission_of("ardupilot"))
async def test_kept_circle_that_is_too_small_keeps_the_mission_on_the_ground(field, /, tmp_path):
    setup = field.setup(1, tmp_path)
    assert could_fly(await setup.keep_fence())  # it is off
    field.put(0, "FENCE_ENABLE", 1)
    assert could_fly(await setup.keep_fence())  # 150 m
    field.put(0, "FENCE_RADIUS", 15)
    box, fence = texts(await setup.keep_fence())
    assert "leaves the one that is set: search.box: " in box
    assert "fence.polygon less fence.margin_m: " in fence
    field.put(0, "FENCE_TYPE", 1)
    field.put(0, "FENCE_ALT_MAX", 10)
    (height,) = texts(await setup.keep_fence())
    assert "its layer, 12 m, is not a metre below FENCE_ALT_MAX = 10" in height
    assert field.count(0, FENCE) == 0


@by(on_field, lambda: mission_of("px4"))
async def test_kept_polygon_with_a_hole_in_the_box_is_refused(field, /, tmp_path):
    def corners(command: int, ring: list[tuple[float, float]], field: Field) -> list[Item]:
        grid = field.setting.grid
        return [Item(command, grid.position(GridPoint(*xy)), len(ring)) for xy in ring]

    transfer, setup = MissionTransfer(field.links[0].session), field.setup(1, tmp_path)
    wide = corners(5001, [(-90, -90), (90, -90), (90, 90), (-90, 90)], field)
    await transfer.upload(Kind.FENCE, wide)
    assert could_fly(await setup.keep_fence())
    tower = corners(5002, [(10, 10), (14, 10), (14, 14), (10, 14)], field)
    await transfer.upload(Kind.FENCE, [*wide, *tower])
    lines = texts(await setup.keep_fence())
    assert any("search.box: 16 m2 of it lie outside" in line for line in lines)
    far = corners(5001, [(30, 30), (90, 30), (90, 90)], field)
    await transfer.upload(Kind.FENCE, far)
    assert any("the home of vehicle 1 lies outside" in x for x in texts(await setup.keep_fence()))


@by(on_field, lambda: mission_of("ardupilot"))
async def test_fence_is_farther_out_the_faster_the_mission_flies(field, /, tmp_path):
    setup = field.setup(1, tmp_path)
    before, _ = await setup.examine()
    plan = setup.fence_of(before).plan()
    ring = Polygon([field.setting.grid.fixed(i.position) for i in plan.fence])
    assert ring.exterior.distance(Point(0, 0)) > 40.0 + plan.outside_m - 1.0
    speed = field.setting.mission.flight.speed_m_s
    assert plan.outside_m == max(5.0, 2.0 * speed + speed**2 / 4.0)


UP_M = 12.0


@pytest.mark.parametrize("autopilot", BOTH)
@by(fly, mission_of)
async def test_storm_ends_the_flight_as_near_as_without_a_fence(flight, /, autopilot, tmp_path):
    """With targets refused outside of its fence an ArduCopter came down 175 m outside."""
    outside_m: list[float] = []
    setup = AutopilotSetup(1, flight.session, flight.setting, tmp_path)
    await asyncio.sleep(8.0)
    assert could_fly(await setup.apply())
    await flight.after(TakeOff(UP_M), Airborne)
    there = FlyTo((GridPoint(10.0, 10.0),), None, stop=True, height_m=UP_M)
    await flight.after(there, Arrived)
    flight.driver.give(Hold())
    flight.vehicle.fail.wind_gust(m_s=25.0, for_s=None)
    await flight.until(lambda: flight.vehicle.truth.landed, within_s=90.0)
    where = flight.setting.grid.fixed(flight.vehicle.truth.position)
    outside_m.append(float(flight.setting.fence.outer.distance(Point(where))))
    assert [event.action for event in flight.seen(Guarded)][-1] == "land"
    assert outside_m[0] < 110.0


@pytest.mark.parametrize("autopilot", BOTH)
@by(fly, mission_of)
async def test_flight_along_the_margin_touches_no_fence(flight, /, autopilot, tmp_path):
    setup = AutopilotSetup(1, flight.session, flight.setting, tmp_path)
    await asyncio.sleep(8.0)
    assert could_fly(await setup.apply())
    flight.vehicle.fail.wind_gust(m_s=5.0, for_s=None)
    await flight.after(TakeOff(UP_M), Airborne)
    for corner in ((58.0, 68.0), (58.0, -38.0), (-38.0, -38.0), (-38.0, 68.0)):
        leg = FlyTo((GridPoint(*corner),), None, stop=False, height_m=UP_M)
        await flight.after(leg, Arrived)
    assert not any(
        "breach" in text.lower() or "violat" in text.lower()
        for _, text in flight.session.view.texts
    )
    assert not flight.vehicle.truth.failsafe
