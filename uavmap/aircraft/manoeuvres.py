"""The execution of a vehicle's orders: the commands, and the end of each order.

One order runs at a time, cancelled by the next. A command without an acknowledgement is sent again
while the link works (`uavmap.aircraft.vehicle`). Only a refusal, or a failure that the vehicle
shows, ends an order.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from typing import Final

from missions.errors import CommandRefusedError, LinkError
from missions.events import Arrived, LookEnded
from missions.mission.schema import Mission
from missions.orders import (
    AwaitBattery,
    FlyPath,
    FlyTo,
    Hold,
    Land,
    Look,
    Order,
    ReturnToLaunch,
    StandDown,
    Sweep,
    TakeOff,
)
from missions.units import Cell, GridPoint
from uavmap.aircraft.control import AirState
from uavmap.aircraft.controlled_commands import MAX_MODE_CHANGE_S, ControlledCommands
from uavmap.aircraft.imaging.frames import Frames
from uavmap.aircraft.imaging.imaging import CameraDriver
from uavmap.aircraft.legs import OTHER_LAYER_M, SpeedWatch, aim_over_ground, at_height
from uavmap.aircraft.map_navigation import Navigation
from uavmap.aircraft.pad import Crew, Pad, insist
from uavmap.aircraft.path_stream import PathStream, StreamTimeout
from uavmap.aircraft.reporter import Reporter

NAVIGATION_INTERVAL_S: Final = 0.5
"""Interval between two pictures on a leg, if a vehicle may need them to navigate, s."""
SATELLITE_ERROR_M_S: Final = 1.0
"""Speed of a satellites' error that a map follows, m/s."""
MAX_DESCENT_S: Final = 12.0
"""Maximum time of a descent to that height, s; after it the vehicle lands from its place."""
LOW_M: Final = 4.0
"""Height below which pictures show too little for navigation, m."""
RESEND_S: Final = 3.0
DRIFT_RESEND_S: Final = 0.5
STOP_RADIUS_M: Final = 0.7
PASS_RADIUS_M: Final = 2.0


class Manoeuvres:
    """Carries out orders with a session, watched by a monitor."""

    def __init__(
        self,
        commands: ControlledCommands,
        camera: CameraDriver,
        reporter: Reporter,
        mission: Mission,
        crew: Crew,
        *,
        by_places: bool = False,
    ) -> None:
        self._session, self._monitor = commands.session, commands.monitor
        self._commands = commands
        self._view = commands.session.view
        self._camera = camera
        self._reporter = reporter
        self._mission = mission
        self._grid = reporter.grid
        self._pad = Pad(commands, reporter, mission.battery.capacity_wh, crew)
        self._stream = PathStream(commands, reporter, by_places=by_places)
        timeout = StreamTimeout(reporter.name, commands.session, reporter.line)
        self._timeout = None if by_places else timeout
        self._on_path = False
        """True while a path is flown that another may replace on its way."""
        self._paced_in: int | None = None
        self.under_way: Callable[[Order, GridPoint], None] = lambda order, target: None
        """Called when a sweep begins to move (its camera starts first, which may take a while).

        Also called when the first target of an order was acknowledged: until then an older one is
        flown.
        """
        self.navigation: Navigation | None = None
        self._order: Order | None = None
        self._aimed = False

    async def carry_out(self, order: Order) -> None:
        """Carry out an order to its end. Raises `LinkError`, alone or in a group."""
        self._order, self._aimed = order, False
        if not isinstance(order, FlyPath | StandDown):
            await self._leave_path()
        match order:
            case FlyPath():
                await self._fly_path(order)
            case TakeOff():
                await self._pad.take_off(order)
            case FlyTo():
                await self._fly_to(order)
            case Sweep():
                await self._sweep(order)
            case Look():
                await self._look(order)
            case Land():
                await self._land()
            case AwaitBattery():
                await self._pad.swap_battery()
            case Hold():
                await self._hold()
            case StandDown() | ReturnToLaunch():  # a return by itself belongs to the guardian
                pass

    # --- along --------------------------------------------------------------------------------
    async def _fly_to(self, order: FlyTo) -> None:
        if self.navigation is None or not self.navigation.watches:
            await self._fly_route(order)
        else:
            async with asyncio.TaskGroup() as tasks:
                looking = tasks.create_task(self._take_navigation_frames())
                await self._fly_route(order)
                looking.cancel()
        self._report_arrival()

    async def _take_navigation_frames(self) -> None:
        """Take pictures for navigation, until cancelled; no map depends on them."""
        with contextlib.suppress(LinkError):
            async with self._camera.to_navigate(NAVIGATION_INTERVAL_S) as frames:
                async for _ in frames.judged(None):
                    pass

    async def _fly_route(self, order: FlyTo) -> None:
        last = len(order.route) - 1 if order.cell is None else len(order.route)
        for index, point in enumerate(order.route):
            # a corner of the fence is not cut: the vehicle comes to rest there
            stop = order.stop or index != last
            await self._reach(lambda p=point: p, order.height_m, stop=stop)  # type: ignore[misc]
        if order.cell is not None:
            await self._reach(self._follow(order.cell), order.height_m, stop=order.stop)

    def _report_arrival(self) -> None:
        self._reporter.report_now(Arrived, self._reporter.position())

    def _follow(self, cell: Cell) -> Callable[[], GridPoint]:
        centre = self._grid.centre_of(cell)
        return lambda: self._grid.to_fixed(centre, self._reporter.now_s())

    async def _reach(self, target: Callable[[], GridPoint], height_m: float, *, stop: bool) -> None:
        """Fly to a point that may move, until there (and slow, for a stop)."""
        drift_m_s = self._grid.drift_speed_m_s
        radius_m = STOP_RADIUS_M if stop else min(PASS_RADIUS_M, 0.5 * self._grid.cell_m)
        slow_m_s = self._mission.flight.settle_m_s + drift_m_s

        layer_too = stop and abs(self._view.height_m - height_m) > OTHER_LAYER_M

        def there() -> bool:
            off_m = self._reporter.position().distance_to(target())
            # false satellites report a movement that does not exist
            lie_m_s = SATELLITE_ERROR_M_S if self._goes_by_map else 0.0
            rests = not stop or (
                self._view.ground_speed_m_s <= slow_m_s + lie_m_s
                and at_height(self._view, height_m, always=layer_too)
            )
            return off_m <= radius_m and rests

        moves = drift_m_s > 0.0 or self._view.ground is not None

        def pause_s() -> float:
            return DRIFT_RESEND_S if moves or self._goes_by_map else RESEND_S

        ordered_m_s, begin_s = self._mission.flight.speed_m_s, self._reporter.now_s()
        watch = SpeedWatch(self._reporter.name, self._view, ordered_m_s, begin_s)
        while True:
            await insist(lambda: self._aim(target(), height_m))
            if await self._session.until(there, pause_s()):
                return
            left_m = self._reporter.position().distance_to(target())
            if reason := watch.wrong(self._reporter.now_s(), left_m):
                self._reporter.line(reason)
                self._paced_in = None  # the speed is sent again after the next target

    @property
    def _goes_by_map(self) -> bool:
        """True if its pictures correct the autopilot's place repeatedly."""
        return self.navigation is not None and self.navigation.by_map

    async def _aim(self, point: GridPoint, height_m: float) -> None:
        """Command a target, and then the speed, which an ArduCopter resets at its first target."""
        aim, aim_m = aim_over_ground(self._view, self._reporter.position(), point, height_m)
        await self._commands.fly_to(self._grid.position(aim), aim_m)
        if not self._aimed and self._order is not None:
            self._aimed = True
            self.under_way(self._order, point)
        changes = self._monitor.control.mode_changes
        if self._paced_in != changes:
            await self._commands.speed(self._mission.flight.speed_m_s)
            self._paced_in = changes

    async def _hold(self) -> None:
        """Stay here, until that is seen: the acknowledgement may be a late one, of the leg
        before."""
        if self._view.armed:
            here, height_m = self._reporter.position(), self._view.height_m
            await self._reach(lambda: here, height_m, stop=True)
            if self.navigation is not None and self.navigation.watches_at_rest:
                await self._take_navigation_frames()  # until the next order

    # --- along a path -------------------------------------------------------------------------
    def goes_on(self, order: FlyPath) -> bool:
        """Fly a path after the present one, without a halt; return False if none is flown now."""
        if self._on_path:
            self._stream.go_on(order)
            self._order = order
        return self._on_path

    def called_off(self) -> None:
        """Note the end of an order: a path can only begin anew."""
        self._on_path = False

    async def _leave_path(self) -> None:
        if await self._stream.leave():
            self._paced_in = None  # the next target is of another kind, and resets the speed

    async def _fly_path(self, order: FlyPath) -> None:
        """Stream setpoints, and take pictures beside it.

        At the end wait for the pictures, and fly a path that comes meanwhile.
        """
        self._stream.begin(order)
        self._on_path = True
        end = order.trajectory.at(order.trajectory.end_s).place
        self.under_way(order, end)
        async with asyncio.TaskGroup() as tasks:
            beside = [
                tasks.create_task(self._stream.run()),
                *([tasks.create_task(self._timeout.shorten())] if self._timeout else []),
            ]
            async with self._camera.every(order.every_s, anywhere=True) as frames:
                watching = tasks.create_task(self._watch_frames(frames, None))
                await self._photograph_path(frames)
                watching.cancel()
            self._on_path = False
            for task in beside:
                task.cancel()
        for lost in frames.left_over():
            self._reporter.report(lost)
        await self._leave_path()
        self._report_arrival()

    async def _photograph_path(self, frames: Frames) -> None:
        stream, session = self._stream, self._session
        while True:
            await session.until(lambda: self._at_end() or stream.order.every_s != frames.interval_s)
            if self._at_end() and await self._judged_to_the_end(frames):
                return
            await frames.go_on(stream.order.every_s)

    async def _judged_to_the_end(self, frames: Frames) -> bool:
        """Wait for the pictures that are under way; return False if another path has come
        meanwhile."""
        course = self._stream.course
        async with asyncio.TaskGroup() as tasks:
            ending = tasks.create_task(frames.finish())
            await self._session.until(lambda: ending.done() or self._stream.course is not course)
            ending.cancel()
        return self._stream.course is course

    def _at_end(self) -> bool:
        if not self._stream.there():
            return False
        end = self._stream.course.at(self._reporter.now_s()).place
        slow_m_s = self._mission.flight.settle_m_s + self._grid.drift_speed_m_s
        off_m = self._reporter.position().distance_to(end)
        return off_m <= STOP_RADIUS_M and self._view.ground_speed_m_s <= slow_m_s

    # --- looking ------------------------------------------------------------------------------
    async def _sweep(self, order: Sweep) -> None:
        speed = self._mission.flight.speed_m_s
        async with (
            self._camera.every(order.every_m / speed) as frames,
            asyncio.TaskGroup() as tasks,
        ):
            watching = tasks.create_task(self._watch_frames(frames, None))
            self.under_way(order, order.end)
            await self._reach(lambda: order.end, order.height_m, stop=False)
            await frames.finish()
            watching.cancel()
        for lost in frames.left_over():
            self._reporter.report(lost)
        self._report_arrival()

    async def _look(self, order: Look) -> None:
        follow: asyncio.Task[None] | None = None
        async with asyncio.TaskGroup() as tasks:
            if self._grid.drift_speed_m_s > 0.0:
                follow = tasks.create_task(self._stay_over(order))
            async with self._camera.burst(order.frames) as frames:
                await self._watch_frames(frames, order.cell)
            if follow is not None:
                follow.cancel()
        self._reporter.report_now(LookEnded)

    async def _stay_over(self, order: Look) -> None:
        target = self._follow(order.cell)
        while True:
            await insist(lambda: self._aim(target(), order.height_m))
            await asyncio.sleep(DRIFT_RESEND_S)

    async def _watch_frames(self, frames: Frames, vantage: Cell | None) -> None:
        """Have each frame judged as it comes; another order may follow from any of them."""
        async for lost in frames.judged(vantage):
            if lost is not None:
                self._reporter.report(lost)

    # --- down ---------------------------------------------------------------------------------
    async def _land(self) -> None:
        if self._goes_by_map:
            await self._sink_by_map()
        kind, monitor = self._view.kind, self._monitor
        stood = not monitor.control.armed and not monitor.control.air.may_be_up
        landing = lambda: self._view.mode == kind.land  # noqa: E731
        await insist(lambda: self._commands.land(landing))
        # touch-down and disarming are watched all the time; a take-off that was cancelled in time
        # never left the ground
        if stood:
            await self._session.until(landing, MAX_MODE_CHANGE_S)
            if not monitor.control.armed and monitor.control.air is AirState.ON_GROUND:
                monitor.report_landing()

    async def _sink_by_map(self) -> None:
        """Descend to where a landing takes a few seconds: it would follow the satellites' error."""
        if self._view.height_m <= LOW_M + OTHER_LAYER_M:
            return
        here = self._reporter.position()
        with contextlib.suppress(CommandRefusedError):
            async with asyncio.TaskGroup() as tasks:
                looking = tasks.create_task(self._take_navigation_frames())
                for _ in range(round(MAX_DESCENT_S / DRIFT_RESEND_S)):
                    await insist(lambda: self._aim(here, LOW_M))
                    low = self._view.height_m <= LOW_M + OTHER_LAYER_M
                    if low or not self._goes_by_map:
                        break
                    await asyncio.sleep(DRIFT_RESEND_S)
                looking.cancel()
