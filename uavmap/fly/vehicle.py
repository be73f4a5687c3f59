"""A vehicle of the mission: its link, its heartbeat, and the order that it carries out.

    orders -> vehicle.give(order) -> MAVLink -> events

`give` replaces whatever is being carried out (`uavmap.fly.manoeuvres`). What the vehicle does
by itself, a pilot's mode change, a landing, is watched all the time (`uavmap.fly.monitor`), and
so is the link.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import LinkError, leaves
from missions.events import LinkLost, OrderFailed
from missions.ground.grid import Grid
from missions.mission_file.schema import Mission
from missions.orders import Order
from uavmap.fly.imaging import CameraDriver
from uavmap.fly.manoeuvres import READY_S, Crew, Manoeuvres
from uavmap.fly.monitor import Report, Watch
from uavmap.link.autopilots import AUTOPILOTS
from uavmap.link.session import Message, Session

HEARTBEAT_S: Final = 1.0
LINK_LOST_S: Final = 5.0
LINK_GIVEN_UP_S: Final = 120.0
ANSWER_S: Final = 10.0


class MavlinkVehicle:
    """One vehicle of the mission, at the other end of a session.

    `link_lost_s` is how long it may be silent, in seconds of the loop's clock.
    """

    def __init__(
        self,
        number: int,
        name: str,
        session: Session,
        eyes: CameraDriver,
        mission: Mission,
        grid: Grid,
        mission_time_s: Callable[[], float],
        crew: Crew,
        link_lost_s: float = LINK_LOST_S,
    ) -> None:
        self.number = number
        self.name = name
        self._session = session
        self._view = session.view
        self._eyes = eyes
        self._link_lost_s = link_lost_s
        self._watch = Watch(
            number,
            name,
            session.view,
            mission.battery.capacity_wh,
            grid,
            mission_time_s,
            lambda: asyncio.get_running_loop().time(),
        )
        self._manoeuvres = Manoeuvres(session, eyes, self._watch, mission, grid, crew)
        self._tasks: asyncio.TaskGroup | None = None
        self._task: asyncio.Task[None] | None = None

    async def connect(self) -> None:
        """Wait for the vehicle and ask for what the mission needs. Raises `LinkError`."""
        session, view = self._session, self._view
        if not await session.until(lambda: view.autopilot is not None, ANSWER_S):
            raise LinkError(
                f"{self.name}: no vehicle answered within {ANSWER_S:g} s; is it switched on, and "
                "is this the URL that it speaks to?"
            )
        if view.autopilot not in AUTOPILOTS:
            flown = " and ".join(kind.name for kind in AUTOPILOTS.values())
            raise LinkError(
                f"{self.name}: the autopilot is none that this version can fly "
                f"(MAV_AUTOPILOT {view.autopilot}); it flies {flown} copters"
            )
        for message_id, rate_hz in view.kind.streams.items():
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
                raise LinkError(f"{self.name}: the vehicle did not report {missing}")

    async def run(self, report: Report) -> None:
        """Report and carry out orders until cancelled. `connect` comes first."""
        self._watch.report = report
        async with asyncio.TaskGroup() as tasks:
            self._tasks = tasks
            tasks.create_task(self._beat())
            tasks.create_task(self._watch_link())
            self._session.listen(self._on_message)
            self._watch.report_connected()

    def give(self, order: Order) -> None:
        """Carry out an order instead of the present one."""
        if self._tasks is None:
            raise RuntimeError("a vehicle takes orders only while it runs")
        if self._task is not None:
            self._task.cancel()
        self._task = self._tasks.create_task(self._carry_out(order))

    async def _carry_out(self, order: Order) -> None:
        try:
            await self._manoeuvres.carry_out(order)
        except* LinkError as group:
            reason = "; ".join(str(error) for error in leaves(group))
            name = type(order).__name__
            self._watch.report(OrderFailed(self.number, self._watch.t_s(), name, reason))

    def _on_message(self, message: Message) -> None:
        self._watch.on_message(message)
        self._eyes.on_message(message)

    # --- the link ----------------------------------------------------------------------------
    async def _beat(self) -> None:
        while True:
            self._session.heartbeat()
            await asyncio.sleep(HEARTBEAT_S)

    async def _watch_link(self) -> None:
        watch = self._watch
        while True:
            await asyncio.sleep(HEARTBEAT_S)
            if watch.connected and self._silent_s() >= self._link_lost_s:
                watch.connected = False
                watch.report(LinkLost(self.number, watch.t_s()))
            elif not watch.connected and self._silent_s() > LINK_GIVEN_UP_S:
                watch.report(
                    OrderFailed(self.number, watch.t_s(), "link", "the vehicle stayed silent")
                )
                return
            elif not watch.connected and self._hears():
                with contextlib.suppress(LinkError):
                    await self.connect()
                    watch.report_connected()

    def _silent_s(self) -> float:
        """Since when a heartbeat or the position is missing.

        Heartbeats alone are not enough: an autopilot that restarted has forgotten its streams.
        """
        last_s = min(self._view.heard_s, self._view.position_s)
        return asyncio.get_running_loop().time() - last_s

    def _hears(self) -> bool:
        return asyncio.get_running_loop().time() - self._view.heard_s < self._link_lost_s

    def _missing(self, since_s: float) -> str:
        """What the vehicle has yet to tell; a position from before does not count."""
        view = self._view
        return " and ".join(
            what
            for what, known in (
                ("its position", view.position_s >= since_s),
                ("its home", view.home is not None),
                ("its battery's charge", self._watch.remaining_wh() is not None),
            )
            if not known
        )
