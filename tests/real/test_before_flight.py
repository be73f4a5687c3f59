"""Checks, settings and their restoration before real aircraft take off."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.geo.geodesy import LocalPlane
from tests.real.autopilot import Autopilot, Values
from tests.real.pilot import FENCE, RALLY, Item
from tests.real.rig import Rig
from tests.real.scenario import scenario

OWNERS_FENCE: dict[str, Values] = {
    "ardupilot": {"FENCE_TYPE": 6.0, "FENCE_ACTION": 1.0, "FENCE_RADIUS": 400.0},
    "px4": {"GF_ACTION": 1.0, "GF_MAX_HOR_DIST": 400.0, "RTL_RETURN_ALT": 25.0},
}
SMALL_FENCE: dict[str, Values] = {
    "ardupilot": {"FENCE_ENABLE": 1.0, "FENCE_TYPE": 2.0, "FENCE_RADIUS": 60.0},
    "px4": {"GF_ACTION": 3.0, "GF_MAX_HOR_DIST": 60.0},
}


RALLY_AT = 10.0, 15.0
"""East and north of the first pad, m."""


async def owned(rig: Rig) -> Autopilot:
    """Give an autopilot a fence of four points and a rally point of its owner."""
    one = rig.aircraft[0]
    plane = LocalPlane(rig.mission.home)

    def at(east_m: float, north_m: float) -> tuple[int, int]:
        place = plane.to_wgs84(east_m, north_m)
        return round(place.lat_deg * 1e7), round(place.lon_deg * 1e7)

    corners = [(-150, -150), (400, -150), (400, 400), (-150, 400)]
    vertex = mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
    await one.pilot.give(FENCE, [Item(vertex, 4.0, *at(*corner)) for corner in corners])
    rally = Item(mav.MAV_CMD_NAV_RALLY_POINT, 0.0, *at(*RALLY_AT), height_m=20.0)
    await one.pilot.give(RALLY, [rally])
    rig.before = [await rig.kept(one)]
    return one


def never_flown(rig: Rig) -> None:
    assert not rig.referee.has_flown
    assert not any(one.pilot.armed for one in rig.aircraft)


@scenario("doctor")
async def test_doctor_finds_the_vehicle_fit_and_changes_nothing(rig: Rig) -> None:
    run = await rig.uavmap("doctor", rig.source, *rig.links)
    await rig.ends_well(run, 0)
    never_flown(rig)


@scenario("dry run, owner's fence and rally point", parameters=OWNERS_FENCE)
async def test_dry_run_restores_the_owners_settings(rig: Rig) -> None:
    await owned(rig)
    assert len(rig.before[0].fence) == 4
    assert len(rig.before[0].rally) == 1
    for _ in range(3):
        run = await rig.fly("--dry-run")
        await rig.ends_well(run, 0)
        never_flown(rig)


@scenario("dry run, then a return to the owner's rally point")
async def test_vehicle_after_a_dry_run_returns_to_its_owners_rally_point(rig: Rig) -> None:
    one = await owned(rig)
    run = await rig.fly("--dry-run")
    await rig.ends_well(run, 0)
    await rig.fly_by_hand(LocalPlane(rig.mission.home).to_wgs84(12.0, 22.0))
    await one.set_mode("RTL")
    await rig.all_down(200.0)
    away_m = math.dist(LocalPlane(rig.mission.home).to_plane(rig.referee.position(0)), RALLY_AT)
    rig.row.detail = f"landed {away_m:.0f} m from the rally point"
    assert away_m < 5.0, rig.row.detail


@scenario("--keep-fence, a fence of 60 m", parameters=SMALL_FENCE)
async def test_mission_that_leaves_its_owners_fence_is_refused(rig: Rig) -> None:
    run = await rig.fly("--keep-fence")
    await rig.ends_well(run, 2)
    never_flown(rig)
    assert run.has_line("outside"), run.lines


@scenario("no terminal, no --yes")
async def test_flight_without_a_terminal_is_refused(rig: Rig) -> None:
    run = await rig.fly(yes=False)
    await rig.ends_well(run, 2)
    never_flown(rig)


def with_delay(delay_s: float) -> object:
    @scenario(f"dry run, {delay_s:g} s late each way")
    async def flown(rig: Rig) -> None:
        for relay in rig.relays:
            relay.delay_s = delay_s
        run = await rig.fly("--dry-run")
        await rig.ends_well(run, 0, within_s=600.0)
        never_flown(rig)

    return flown


test_a_link_0_3_s_late_each_way = with_delay(0.3)
test_a_link_0_6_s_late_each_way = with_delay(0.6)
test_a_link_1_5_s_late_each_way = with_delay(1.5)
