"""The orders by which a guardian (which decides when) returns or lands an aircraft."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import CommandRefusedError, LinkError
from missions.guardian import DOWN_M, QUICK_DESCENT_M_S, Action, Limits, corners_home, quick_aim_m
from missions.units import GridPoint
from uavmap.aircraft.controlled_commands import (
    RESEND_PAUSE_S,
    ControlledCommands,
    NotInControlError,
)
from uavmap.aircraft.legs import aim_over_ground
from uavmap.aircraft.reporter import Reporter

CHECK_INTERVAL_S: Final = 0.5
"""Interval between two targets while the place of home or the ground below changes, s."""
RETRY_S: Final = 2.0
"""Interval between two commands for the same thing, s."""
DESCENT_M_S: Final = 1.0
"""Minimum descent speed of a multicopter with a target below, in GUIDED or Hold, m/s."""
CORNER_M: Final = 2.0
"""Distance at which a corner of the way around a fence counts as reached, m."""
OVER_HOME_M: Final = 1.0
"""Distance from the place above its home within which a vehicle lands there, m."""
BRISK_M_S: Final = 1.0
"""Speed below which a vehicle turns on the spot, m/s."""
MOTORS_OFF_WAIT_S: Final = 5.0
"""Time that a vehicle which is down has to stop its motors by itself, s."""
STOP_MOTORS_S: Final = 60.0
"""Time after a mission that is waited for the motors of a vehicle which is down, s."""
FORCED: Final = 21196.0
"""Parameter of MAV_CMD_COMPONENT_ARM_DISARM that disarms in any state."""


class RecoveryFlight:
    """Flies one aircraft home, around corners or down, by targets and speeds."""

    def __init__(self, commands: ControlledCommands, reporter: Reporter, limits: Limits) -> None:
        self._session, self._monitor = commands.session, commands.monitor
        self._commands = commands
        self._view = commands.session.view
        self._reporter = reporter
        self._fence = limits.fence
        self._speed_m_s = limits.energy.speed_m_s

    def descent_aim_m(self) -> float | None:
        """Return the target height of a quick descent, m.

        None if it lands or is on the ground, or a pilot has it.
        """
        ours = self._monitor.control.off_ground and self._monitor.control.is_under_control
        return quick_aim_m(self._view.height_m) if ours else None

    async def descend(self) -> bool:
        """Descend quickly to where a landing takes only a few seconds; False if it refuses that."""
        kind, view, session = self._view.kind, self._view, self._session
        loop = asyncio.get_running_loop()
        due_s = loop.time() + abs(view.height_m) / DESCENT_M_S + RETRY_S
        fenced, slow = kind.fence_by_command, True
        while (aim_m := self.descent_aim_m()) is not None and view.armed and loop.time() < due_s:
            try:
                if fenced:  # outside its own fence it takes no target, and turns round
                    with contextlib.suppress(CommandRefusedError):
                        await self._commands.command(mav.MAV_CMD_DO_FENCE_ENABLE, 0)
                    fenced = False
                await self._aim_or_point(self._reporter.position(), aim_m)
                if slow:  # after the target: an ArduPilot drops its speeds at the first one
                    with contextlib.suppress(CommandRefusedError):
                        await self._commands.descent_speed(QUICK_DESCENT_M_S)
                    slow = False
            except CommandRefusedError:
                return False
            except LinkError:
                await asyncio.sleep(RESEND_PAUSE_S)
                continue
            await session.until(lambda: self.descent_aim_m() is None, RETRY_S)
        return True

    async def _aim_or_point(self, point: GridPoint, height_m: float) -> None:
        """Send a target, if need be by a message if its command is refused."""
        try:
            await self.aim_at(point, height_m)
        except NotInControlError:
            raise
        except CommandRefusedError:
            kind = self._view.kind
            if kind.streams_apart or self._view.mode != kind.follows:
                raise
            aim, aim_m = aim_over_ground(self._view, self._reporter.position(), point, height_m)
            self._commands.point_to(self._reporter.grid.position(aim), aim_m)

    async def aim_at(self, point: GridPoint, height_m: float) -> None:
        """Command the mode that follows targets, and a target. Raises `LinkError`."""
        view = self._view
        if view.mode != view.kind.follows:
            await self._commands.follow()
        aim, aim_m = aim_over_ground(view, self._reporter.position(), point, height_m)
        await self._commands.fly_to(self._reporter.grid.position(aim), aim_m)

    async def fly_home_by_map(self) -> bool:
        """Fly to its home by targets; return False if it refuses them, or needs none."""
        view, fence = self._view, self._fence
        height_m = view.height_m
        while self._monitor.by_map and view.armed and self._monitor.control.is_under_control:
            here, home = self._reporter.position(), self._reporter.home()
            if here.distance_to(home) <= OVER_HOME_M and view.ground_speed_m_s <= BRISK_M_S:
                return True
            corners = corners_home(fence, here, home)
            try:
                await self.aim_at(corners[0] if corners else home, height_m)
                await self._commands.speed(self._speed_m_s)
            except CommandRefusedError:
                return False
            except LinkError:
                await asyncio.sleep(RESEND_PAUSE_S)
                continue
            # its autopilot's place of home changes with every picture
            await asyncio.sleep(CHECK_INTERVAL_S)
        return False

    async def ask_autopilot(self, action: Action) -> str:
        """Command a return or landing until the autopilot does it; repeat a refused landing.

        Return why it refuses to return, else an empty text.
        """
        view, commands = self._view, self._commands
        wanted = view.kind.rtl if action == "rtl" else view.kind.land
        ask = commands.return_to_launch if action == "rtl" else commands.land
        while view.mode != wanted and view.armed and self._monitor.control.is_under_control:
            try:
                await ask()
            except NotInControlError:
                return ""
            except CommandRefusedError as refusal:
                if action == "rtl":
                    return str(refusal)
            except LinkError:
                pass  # no answer: repeat, for as long as it takes
            await self._session.until(lambda: view.mode == wanted, RETRY_S)
        return ""

    async def stop_motors(self, *, struck: bool) -> None:
        """Land a vehicle that is down, which may disarm it, or disarm it by force.

        The force is for one that struck, is low and under our control: its autopilot may not notice
        that it has landed.
        """
        view, session, vehicle = self._view, self._session, f"vehicle {self._reporter.number}"

        def is_armed() -> bool:
            return view.armed

        line = self._reporter.line
        if is_armed() and self._monitor.control.is_under_control:
            asking = asyncio.ensure_future(self.ask_autopilot("land"))
            try:
                await session.until(lambda: not view.armed, MOTORS_OFF_WAIT_S)
            finally:
                asking.cancel()
        reported = False
        while is_armed():
            forced = struck and view.height_m < DOWN_M and self._monitor.control.is_under_control
            if not reported:
                reported = True
                how = "they are stopped by force" if forced else "keep away"
                line(f"{vehicle}: its motors still run; {how}")
            if forced:
                with contextlib.suppress(LinkError):
                    await self._commands.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 0, FORCED)
            await session.until(lambda: not view.armed, RETRY_S)
        if reported:
            line(f"{vehicle}: its motors have stopped")

    async def reach(
        self, corner: GridPoint, height_m: float, over: Callable[[], bool], *, slow: bool = False
    ) -> bool:
        """Fly to a corner, or, `slow`, come to rest; return False if that is `over`, or is
        refused."""

        def there() -> bool:
            if slow:
                return self._view.ground_speed_m_s <= BRISK_M_S
            return self._reporter.position().distance_to(corner) <= CORNER_M

        while not over():
            try:
                await self.aim_at(corner, height_m)
                await self._commands.speed(self._speed_m_s)
            except CommandRefusedError:
                return False
            except LinkError:
                await asyncio.sleep(RESEND_PAUSE_S)
                continue
            pause_s = RETRY_S if self._view.ground is None else CHECK_INTERVAL_S
            await self._session.until(lambda: there() or over(), pause_s)
            if there():
                return not over()
        return False
