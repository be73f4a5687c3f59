"""A vehicle that carries out orders over MAVLink, one at a time.

    orders -> vehicle.give(order) -> MAVLink -> events

`give` replaces whatever is being carried out. What the vehicle does by itself (a pilot takes
over, a failsafe, a landing, a lost link) is watched all the time and reported as events.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import LinkError
from missions.events import (
    Airborne,
    Arrived,
    BatterySwapped,
    Connected,
    Event,
    Landed,
    LinkLost,
    LookEnded,
    OrderFailed,
    Overridden,
    Released,
    Tracked,
)
from missions.grid import Grid
from missions.mission_file import Mission
from missions.orders import (
    AwaitBattery,
    FlyTo,
    Hold,
    Land,
    Look,
    Order,
    StandDown,
    Sweep,
    TakeOff,
)
from missions.units import Cell, GridPoint
from uavmap.eyes import Eyes, Frames
from uavmap.link.session import Message, Session
from uavmap.link.view import GUIDED, LAND
from uavmap.simulation import SIMULATOR_IDENTITY

Report = Callable[[Event], None]
Crew = Callable[[int], Awaitable[None]]
"""Returns once the people on the ground have swapped a vehicle's battery and stand clear."""

HEARTBEAT_S: Final = 1.0
LINK_LOST_S: Final = 5.0
LINK_GIVEN_UP_S: Final = 120.0
ANSWER_S: Final = 10.0
READY_S: Final = 120.0
TRACK_S: Final = 1.0
ARM_TRIES: Final = 10
ARM_PAUSE_S: Final = 3.0
RESEND_S: Final = 3.0
DRIFT_RESEND_S: Final = 0.5
CLIMB_TOLERANCE_M: Final = 0.4
STOP_RADIUS_M: Final = 0.7
PASS_RADIUS_M: Final = 2.0
FULL: Final = 0.9
"""From this part of its capacity on a battery counts as fresh."""

_OFF_GROUND: Final = (
    mav.MAV_LANDED_STATE_TAKEOFF,
    mav.MAV_LANDED_STATE_IN_AIR,
    mav.MAV_LANDED_STATE_LANDING,
)
"""A take-off that is called off goes from the first of these to the last."""

_STREAMS: Final = {
    mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 10.0,
    mav.MAVLINK_MSG_ID_BATTERY_STATUS: 2.0,
    mav.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 2.0,
    mav.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    mav.MAVLINK_MSG_ID_EKF_STATUS_REPORT: 1.0,
}


class MavlinkVehicle:
    """One vehicle of the mission, at the other end of a session."""

    def __init__(
        self,
        number: int,
        name: str,
        session: Session,
        eyes: Eyes,
        mission: Mission,
        grid: Grid,
        mission_time_s: Callable[[], float],
        crew: Crew,
    ) -> None:
        self._crew = crew
        self.number = number
        self.name = name
        self._session = session
        self._view = session.view
        self._eyes = eyes
        self._mission = mission
        self._grid = grid
        self._now_s = mission_time_s
        self._report: Report = lambda event: None
        self._tasks: asyncio.TaskGroup | None = None
        self._task: asyncio.Task[None] | None = None
        self._commanded = GUIDED
        self._mode: int | None = None
        self._armed = False
        self._overridden = False
        self._was_airborne = False
        self._tracked_s = float("-inf")
        self._connected = False
        self._paced = False

    # --- the life of a vehicle -------------------------------------------------------------
    async def connect(self) -> None:
        """Wait for the vehicle and ask for what the mission needs. Raises `LinkError`."""
        session, view = self._session, self._view
        if not await session.until(lambda: view.autopilot is not None, ANSWER_S):
            raise LinkError(
                f"{self.name}: no vehicle answered within {ANSWER_S:g} s; is it switched on, and "
                "is this the URL that it speaks to?"
            )
        if view.autopilot != mav.MAV_AUTOPILOT_ARDUPILOTMEGA:
            raise LinkError(
                f"{self.name}: the autopilot is none that this version can fly "
                f"(MAV_AUTOPILOT {view.autopilot}); it flies ArduPilot copters"
            )
        for message_id, rate_hz in _STREAMS.items():
            await session.message_interval(message_id, rate_hz)
        session.request(mav.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
        begin_s = asyncio.get_running_loop().time()
        while missing := self._missing(begin_s):
            session.request(mav.MAVLINK_MSG_ID_HOME_POSITION)
            if await session.until(lambda: not self._missing(begin_s), 5.0):
                return
            if not self._hears():
                raise LinkError(f"{self.name}: the link was lost while waiting for {missing}")
            if asyncio.get_running_loop().time() - begin_s > READY_S:
                raise LinkError(f"{self.name}: the vehicle does not tell {missing}")

    async def run(self, report: Report) -> None:
        """Report and carry out orders until cancelled. `connect` comes first."""
        self._report = report
        async with asyncio.TaskGroup() as tasks:
            self._tasks = tasks
            tasks.create_task(self._beat())
            tasks.create_task(self._watch_link())
            self._session.listen(self._on_message)
            self._report_connected()

    def give(self, order: Order) -> None:
        """Carry out an order instead of the present one."""
        if self._tasks is None:
            raise RuntimeError("a vehicle takes orders only while it runs")
        if self._task is not None:
            self._task.cancel()
        self._task = self._tasks.create_task(self._carry_out(order))

    # --- what is watched ---------------------------------------------------------------------
    async def _beat(self) -> None:
        while True:
            self._session.heartbeat()
            await asyncio.sleep(HEARTBEAT_S)

    async def _watch_link(self) -> None:
        while True:
            await asyncio.sleep(HEARTBEAT_S)
            if self._connected and self._silent_s() >= LINK_LOST_S:
                self._connected = False
                self._report(LinkLost(self.number, self._t_s()))
            elif not self._connected and self._silent_s() > LINK_GIVEN_UP_S:
                self._report(
                    OrderFailed(self.number, self._t_s(), "link", "the vehicle stayed silent")
                )
                return
            elif not self._connected and self._hears():
                with contextlib.suppress(LinkError):
                    await self.connect()
                    self._report_connected()

    def _silent_s(self) -> float:
        """Since when a heartbeat or the position is missing.

        Heartbeats alone are not enough: an autopilot that restarted has forgotten its streams.
        """
        last_s = min(self._view.heard_s, self._view.position_s)
        return asyncio.get_running_loop().time() - last_s

    def _hears(self) -> bool:
        return asyncio.get_running_loop().time() - self._view.heard_s < LINK_LOST_S

    def _missing(self, since_s: float) -> str:
        """What the vehicle has yet to tell; a position from before does not count."""
        view = self._view
        return " and ".join(
            what
            for what, known in (
                ("its position", view.position_s >= since_s),
                ("its home", view.home is not None),
                ("its battery's charge", self._remaining_wh() is not None),
            )
            if not known
        )

    def _on_message(self, message: Message) -> None:
        name = message.get_type()
        if name == "HEARTBEAT":
            self._watch_mode()
        elif name == "GLOBAL_POSITION_INT":
            self._track()
        self._watch_landing()
        self._eyes.on_message(message)

    def _watch_mode(self) -> None:
        """The pilot has the last word: a mode that we did not ask for ends our say."""
        mode, armed = self._view.mode, self._view.armed
        if not self._connected or (mode, armed) == (self._mode, self._armed):
            return
        turned, self._mode, self._armed = mode != self._mode, mode, armed
        self._paced = self._paced and not turned
        if self._overridden:
            if turned and mode == GUIDED and self._view.armed:
                self._overridden = False
                self._commanded = GUIDED
                self._report(Released(self.number, self._t_s(), self._position(), self._height_m()))
        elif mode != self._commanded and self._view.armed:
            self._overridden = True
            self._report(Overridden(self.number, self._t_s(), self._view.mode_name))

    def _watch_landing(self) -> None:
        if not self._connected:
            return
        if self._view.on_ground and self._was_airborne:
            self._was_airborne = False
            self._report(Landed(self.number, self._t_s(), self._remaining()))
        elif self._view.landed_state in _OFF_GROUND and self._view.armed:
            self._was_airborne = True

    def _track(self) -> None:
        now_s = self._now_s()
        if self._connected and now_s - self._tracked_s >= TRACK_S - 1e-6:
            self._tracked_s = now_s
            self._report(
                Tracked(
                    self.number, self._t_s(), self._position(), self._height_m(), self._remaining()
                )
            )

    def _report_connected(self) -> None:
        view = self._view
        airborne = view.armed and view.landed_state != mav.MAV_LANDED_STATE_ON_GROUND
        self._connected = True
        self._paced = False
        self._mode, self._armed = view.mode, view.armed
        self._was_airborne = airborne
        ours = view.mode == GUIDED
        self._overridden = airborne and not ours
        home = self._grid.fixed(view.home) if view.home is not None else GridPoint(0.0, 0.0)
        self._report(
            Connected(
                self.number,
                self._t_s(),
                _rounded(home),
                self._position(),
                self._height_m(),
                airborne,
                ours,
                self._remaining(),
            )
        )

    # --- what it knows, rounded for the journal ----------------------------------------------
    def _t_s(self) -> float:
        return round(self._now_s(), 3)

    def _position(self) -> GridPoint:
        if self._view.position is None:
            raise LinkError(f"{self.name}: the vehicle has not said where it is")
        return _rounded(self._grid.fixed(self._view.position))

    def _height_m(self) -> float:
        return round(self._view.height_m, 2)

    def _remaining_wh(self) -> float | None:
        return self._view.remaining_wh(self._mission.battery.capacity_wh)

    def _remaining(self) -> float:
        return round(self._remaining_wh() or 0.0, 3)

    # --- orders ------------------------------------------------------------------------------
    async def _carry_out(self, order: Order) -> None:
        try:
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
                case AwaitBattery():
                    await self._await_battery()
                case Hold():
                    await self._hold()
                case StandDown():
                    pass
        except* LinkError as group:
            reason = "; ".join(str(error) for error in _leaves(group))
            self._report(OrderFailed(self.number, self._t_s(), type(order).__name__, reason))

    async def _take_off(self, order: TakeOff) -> None:
        if not await self._session.until(lambda: self._view.ready_to_arm, READY_S):
            raise LinkError(f"not ready to arm within {READY_S:g} s{self._view.recent_texts()}")
        for attempt in range(ARM_TRIES):
            try:
                self._commanded = GUIDED
                await self._session.command(
                    mav.MAV_CMD_DO_SET_MODE, mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, GUIDED
                )
                await self._session.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1)
                break
            except LinkError:
                if attempt == ARM_TRIES - 1:
                    raise
                await asyncio.sleep(ARM_PAUSE_S)
        await self._session.command(mav.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, order.height_m)
        reached = order.height_m - CLIMB_TOLERANCE_M
        if not await self._session.until(
            lambda: self._view.height_m >= reached, 60.0 + 3.0 * order.height_m
        ):
            raise LinkError(f"did not climb to {order.height_m:g} m{self._view.recent_texts()}")
        self._report(Airborne(self.number, self._t_s()))

    async def _fly_to(self, order: FlyTo) -> None:
        last = len(order.route) - 1 if order.cell is None else len(order.route)
        for index, point in enumerate(order.route):
            # a corner of the fence is not cut: the vehicle comes to rest there
            stop = order.stop or index != last
            await self._reach(lambda p=point: p, order.height_m, stop=stop)  # type: ignore[misc]
        if order.cell is not None:
            await self._reach(self._follow(order.cell), order.height_m, stop=order.stop)
        self._report(Arrived(self.number, self._t_s(), self._position()))

    def _follow(self, cell: Cell) -> Callable[[], GridPoint]:
        """Where a drifting cell is, whenever asked."""
        centre = self._grid.centre_of(cell)
        return lambda: self._grid.to_fixed(centre, self._now_s())

    async def _reach(self, target: Callable[[], GridPoint], height_m: float, *, stop: bool) -> None:
        """Fly to a point that may move, until there (and slow, if it is to stop)."""
        drift_m_s = self._grid.drift_speed_m_s
        radius_m = STOP_RADIUS_M if stop else min(PASS_RADIUS_M, 0.5 * self._grid.cell_m)
        slow_m_s = self._mission.flight.settle_m_s + drift_m_s

        def there() -> bool:
            off_m = self._position().distance_to(target())
            return off_m <= radius_m and (not stop or self._view.ground_speed_m_s <= slow_m_s)

        pause_s = DRIFT_RESEND_S if drift_m_s > 0.0 else RESEND_S
        while True:
            await self._aim(target(), height_m)
            if await self._session.until(there, pause_s):
                return

    async def _aim(self, point: GridPoint, height_m: float) -> None:
        """MAV_CMD_DO_REPOSITION: acknowledged, and refused unless the vehicle follows us."""
        if not self._paced:  # a mode change has put the vehicle's own speed back
            await self._session.command(
                mav.MAV_CMD_DO_CHANGE_SPEED, 1, self._mission.flight.speed_m_s, -1
            )
            self._paced = True
        position = self._grid.position(point)
        await self._session.command_at(
            mav.MAV_CMD_DO_REPOSITION,
            mav.MAV_FRAME_GLOBAL_RELATIVE_ALT,
            (-1.0, 0.0, 0.0, float("nan")),
            position.lat_deg,
            position.lon_deg,
            height_m,
        )

    async def _sweep(self, order: Sweep) -> None:
        speed = self._mission.flight.speed_m_s
        async with self._eyes.every(order.every_m / speed) as frames, asyncio.TaskGroup() as tasks:
            watching = tasks.create_task(self._watch_frames(frames, None))
            await self._reach(lambda: order.end, order.height_m, stop=False)
            await frames.finish()
            watching.cancel()
        self._report(Arrived(self.number, self._t_s(), self._position()))

    async def _look(self, order: Look) -> None:
        follow: asyncio.Task[None] | None = None
        async with asyncio.TaskGroup() as tasks:
            if self._grid.drift_speed_m_s > 0.0:
                follow = tasks.create_task(self._stay_over(order))
            async with self._eyes.burst(order.frames) as frames:
                await self._watch_frames(frames, order.cell)
            if follow is not None:
                follow.cancel()
        self._report(LookEnded(self.number, self._t_s()))

    async def _stay_over(self, order: Look) -> None:
        target = self._follow(order.cell)
        while True:
            await self._aim(target(), order.height_m)
            await asyncio.sleep(DRIFT_RESEND_S)

    async def _watch_frames(self, frames: Frames, vantage: Cell | None) -> None:
        """Judge each frame as it comes; the mission may call us off after any of them."""
        async for event in frames.judged(vantage):
            self._report(event)
            await asyncio.sleep(0)

    async def _land(self) -> None:
        self._commanded = LAND
        await self._session.command(mav.MAV_CMD_NAV_LAND)
        # touch-down and disarming are watched for all the time

    async def _await_battery(self) -> None:
        if self._view.identity != SIMULATOR_IDENTITY:
            await self._crew(self.number)
        full_wh = FULL * self._mission.battery.capacity_wh
        await self._session.until(lambda: (self._remaining_wh() or 0.0) >= full_wh)
        self._report(BatterySwapped(self.number, self._t_s(), self._remaining()))

    async def _hold(self) -> None:
        if self._view.armed:
            await self._aim(self._position(), self._view.height_m)


def _rounded(point: GridPoint) -> GridPoint:
    return GridPoint(round(point.east_m, 2), round(point.north_m, 2))


def _leaves(group: BaseExceptionGroup[BaseException]) -> list[BaseException]:
    """The single errors of a group, however nested."""
    found: list[BaseException] = []
    for error in group.exceptions:
        found += _leaves(error) if isinstance(error, BaseExceptionGroup) else [error]
    return found
