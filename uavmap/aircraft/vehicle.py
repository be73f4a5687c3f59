"""A vehicle of the mission: its link, its heartbeat, and the order that it carries out.

    orders -> vehicle.give(order) -> MAVLink -> events

`give` replaces the present order (`uavmap.aircraft.manoeuvres`). The vehicle's own actions, a
pilot's mode change, a landing, are watched all the time (`uavmap.aircraft.guardian.monitor`), and
so is the link. Its guardian (`uavmap.aircraft.guardian.guardian`) receives every order, and may
take control of the vehicle.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import CommandRefusedError, LinkError, leaves
from missions.events import GivenUp, LinkLost, OrderFailed
from missions.guardian import Limits
from missions.mission.layout import Layout
from missions.orders import FlyPath, Order, ReturnToLaunch
from missions.planning.leapfrog_geometry import Role
from missions.units import LatLon
from uavmap.aircraft.autopilot_texts import AutopilotTexts
from uavmap.aircraft.controlled_commands import ControlledCommands, NotInControlError
from uavmap.aircraft.guarded_tasks import GuardedTasks
from uavmap.aircraft.guardian.guardian import Guardian
from uavmap.aircraft.guardian.monitor import Monitor
from uavmap.aircraft.imaging.imaging import CameraDriver
from uavmap.aircraft.leapfrog_sight import Leapfrog
from uavmap.aircraft.manoeuvres import Manoeuvres
from uavmap.aircraft.map_navigation import Navigation
from uavmap.aircraft.pad import READY_S, Crew, Waiting
from uavmap.aircraft.reporter import BATTERY_STALE_S, Report, Reporter
from uavmap.aircraft.telemetry_streams import Streams
from uavmap.base.clock import ClockRate
from uavmap.mavlink.identity import wait_for_autopilot
from uavmap.mavlink.session import Session
from uavmap.mavlink.vehicle_view import GroundBelow, VehicleView

LINK_LOST_S: Final = 5.0
MAX_RECONNECTION_S: Final = 2.5
"""Maximum wait for a heartbeat and a position of a vehicle that is back, s."""
SILENCE_AFTER_BATTERY_S: Final = 60.0
"""Wait after its battery must be empty before a silent vehicle is given up, s."""
SILENCE_ON_GROUND_S: Final = 120.0
"""Maximum wait for a silent vehicle on the ground without a crew beside it, s."""


class MavlinkVehicle:
    """One vehicle of the mission, at the other end of a session.

    `link_lost_s`: maximum silence, s of the loop's clock. `ground_patience_s`: maximum wait for a
    silent vehicle on the ground, s; None: as long as a crew takes.
    """

    def __init__(
        self,
        number: int,
        name: str,
        session: Session,
        camera: CameraDriver,
        setting: Layout,
        mission_time_s: Callable[[], float],
        crew: Crew,
        link_lost_s: float = LINK_LOST_S,
        *,
        battery_stale_s: float = BATTERY_STALE_S,
        ground_patience_s: float | None = SILENCE_ON_GROUND_S,
        slack_s: float = 0.0,
        by_places: bool = False,
        tell: Callable[[str], None] = lambda text: None,
        clock_rate: ClockRate | None = None,
    ) -> None:
        self.number = number
        self.name = name
        self._session = session
        self._view = session.view
        if setting.ground is not None:
            session.view.ground = GroundBelow(setting.ground, setting.grid)
        self._camera = camera
        self._setting = setting
        self._link_lost_s = session.view.gate.clock.limit_s = link_lost_s
        self._ground_patience_s = ground_patience_s
        self._clock_rate = clock_rate
        self._reporter = Reporter(
            number,
            name,
            session.view,
            setting.mission.battery.capacity_wh,
            setting.grid,
            mission_time_s,
            lambda: asyncio.get_running_loop().time(),
            battery_stale_s,
            tell,
        )
        self._monitor = Monitor(self._reporter)
        self._monitor.why = AutopilotTexts(self._reporter).cause_of
        limits = Limits(setting.fence, setting.energy, slack_s, setting.relief_m)
        self.guardian = Guardian(session, self._reporter, self._monitor, limits)
        self.guardian.stand_aside = self._stand_aside
        self.guardian.order_failed = self._order_failed
        self._commands = ControlledCommands(session, self._monitor)
        self._manoeuvres = Manoeuvres(
            self._commands, camera, self._reporter, setting.mission, crew, by_places=by_places
        )
        self._navigation = Navigation(self._reporter, setting.mission)
        self._navigation.act = self.guardian.take_over
        self._navigation.fail = self._order_failed
        self._navigation.aid = self._aid
        self._monitor.navigation = self._manoeuvres.navigation = self._navigation
        camera.navigation = self._navigation if self._navigation.watches else None
        self._aiding: asyncio.Task[None] | None = None
        self._aids = True
        """True while its autopilot is known to accept a position from outside."""
        self._manoeuvres.under_way = lambda order, target: self.guardian.note_task(
            self._guarded_tasks.first_task(order, target)
        )
        self._tasks: asyncio.TaskGroup | None = None
        self._task: asyncio.Task[None] | None = None
        self._order: Order | None = None
        self._guarded_tasks = GuardedTasks(self._reporter, setting)
        self._streams = Streams(name, session, camera.streams, self._navigation.streams)
        session.listen(self._monitor.on_message)

    @property
    def view(self) -> VehicleView:
        """The latest reports of the vehicle."""
        return self._view

    def leapfrog(self, both: Leapfrog, role: Role) -> None:
        """Have it and another vehicle observe each other."""
        self._navigation.partner = both.join(role, self._reporter)

    def resume_flying(self) -> None:
        """Note, before `connect`, that it flew by our order when an earlier process ended.

        If `connect` fails, its guardian returns it.
        """
        self.guardian.entrusted = True

    def resume_returning(self) -> None:
        """Note that it was landing or returning by our command when an earlier process ended."""
        self._monitor.resumed = True

    async def connect(self) -> None:
        """Wait for the vehicle and request the mission's telemetry. Raises `LinkError`."""
        session = self._session
        await wait_for_autopilot(session, self.name)
        begin_s = asyncio.get_running_loop().time()
        await self._streams.ask(self._is_received)
        session.request(mav.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
        waiting = Waiting(self._reporter, session)
        while missing := self._missing(begin_s):
            session.request(mav.MAVLINK_MSG_ID_HOME_POSITION)
            if await waiting.until(
                lambda: not self._missing(begin_s), 5.0, lambda: self._missing(begin_s)
            ):
                return
            if not self._is_received():
                raise LinkError(f"{self.name}: the link was lost while waiting for {missing}")
            if asyncio.get_running_loop().time() - begin_s > READY_S:
                raise LinkError(f"{self.name}: the vehicle did not report {missing}")

    async def run(self, report: Report) -> None:
        """Report and carry out orders until cancelled. `connect` comes first."""
        self._reporter.report = report
        async with asyncio.TaskGroup() as tasks:
            self._tasks = tasks
            try:
                tasks.create_task(self._watch_link())
                self._monitor.report_connected()
                await asyncio.Event().wait()
            finally:
                self._tasks = None

    def give(self, order: Order) -> None:
        """Carry out an order instead of the present one; not while its guardian has the vehicle.

        A path after a path is flown without a halt.
        """
        if self._tasks is None:
            raise RuntimeError("a vehicle takes orders only while it runs")
        self._monitor.on_path = isinstance(order, FlyPath)
        busy = self._task is not None and not self._task.done() and not self.guardian.acting
        goes_on = isinstance(order, FlyPath) and busy and self._manoeuvres.goes_on(order)
        if not goes_on:
            self._stand_aside()
        self.guardian.note_task(self._guarded_tasks.task(order))
        if self.guardian.acting:
            return
        self._order = order
        if goes_on:
            return
        if isinstance(order, ReturnToLaunch):
            self.guardian.return_home("its return path cannot be flown as planned")
            return
        self._task = self._tasks.create_task(self._carry_out(order))

    def land_here(self, reason: str) -> bool:
        """Land it in place; return False if it is not in the air under our control."""
        if not self.guardian.responsible:
            return False
        self.guardian.take_over("land", reason)
        return True

    def report_again(self) -> None:
        """Report its position to a mission that is back; a silent vehicle does so later."""
        if self._monitor.connected:
            self._monitor.report_connected()
            self.guardian.repeat_command()
        else:
            self._reporter.report_now(LinkLost)

    def _stand_aside(self) -> None:
        self._manoeuvres.called_off()
        if self._task is not None:
            self._task.cancel()
            self._task = None

    async def _carry_out(self, order: Order) -> None:
        try:
            await self._manoeuvres.carry_out(order)
        except* LinkError as group:
            errors = leaves(group)
            # its monitor has reported the loss of control
            if not any(isinstance(error, NotInControlError) for error in errors):
                self._order_failed("; ".join(str(error) for error in errors))

    def _aid(self, place: LatLon, sigma_m: float) -> None:
        """Send its autopilot its position; one that refuses it gets no more."""
        busy = self._aiding is not None and not self._aiding.done()
        ours = self._monitor.control.is_under_control
        if self._tasks is not None and self._aids and ours and not busy:
            self._aiding = self._tasks.create_task(self._send_place(place, sigma_m))

    async def _send_place(self, place: LatLon, sigma_m: float) -> None:
        try:
            await self._commands.send_external_position_estimate(place, sigma_m)
        except CommandRefusedError:
            self._aids = False
        except LinkError:
            pass  # the next one comes soon

    def _order_failed(self, reason: str, behind: bool = False) -> None:
        self._reporter.report_now(OrderFailed, type(self._order).__name__, reason, behind=behind)

    # --- the link ----------------------------------------------------------------------------
    async def _watch_link(self) -> None:
        """Report when the vehicle falls silent, and reconnect it when it is received again."""
        monitor = self._monitor
        give_up_after_s: float | None = None
        while True:
            await asyncio.sleep(1.0)
            self._watch_clock()
            if (clock := self._view.gate.clock).late:
                stamp_ns = clock.ask(asyncio.get_running_loop().time())
                self._session.send(mav.MAVLink_timesync_message(0, stamp_ns))
            if monitor.connected and monitor.control.is_under_control and self._is_received():
                self._streams.keep()
            if monitor.connected and self._silent_s() >= self._link_lost_s:
                monitor.connected = False
                self._reporter.report_now(LinkLost)
                give_up_after_s = self._waited_for_s()
            elif not monitor.connected and self._is_received():
                with contextlib.suppress(LinkError):
                    if not self._streams.go_on:
                        await self.connect()
                    await self._wait_for_contact()
                    self._camera.uncertain()
                    monitor.report_connected()
                    self.guardian.repeat_command()
            elif (
                not monitor.connected
                and give_up_after_s is not None
                and self._silent_s() > give_up_after_s
            ):
                give_up_after_s = None
                self._reporter.report_now(GivenUp, self._silence())

    def _watch_clock(self) -> None:
        """Log it when the vehicle's time passes faster or slower than ours."""
        boot_s = self._view.gate.clock.boot_s
        if self._clock_rate is None or boot_s is None:
            return
        if wrong := self._clock_rate.check(self._view.position_s, boot_s):
            self._reporter.line(f"vehicle {self.number}: {wrong}")

    async def _wait_for_contact(self) -> None:
        """Wait for the next position and heartbeat, where orders begin. Raises `LinkError`."""
        begin_s, view = asyncio.get_running_loop().time(), self._view
        if not await self._session.until(
            lambda: min(view.position_s, view.received_s) >= begin_s, MAX_RECONNECTION_S
        ):
            raise LinkError(f"{self.name}: it does not report its place and its mode")

    def _waited_for_s(self) -> float | None:
        """Return the maximum wait for a vehicle that has fallen silent, s."""
        if not self._monitor.control.air.may_be_up:
            return self._ground_patience_s
        battery = self._setting.mission.battery
        charge_wh = self._view.remaining_wh(battery.capacity_wh)
        left_wh = battery.capacity_wh if charge_wh is None else charge_wh
        return left_wh * 3600.0 / battery.hover_power_w + SILENCE_AFTER_BATTERY_S

    def _silence(self) -> str:
        place = self._setting.grid.position(self._reporter.position())
        where = f"{place.lat_deg:.6f}, {place.lon_deg:.6f}"
        if not self._monitor.control.air.may_be_up:
            return f"silent for {self._silent_s():.0f} s, on the ground at {where}"
        return (
            f"silent for {self._silent_s():.0f} s, longer than its battery can have lasted; last "
            f"report in the air at {where}, {self._view.height_m:.0f} m up"
        )

    def _silent_s(self) -> float:
        return self._view.silent_s(asyncio.get_running_loop().time())

    def _is_received(self) -> bool:
        """Return whether it is received without delay; its position may be missing."""
        received_s = asyncio.get_running_loop().time() - self._view.received_s
        return received_s < self._link_lost_s and not self._view.gate.clock.late

    def _missing(self, since_s: float) -> str:
        """Return the missing reports of the vehicle; a position from before does not count."""
        view = self._view
        return " and ".join(
            what
            for what, known in (
                ("its position", view.position_s >= since_s),
                ("its home", view.home is not None),
                ("its battery's charge", self._reporter.remaining_wh() is not None),
            )
            if not known
        )
