"""A simulated vehicle under a driver, in this process: either driver, either autopilot.

The driver of the service flies on virtual time. MAVSDK, in its own process, knows real time
only: the vehicle's time then passes `SPEEDUP` times as fast as real time. Waits in the vehicle's
time are then longer than a busy machine needs.
"""

from __future__ import annotations

import asyncio

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from tests.support.flights import Flight, running, small_mission, under_way
from uavmap.base.clock import ScaledClock, VirtualClock, run
from uavmap.mavlink.mavsdk.mavsdk_session import MavsdkSession
from uavmap.mavlink.session import GROUND_SYSTEM_ID
from uavmap.runner.simulation import STEP_S

SPEEDUP = 10.0
SLOW_MACHINE_S = 3.0  # real seconds by which MAVSDK may be late
PATIENCE_S = 300.0  # real seconds for a flight that takes 10

DRIVERS = ("pymavlink", "mavsdk")
AUTOPILOTS = ("ardupilot", "px4")


def over(autopilot):
    made = small_mission()
    return made.model_copy(update={"sim": made.sim.model_copy(update={"autopilot": autopilot})})


def fly(body, driver, autopilot, speedup=SPEEDUP):
    """Run a test with a connected vehicle on the ground; `speedup` is that of MAVSDK's flights."""
    if driver == "mavsdk":
        return _fly_mavsdk(body, autopilot, speedup)
    return _fly_ours(body, autopilot)


def by_each_driver(*, drivers=DRIVERS, autopilots=AUTOPILOTS, speedup=SPEEDUP):
    """Make a test of what happens to a connected vehicle on the ground, by each driver."""

    def decorate(test):
        @pytest.mark.parametrize("autopilot", autopilots)
        @pytest.mark.parametrize("driver", drivers)
        def run(driver, autopilot):
            fly(lambda flight: test(flight, autopilot), driver, autopilot, speedup)

        run.__name__, run.__doc__ = test.__name__, test.__doc__
        return run

    return decorate


def _fly_ours(body, autopilot):
    flight = Flight(over(autopilot))

    async def main():
        async with under_way(flight):
            await body(flight)

    run(main(), VirtualClock())
    return checked(flight)


def _fly_mavsdk(body, autopilot, speedup):
    async def main():
        reported = []
        slack_s = SLOW_MACHINE_S * speedup

        def driver(send):
            return MavsdkSession(send, lambda frame: None, say=reported.append, speedup=speedup)

        flight = Flight(
            over(autopilot), driver=driver, link_lost_s=slack_s, battery_stale_s=slack_s,
            slack_s=slack_s,
        )  # fmt: skip
        flight.messages = reported
        spoken_to = flight.session
        await spoken_to.process.start()
        try:
            while spoken_to.view.autopilot is None:  # MAVSDK may take long to find it
                flight._deliver(flight.vehicle.step(STEP_S))
                await asyncio.sleep(STEP_S)
            async with asyncio.timeout(PATIENCE_S * speedup), running(flight):
                await body(flight)
        finally:
            await spoken_to.process.close()
        assert spoken_to.process.pid is None
        assert len(asyncio.all_tasks()) == 1  # nothing of it is left
        return flight

    return checked(run(main(), ScaledClock(speedup)))


def checked(flight):
    """Check that every message that was sent was allowed."""
    assert {m.get_srcSystem() for _, m in flight.sent} == {GROUND_SYSTEM_ID}
    return flight


async def turned_to(flight, mode, *params):
    """Turn the mode switch for the pilot; return once the new mode is received."""
    flight.pilot(mav.MAV_CMD_DO_SET_MODE, 1, *params)
    await flight.until(lambda: flight.session.view.mode == mode)
