"""One trouble each, with the real service, driver and simulated vehicle on virtual time."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.events import Airborne, Arrived, FrameLost, FrameSeen, Tracked
from missions.flight.state import Phase, State
from missions.orders import AwaitBattery, FlyTo, Land, Order, Sweep, TakeOff
from missions.units import GridPoint
from sitl.copter.modes import Mode
from tests.support.flights import Flight, fly, no_task_left, small_mission
from tests.support.running import by
from uavmap.aircraft.vehicle import MavlinkVehicle
from uavmap.base.clock import VirtualClock, run
from uavmap.journal.event_log import Journal
from uavmap.runner.service import Service

UP_M = 12.0
Body = Callable[[Flight, Service], Coroutine[Any, Any, None]]


class OneVehicle:
    """The aircraft of a service, as its one driver."""

    def __init__(self, driver: MavlinkVehicle) -> None:
        self._driver = driver

    def give(self, vehicle: int, order: Order) -> None:
        self._driver.give(order)

    def land_here(self, vehicle: int, reason: str) -> None:
        self._driver.land_here(reason)


def serve(body: Body, folder: Path) -> None:
    """A whole service around one vehicle."""
    flight = Flight(small_mission(capacity_wh=60.0))

    async def main() -> None:
        with Journal.create(folder / "journal.jsonl", {}) as journal, no_task_left():
            service = Service(
                flight.setting, journal, OneVehicle(flight.driver), State.initial(flight.setting),
                lambda event, state: None,
            )  # fmt: skip
            flight.report = service.post  # type: ignore[method-assign]
            flight.taken_in = service.taken_in  # type: ignore[method-assign]
            async with asyncio.TaskGroup() as tasks:
                world = tasks.create_task(flight.fly_world())
                await flight.driver.connect()
                guarding = tasks.create_task(flight.driver.guardian.run())
                driving = tasks.create_task(flight.driver.run(service.post))
                flying = tasks.create_task(service.fly())
                await body(flight, service)
                service.stop()
                await flying
                driving.cancel()
                guarding.cancel()
                world.cancel()

    run(main(), VirtualClock())


@pytest.mark.parametrize("fetch_s", [0.0, 1.5, 2.5])
@by(fly)
async def test_pictures_that_are_fetched_slowly_are_judged_or_said_to_be_lost(
    flight: Flight, /, fetch_s: float
) -> None:
    """None of them is dropped at the end of a lane without a word."""
    announced: set[int] = set()

    async def slow(url: str) -> bytes:
        await asyncio.sleep(fetch_s)
        return await flight._fetch(url)

    def count(message: Any) -> bool:
        if message.get_type() == "CAMERA_IMAGE_CAPTURED":
            announced.add(message.image_index)
        return True

    flight.driver._camera._fetch = slow
    flight.to_driver = count
    await flight.after(TakeOff(UP_M), Airborne)
    start = FlyTo((GridPoint(-4.0, 12.0),), None, stop=True, height_m=UP_M)
    await flight.after(start, Arrived)
    await flight.after(Sweep(GridPoint(50.0, 12.0), 4.0, UP_M), Arrived)
    judged, lost = len(flight.seen(FrameSeen)), len(flight.seen(FrameLost))
    assert len(announced) >= 10
    assert judged + lost >= len(announced)
    if fetch_s < 2.0:
        assert not lost


def test_a_link_that_drops_during_a_landing_for_a_battery_costs_nothing(tmp_path: Path) -> None:
    async def body(flight: Flight, service: Service) -> None:
        def vehicle() -> Any:
            return service.state.vehicles[1]

        await flight.until(lambda: vehicle().phase is Phase.AIRBORNE)
        await asyncio.sleep(5.0)
        # low, by the reducer's eyes
        t_s = round(flight.now_s(), 3)
        service.post(Tracked(1, t_s, vehicle().position, vehicle().height_m, 12.0))
        await flight.until(lambda: isinstance(vehicle().order, Land), 200.0)
        await asyncio.sleep(4.0)
        flight.to_driver = flight.to_vehicle = lambda message: False
        await asyncio.sleep(8.0)
        assert vehicle().phase is Phase.OFFLINE
        flight.to_driver = flight.to_vehicle = lambda message: True
        await flight.until(lambda: vehicle().landed, 60.0)
        assert vehicle().phase is Phase.GROUNDED
        assert isinstance(vehicle().order, AwaitBattery | TakeOff)
        assert not service.state.over

    serve(body, tmp_path)


@pytest.mark.parametrize("mode", [Mode.STABILIZE, Mode.LOITER])
@pytest.mark.parametrize("arms", [True, False])
def test_a_pilot_who_turns_the_switch_on_the_ground_has_the_last_word(
    mode: Mode, arms: bool, tmp_path: Path
) -> None:
    """Before the first take-off, also back to the mode in which it stood, while it is armed."""

    async def body(flight: Flight, service: Service) -> None:
        if not arms:
            flight.vehicle.fail.reject(command=mav.MAV_CMD_COMPONENT_ARM_DISARM)
        await flight.until(lambda: flight.session.view.mode == Mode.GUIDED, 20.0)
        flight.pilot_mode(int(mode))
        await flight.until(lambda: service.state.vehicles[1].phase is Phase.YIELDED, 20.0)
        await asyncio.sleep(40.0)
        assert flight.vehicle.truth.height_m < 1.0
        assert flight.vehicle.truth.mode == mode

    serve(body, tmp_path)
