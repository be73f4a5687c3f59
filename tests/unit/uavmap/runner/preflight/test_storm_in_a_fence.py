"""The autopilot's own fence does not keep the guardian from bringing a vehicle down in a storm."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from shapely.geometry import Point

from missions.events import Airborne, Arrived, Guarded
from missions.orders import FlyTo, Hold, TakeOff
from missions.units import GridPoint
from tests.support.field import BOTH, mission_of
from tests.support.flights import Flight, fly
from tests.support.running import by
from uavmap.runner.preflight.autopilot_setup import AutopilotSetup
from uavmap.runner.preflight.finding import could_fly

UP_M = 12.0


@pytest.mark.parametrize("autopilot", BOTH)
@by(fly, mission_of)
async def test_a_storm_ends_on_the_ground_as_near_as_without_a_fence(
    flight: Flight, /, autopilot: str, tmp_path: Path
) -> None:
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
async def test_a_flight_along_the_margin_never_touches_the_autopilots_fence(
    flight: Flight, /, autopilot: str, tmp_path: Path
) -> None:
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
