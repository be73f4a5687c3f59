"""The work of the aircraft process with its open links, from the first answer to the last landing.

    Begin -> connect, examine, set -> Ready -> Fly -> orders and events -> Finish -> Ended

A simulated flight runs it in its own process, with the same messages.
"""

from __future__ import annotations

import asyncio
import contextlib
import traceback
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TypeVar

from missions.errors import leaves
from missions.mission.layout import Layout
from uavmap.aircraft.guardian.last_watch import (
    NOT_HOME,
    Guardians,
    failure_text,
    is_defect,
    run_beside_keeper,
)
from uavmap.aircraft.process import messages as msg
from uavmap.aircraft.process.host import Host
from uavmap.aircraft.process.port import Port, ended_by
from uavmap.aircraft.telemetry_reports import TelemetryReports
from uavmap.aircraft.traffic_reports import TrafficReports
from uavmap.aircraft.vehicle import MavlinkVehicle
from uavmap.base.clock import MissionClock
from uavmap.journal.flight_plan import FlightPlan
from uavmap.runner.before_flight import BeforeFlight
from uavmap.runner.flight_links import Link, reject_other_controllers
from uavmap.runner.vehicles import numbers_of, require_distinct_aircraft, vehicles_of

T = TypeVar("T")
RIVAL_WALL_S: Final = 1.5
"""Time to listen for another process that flies a vehicle, real seconds: it sends every second."""


class AircraftSide:
    """The aircraft's part of one flight; `clock` becomes the mission's clock when that has
    begun."""

    def __init__(
        self,
        plan: FlightPlan,
        setting: Layout,
        folder: Path,
        links: Sequence[Link],
        clock: MissionClock,
        send: Callable[[msg.Message], None],
    ) -> None:
        self._plan = plan
        self._setting = setting
        self._folder = folder
        self._links = links
        self._clock = clock
        self._send = send
        self.host = Host(self._pass_on)
        numbers = numbers_of(setting)
        sessions = {number: link.session for number, link in zip(numbers, links, strict=False)}
        self._reports = TelemetryReports(sessions, send)
        self._traffic = TrafficReports(sessions, setting, clock.now_s, self.host.report)
        self._vehicles: Mapping[int, MavlinkVehicle] = {}
        self._guardians = Guardians({})

    def _pass_on(self, message: msg.Message) -> None:
        self._send(message)
        if isinstance(message, msg.EventReport):
            self._reports.follow(message.event)
            self._traffic.follow(message.event)

    @property
    def since_boot_s(self) -> float | None:
        """Time since the first vehicle was switched on, s; None if it is not known."""
        first = next(iter(self._vehicles.values()), None)
        return None if first is None else first.view.since_boot_s

    def beat(self) -> msg.Beat:
        """Return the heartbeat: the knowledge that the mission needs if nothing more arrives."""
        return msg.Beat(self.since_boot_s, fates=self._guardians.fates())

    def ready(self, start_s: float | None = None) -> msg.Ready:
        """Return the report on vehicles that are ready; `start_s` if it has begun."""
        views = {number: vehicle.view for number, vehicle in self._vehicles.items()}
        standing = {
            number: view.position
            for number, view in views.items()
            if view.position is not None and not view.armed
        }
        pads = {number: views[number].pad_height for number in standing if views[number].home}
        return msg.Ready(self.since_boot_s, start_s, standing, pads)

    async def run(self) -> None:
        """Fly, take care of the aircraft however that ends, and report the result."""
        failure: Exception | None = None
        try:
            await self._fly()
        except Exception as error:
            failure = error
        fates = self._guardians.fates()
        self._send(ended_by(_first(failure), fates, _text(failure)))

    async def _fly(self) -> None:
        begin = await self._unless_ended(self.host.begin())
        if begin is None:
            return
        self._clock.start_s = begin.t_s
        vehicles = self._vehicles = vehicles_of(
            self._plan, self._setting, self._links, self.host, self._clock.now_s,
            waits_on_ground=begin.waits_on_ground,
        )  # fmt: skip
        before = None
        if not self._plan.simulated:
            before = BeforeFlight(
                begin.preflight, self._setting, self._folder, self._links, self.host.ask,
                keep_fence=begin.keep_fence,
            )  # fmt: skip
        guardians = self._guardians = Guardians({n: v.guardian for n, v in vehicles.items()})
        keeping = asyncio.create_task(guardians.run())
        failure: Exception | None = None
        try:
            try:
                end = await run_beside_keeper(self._mission(vehicles, begin, before), keeping)
            except Exception as error:
                failure, end = error, msg.Finish(f"the mission failed ({failure_text(error)})")
            try:
                await self._looked_after(guardians, end)
            except Exception as error:
                failure = error if failure is None else ExceptionGroup(NOT_HOME, [failure, error])
        finally:
            keeping.cancel()
            await asyncio.gather(keeping, return_exceptions=True)
            if before is not None:
                await before.restore()
        if failure is not None:
            raise failure

    async def _mission(
        self,
        vehicles: Mapping[int, MavlinkVehicle],
        begin: msg.Begin,
        before_flight: BeforeFlight | None,
    ) -> msg.Finish | msg.Leave:
        if await self._unless_ended(self._prepared(vehicles, begin, before_flight)) and (
            fly := await self._unless_ended(self.host.fly(vehicles, self.ready()))
        ):
            self._clock.start_s = fly.start_s
            return await self.host.carry_out()
        return self.host.end.result()

    async def _prepared(
        self,
        vehicles: Mapping[int, MavlinkVehicle],
        begin: msg.Begin,
        before_flight: BeforeFlight | None,
    ) -> bool:
        """Connect to the vehicles, examine and set them; return True when that is done."""
        flew = {number: begin.before.get(number, msg.EarlierFlight()) for number in vehicles}
        for number, vehicle in vehicles.items():
            if flew[number].flew:
                vehicle.resume_flying()
        for number, vehicle in vehicles.items():
            await vehicle.connect()
            if flew[number].returned:
                vehicle.resume_returning()
        require_distinct_aircraft(vehicles)
        if before_flight is not None:
            await reject_other_controllers(self._links, RIVAL_WALL_S * (self._plan.speedup or 1.0))
            await before_flight.prepare()
        return True

    async def _unless_ended(self, waiting: Awaitable[T]) -> T | None:
        """Return the awaited result, None if the mission's last message comes first."""
        task = asyncio.ensure_future(waiting)
        either: list[asyncio.Future[Any]] = [task, self.host.end]
        await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
        if task.done():
            return task.result()
        task.cancel()
        return None

    async def _looked_after(self, guardians: Guardians, end: msg.Finish | msg.Leave) -> None:
        if isinstance(end, msg.Finish):
            home = asyncio.create_task(guardians.bring_home(end.reason))
            left = self.host.left
            either: list[asyncio.Future[Any]] = [home, left]
            await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
            if home.done():
                home.result()
                return
            home.cancel()
            end = left.result()
        await guardians.leave(end.reason)


def _first(failure: Exception | None) -> BaseException | None:
    if isinstance(failure, BaseExceptionGroup) and not is_defect(failure):
        return leaves(failure)[0]
    return failure


def _text(failure: Exception | None) -> str:
    if failure is None:
        return ""
    if is_defect(failure):
        return "".join(traceback.format_exception(failure))
    return failure_text(failure)


@contextlib.asynccontextmanager
async def in_this_process(
    port: Port, plan: FlightPlan, setting: Layout, folder: Path, links: Sequence[Link]
) -> AsyncIterator[None]:
    """Connect the aircraft in the process of their mission: the same messages, as the same
    bytes."""
    to_mission = msg.as_bytes(port.receive)
    side = AircraftSide(plan, setting, folder, links, MissionClock(0.0), to_mission)
    port.connect(msg.as_bytes(side.host.receive))
    running = asyncio.create_task(side.run())
    try:
        yield
    finally:
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
