"""Actions of the autopilot by itself, and the reaction of the mission."""

from __future__ import annotations

import math
import re

from missions.geo.geodesy import LocalPlane
from missions.units import LatLon
from tests.real.autopilot import Values
from tests.real.rig import Rig, Run
from tests.real.scenario import scenario

PLACE = re.compile(r"(-?\d+\.\d{5,})[,/ ]+(-?\d+\.\d{5,})")


async def in_search(rig: Rig) -> Run:
    run = await rig.fly("--auto-swap")
    await rig.in_search(run)
    return run


async def failed(rig: Rig, what: str) -> Run:
    run = await in_search(rig)
    await rig.aircraft[0].fail(what)
    return run


def reported_from_m(rig: Rig, run: Run) -> float:
    """Return the distance between the true position and the last one that was reported, m."""
    places = PLACE.findall("\n".join(run.lines))
    assert places, f"no place was told: {run.lines[-5:]}"
    plane = LocalPlane(rig.mission.home)
    told = plane.to_plane(LatLon(*map(float, places[-1])))
    return math.dist(told, plane.to_plane(rig.referee.position(0)))


# for a PX4 that returns at 60 %: it goes from its usual 7 % to an emergency in a second
EARLY: dict[str, Values] = {"px4": {"BAT_LOW_THR": 0.7, "BAT_CRIT_THR": 0.6}}


@scenario("battery failsafe, given back in its return", near=True, parameters=EARLY)
async def test_battery_failsafe_brings_the_vehicle_home(rig: Rig) -> None:
    one = rig.aircraft[0]
    run = await failed(rig, "battery")
    await rig.until(lambda: one.pilot.mode in ("RTL", "LAND"), "a failsafe", 120.0)
    await rig.rest(8.0)
    if rig.referee.judge.in_the_air and one.pilot.mode == "RTL":
        await one.set_mode(one.ours)
    await rig.all_down()  # else it may end by itself, or wait for a fresh battery
    await rig.rest(20.0)  # a flight may end by itself then, or wait for a fresh battery
    await rig.comes_home(run)


@scenario("satellites off", near=True)
async def test_vehicle_without_satellites_lands_and_its_place_is_reported(rig: Rig) -> None:
    run = await failed(rig, "satellites")
    await rig.ends_well(run, 4)
    rig.row.detail = f"reported {reported_from_m(rig, run):.0f} m from its place"


@scenario("satellites 55 m off for 15 s", near=True)
async def test_glitch_of_the_satellites_ends_well(rig: Rig) -> None:
    run = await failed(rig, "glitch")
    await rig.rest(15.0)
    await rig.aircraft[0].fail("no glitch")
    await rig.ends_well(run, 3, 4)


@scenario("a motor fails", near=True)
async def test_motor_that_fails_stops_all_motors(rig: Rig) -> None:
    run = await failed(rig, "motor")
    await rig.ends_well(run, 4, put_back=False)  # no one flies it from there
    rig.row.detail = f"reported {reported_from_m(rig, run):.0f} m from its place"


@scenario("disarmed by force in the air", near=True)
async def test_motors_stopped_in_the_air_are_a_crash(rig: Rig) -> None:
    run = await in_search(rig)
    await rig.aircraft[0].pilot.command(400, 0, 21196)
    await rig.ends_well(run, 4, put_back=False)  # no one flies it from there
    rig.row.detail = f"reported {reported_from_m(rig, run):.0f} m from its place"


@scenario("fence made smaller in flight", near=True)
async def test_fence_made_smaller_in_flight_ends_well(rig: Rig) -> None:
    run = await failed(rig, "small fence")
    await rig.ends_well(run, 3)


@scenario("radio control lost, and back", near=True)
async def test_radio_control_lost_and_back_ends_well(rig: Rig) -> None:
    one = rig.aircraft[0]
    run = await in_search(rig)
    one.hold_sticks(centred=True)  # with the throttle up it does not arm
    await rig.rest(2.0)
    await one.fail("radio")
    await rig.until(lambda: one.pilot.mode == "RTL", "a failsafe", 60.0)
    await rig.rest(5.0)
    await one.fail("radio back")
    await rig.rest(5.0)
    await one.set_mode(one.ours)
    await rig.in_search(run)
    await rig.comes_home(run)
