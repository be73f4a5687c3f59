"""How a vehicle carries out its orders: what is sent, and when an order is done.

One order at a time; whoever runs a manoeuvre cancels it to replace it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import CommandRefusedError, LinkError
from missions.events import Airborne, Arrived, BatterySwapped, Landed, LookEnded
from missions.ground.grid import Grid
from missions.mission_file.schema import Mission
from missions.orders import (
    AwaitBattery,
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
from uavmap.fly.imaging import CameraDriver, Frames
from uavmap.fly.monitor import Watch
from uavmap.link.session import Session

Crew = Callable[[int], Awaitable[None]]
"""Returns once the people on the ground have swapped a vehicle's battery and stand clear."""

READY_S: Final = 120.0
ARM_TRIES: Final = 10
ARM_PAUSE_S: Final = 3.0
RESEND_S: Final = 3.0
DRIFT_RESEND_S: Final = 0.5
CLIMB_TOLERANCE_M: Final = 0.4
STOP_RADIUS_M: Final = 0.7
PASS_RADIUS_M: Final = 2.0
HOME_S: Final = 5.0
"""A position above the home that arming has set comes within this time."""
GROUND_S: Final = 15.0
"""A vehicle that is told to land and has not left the ground says so within this time."""
FULL: Final = 0.9
"""From this part of its capacity on a battery counts as fresh."""


class Manoeuvres:
    """Carries out orders with a session, under the eyes of a watch."""

    def __init__(
        self,
        session: Session,
        eyes: CameraDriver,
        watch: Watch,
        mission: Mission,
        grid: Grid,
        crew: Crew,
    ) -> None:
        self._session = session
        self._view = session.view
        self._eyes = eyes
        self._watch = watch
        self._mission = mission
        self._grid = grid
        self._crew = crew
        self._paced_in: int | None = None

    async def carry_out(self, order: Order) -> None:
        """Carry out an order to its end. Raises `LinkError`, alone or in a group."""
        match order:
            case TakeOff():
                await self._take_off(order)
            case FlyTo():
                await self._fly_to(order)
            case Sweep():
                await self._sweep(order)
            case Look():
                await self._look(order)
            case Land():
                await self._land()
            case ReturnToLaunch():
                self._watch.commanded = (self._view.kind.rtl,)
                await self._session.command(mav.MAV_CMD_NAV_RETURN_TO_LAUNCH)
            case AwaitBattery():
                await self._await_battery()
            case Hold():
                await self._hold()
            case StandDown():
                pass

    async def _take_off(self, order: TakeOff) -> None:
        if not await self._session.until(lambda: self._view.ready_to_arm, READY_S):
            raise LinkError(f"not ready to arm within {READY_S:g} s{self._view.recent_texts()}")
        kind = self._view.kind
        for attempt in range(ARM_TRIES):
            try:
                self._watch.commanded = kind.ours
                await self._session.command(mav.MAV_CMD_DO_SET_MODE, *kind.follow_params)
                await self._session.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1)
                break
            except LinkError:
                if attempt == ARM_TRIES - 1:
                    raise
                await asyncio.sleep(ARM_PAUSE_S)
        if kind.amsl:  # arming has moved home, and the height is to be above the new one
            armed_s = asyncio.get_running_loop().time()
            await self._session.until(lambda: self._view.position_s > armed_s, HOME_S)
        blank = kind.unused_param
        _, wire_m = kind.altitude_on_wire(order.height_m, self._view.home_amsl_m)
        await self._session.command(mav.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, blank, blank, blank, wire_m)
        reached = order.height_m - CLIMB_TOLERANCE_M
        if not await self._session.until(
            lambda: self._view.height_m >= reached and self._view.mode == kind.follows,
            60.0 + 3.0 * order.height_m,
        ):
            raise LinkError(f"did not climb to {order.height_m:g} m{self._view.recent_texts()}")
        self._watch.report(Airborne(self._watch.number, self._watch.t_s()))

    async def _fly_to(self, order: FlyTo) -> None:
        last = len(order.route) - 1 if order.cell is None else len(order.route)
        for index, point in enumerate(order.route):
            # a corner of the fence is not cut: the vehicle comes to rest there
            stop = order.stop or index != last
            await self._reach(lambda p=point: p, order.height_m, stop=stop)  # type: ignore[misc]
        if order.cell is not None:
            await self._reach(self._follow(order.cell), order.height_m, stop=order.stop)
        self._watch.report(Arrived(self._watch.number, self._watch.t_s(), self._watch.position()))

    def _follow(self, cell: Cell) -> Callable[[], GridPoint]:
        """Where a drifting cell is, whenever asked."""
        centre = self._grid.centre_of(cell)
        return lambda: self._grid.to_fixed(centre, self._watch.now_s())

    async def _reach(self, target: Callable[[], GridPoint], height_m: float, *, stop: bool) -> None:
        """Fly to a point that may move, until there (and slow, if it is to stop)."""
        drift_m_s = self._grid.drift_speed_m_s
        radius_m = STOP_RADIUS_M if stop else min(PASS_RADIUS_M, 0.5 * self._grid.cell_m)
        slow_m_s = self._mission.flight.settle_m_s + drift_m_s

        def there() -> bool:
            off_m = self._watch.position().distance_to(target())
            return off_m <= radius_m and (not stop or self._view.ground_speed_m_s <= slow_m_s)

        pause_s = DRIFT_RESEND_S if drift_m_s > 0.0 else RESEND_S
        while True:
            try:
                await self._aim(target(), height_m)
            except CommandRefusedError:
                raise
            except LinkError:
                pass  # no answer: ask again, for as long as the watch on the link calls it alive
            if await self._session.until(there, pause_s):
                return

    async def _aim(self, point: GridPoint, height_m: float) -> None:
        """MAV_CMD_DO_REPOSITION: acknowledged, and refused unless the vehicle follows us."""
        if self._paced_in != self._watch.mode_changes:  # that put the vehicle's own speed back
            changes = self._watch.mode_changes
            await self._session.command(
                mav.MAV_CMD_DO_CHANGE_SPEED, 1, self._mission.flight.speed_m_s, -1
            )
            self._paced_in = changes
        position = self._grid.position(point)
        frame, wire_m = self._view.kind.altitude_on_wire(height_m, self._view.home_amsl_m)
        await self._session.command_at(
            mav.MAV_CMD_DO_REPOSITION,
            frame,
            (-1.0, 0.0, 0.0, float("nan")),
            position.lat_deg,
            position.lon_deg,
            wire_m,
        )

    async def _sweep(self, order: Sweep) -> None:
        speed = self._mission.flight.speed_m_s
        async with self._eyes.every(order.every_m / speed) as frames, asyncio.TaskGroup() as tasks:
            watching = tasks.create_task(self._watch_frames(frames, None))
            await self._reach(lambda: order.end, order.height_m, stop=False)
            await frames.finish()
            watching.cancel()
        self._watch.report(Arrived(self._watch.number, self._watch.t_s(), self._watch.position()))

    async def _look(self, order: Look) -> None:
        follow: asyncio.Task[None] | None = None
        async with asyncio.TaskGroup() as tasks:
            if self._grid.drift_speed_m_s > 0.0:
                follow = tasks.create_task(self._stay_over(order))
            async with self._eyes.burst(order.frames) as frames:
                await self._watch_frames(frames, order.cell)
            if follow is not None:
                follow.cancel()
        self._watch.report(LookEnded(self._watch.number, self._watch.t_s()))

    async def _stay_over(self, order: Look) -> None:
        target = self._follow(order.cell)
        while True:
            await self._aim(target(), order.height_m)
            await asyncio.sleep(DRIFT_RESEND_S)

    async def _watch_frames(self, frames: Frames, vantage: Cell | None) -> None:
        """Judge each frame as it comes; the mission may call us off after any of them."""
        async for event in frames.judged(vantage):
            self._watch.report(event)
            await asyncio.sleep(0)

    async def _land(self) -> None:
        self._watch.commanded = (self._view.kind.land,)
        await self._session.command(mav.MAV_CMD_NAV_LAND)
        # touch-down and disarming are watched for all the time; but a take-off that was called
        # off in time never left the ground
        if not self._watch.was_airborne:
            await self._session.until(
                lambda: self._view.on_ground or self._watch.was_airborne, GROUND_S
            )
            if self._view.on_ground and not self._watch.was_airborne:
                self._watch.report(
                    Landed(self._watch.number, self._watch.t_s(), self._watch.remaining())
                )

    async def _await_battery(self) -> None:
        if not self._view.is_simulator:
            await self._crew(self._watch.number)
        full_wh = FULL * self._mission.battery.capacity_wh
        await self._session.until(lambda: (self._watch.remaining_wh() or 0.0) >= full_wh)
        self._watch.report(
            BatterySwapped(self._watch.number, self._watch.t_s(), self._watch.remaining())
        )

    async def _hold(self) -> None:
        if self._view.armed:
            await self._aim(self._watch.position(), self._view.height_m)
