"""A vehicle on its pad: arming, take-off, a fresh battery; long waits are logged."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import CommandRefusedError, LinkError
from missions.events import Airborne, BatterySwapped
from missions.orders import TakeOff
from uavmap.aircraft.control import MAX_LIFT_OFF_S, AirState
from uavmap.aircraft.controlled_commands import (
    MAX_MODE_CHANGE_S,
    RESEND_PAUSE_S,
    ControlledCommands,
    NotInControlError,
)
from uavmap.aircraft.reporter import Reporter
from uavmap.mavlink.session import Session

REMIND_S: Final = 10.0
"""Wait after which the operator is informed, s."""
REMIND_AGAIN_S: Final = 30.0
LOOK_S: Final = 1.0


class Waiting:
    """One wait for one vehicle; a long wait is logged with its reason and duration."""

    def __init__(self, reporter: Reporter, session: Session) -> None:
        self._reporter = reporter
        self._session = session
        self._begin_s = asyncio.get_running_loop().time()
        self._due_s = self._begin_s + REMIND_S

    async def until(
        self, condition: Callable[[], bool], timeout_s: float, what: Callable[[], str]
    ) -> bool:
        """Wait as `Session.until`, and log the reason."""
        loop = asyncio.get_running_loop()
        end_s = loop.time() + timeout_s
        while (left_s := end_s - loop.time()) > 0.0:
            if await self._session.until(condition, min(left_s, LOOK_S)):
                return True
            if loop.time() >= self._due_s:
                self._remind(what())
        return condition()

    def _remind(self, what: str) -> None:
        now_s = asyncio.get_running_loop().time()
        self._due_s = now_s + REMIND_AGAIN_S
        name, waited_s = self._reporter.name, now_s - self._begin_s
        self._reporter.line(f"{name}: waits for {what}, for {waited_s:.0f} s by now")
        view = self._session.view
        if view.system_id and not view.armed and not view.ready_to_arm:
            # an ArduPilot gives its reasons every half minute, or on request
            self._session.send_command(mav.MAV_CMD_RUN_PREARM_CHECKS)


Crew = Callable[[int], Awaitable[None]]
"""Returns once the people on the ground have swapped a vehicle's battery and stand clear."""

READY_S: Final = 120.0
ARM_TRIES: Final = 10
ARM_PAUSE_S: Final = 3.0
CLIMB_TOLERANCE_M: Final = 0.4
HOME_S: Final = 5.0
"""Maximum time until a position above the home that arming has set, s."""
FULL: Final = 0.9
"""Share of its capacity from which on a battery counts as fresh."""


async def insist(ask: Callable[[], Awaitable[None]]) -> None:
    """Repeat a request until acknowledged: the watch on the link ends this without a link."""
    while True:
        try:
            await ask()
            return
        except CommandRefusedError:
            raise
        except LinkError:
            await asyncio.sleep(RESEND_PAUSE_S)


class Pad:
    """Readies one vehicle on its pad and has it take off."""

    def __init__(
        self, commands: ControlledCommands, reporter: Reporter, capacity_wh: float, crew: Crew
    ) -> None:
        self._session, self._monitor = commands.session, commands.monitor
        self._commands = commands
        self._view = commands.session.view
        self._reporter = reporter
        self._capacity_wh = capacity_wh
        self._crew = crew

    async def take_off(self, order: TakeOff) -> None:
        """Arm and climb; report that it is airborne. Raises `LinkError`."""
        session, view, kind = self._session, self._view, self._view.kind
        waiting = Waiting(self._reporter, session)
        if kind.streams_apart and view.mode == kind.stream_mode:
            # after a stream a PX4 is in OFFBOARD, and its checks fail there
            await insist(self._commands.follow)
        if not await waiting.until(
            lambda: self._monitor.control.air is not AirState.UNKNOWN,
            READY_S,
            lambda: "its landed state",
        ):
            raise LinkError("the vehicle does not report whether it is on the ground")
        if not await waiting.until(
            lambda: view.ready_to_arm,
            READY_S,
            lambda: f"the checks before arming, in {view.mode_name}",
        ):
            raise LinkError(
                f"not ready to arm within {READY_S:g} s, in {view.mode_name}{view.recent_texts()}"
            )
        await self._arm(waiting)
        if kind.amsl:  # arming has moved home, and the height is above the new one
            armed_s = asyncio.get_running_loop().time()
            await session.until(lambda: view.position_s > armed_s, HOME_S)
        view.keeps_home = True
        lifted = lambda: self._monitor.control.air.is_flying  # noqa: E731 - a name for three places
        try:
            await insist(lambda: self._commands.take_off(order.height_m, lifted))
        except CommandRefusedError:
            # its first copy may have been carried out, and only the answer was lost
            if not await session.until(lifted, MAX_LIFT_OFF_S):
                raise
        reached = order.height_m - CLIMB_TOLERANCE_M
        if not await session.until(
            lambda: view.height_m >= reached and view.mode == kind.follows,
            60.0 + 3.0 * order.height_m,
        ):
            raise LinkError(f"did not climb to {order.height_m:g} m{view.recent_texts()}")
        reporter = self._reporter
        reporter.report_now(Airborne, home=reporter.home(), home_amsl_m=reporter.home_amsl_m())

    async def _arm(self, waiting: Waiting) -> None:
        """Command the mode that follows us, and arm the motors."""
        kind = self._view.kind
        for attempt in range(ARM_TRIES):
            try:
                await self._commands.follow()
                # a PX4 acknowledges it unseen: only a heartbeat confirms it
                await self._session.until(
                    lambda: self._view.mode == kind.follows, MAX_MODE_CHANGE_S
                )
                await self._commands.arm()
                break
            except NotInControlError:
                raise
            except LinkError:
                if attempt == ARM_TRIES - 1:
                    raise
                await asyncio.sleep(ARM_PAUSE_S)

    async def swap_battery(self) -> None:
        """Wait for a fresh battery, and report it."""
        reporter = self._reporter
        capacity_wh = self._capacity_wh

        def fresh() -> bool:
            return reporter.remaining() >= FULL * capacity_wh

        def what() -> str:
            left_wh = reporter.remaining_wh()
            if reported := self._view.grounded_by:
                return f"a fresh battery ({reported})"
            charge = "no charge" if left_wh is None else f"{left_wh / capacity_wh:.0%}"
            return f"a fresh battery ({charge} reported, {FULL:.0%} wanted)"

        if self._view.is_simulator:
            await self._session.until(fresh)
        else:
            await self._crew(reporter.number)
            # a confirmation without a battery is possible, and the reason for the wait must be
            # shown
            await Waiting(reporter, self._session).until(fresh, math.inf, what)
        reporter.report_now(BatterySwapped, reporter.remaining())
