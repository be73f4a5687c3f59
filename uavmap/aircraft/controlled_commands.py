"""The commands of one vehicle, sent only while it is ours.

    manoeuvres, guardian -> control is asked -> the driver's commands -> MAVLink

Each command ends as soon as a pilot or a failsafe has the vehicle, its repetitions included. Each
copy of a command for a mode is sent only on a mode that was reported just now. The guardian has
commands of its own: while it acts, those of the mission are refused.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass
from functools import partial

from missions.errors import CommandRefusedError, LinkError
from missions.units import LatLon
from uavmap.aircraft.control import HEARTBEAT_WAIT_S, Holder
from uavmap.aircraft.guardian.monitor import Monitor
from uavmap.mavlink.commands import MavlinkCommands
from uavmap.mavlink.session import Message, Permit, Session


class NotOursError(CommandRefusedError):
    """The vehicle is not under our control: nothing is sent."""


def _never() -> bool:
    return False


class ControlledCommands:
    """The verbs of `MavlinkCommands`, and messages. Each raises `NotOursError` besides."""

    def __init__(
        self,
        session: Session,
        commands: MavlinkCommands,
        monitor: Monitor,
        *,
        guardian: bool = False,
    ) -> None:
        self._session = session
        self._commands = commands
        self._monitor = monitor
        self._view = session.view
        self._guardian = guardian

    @property
    def may_send(self) -> bool:
        """Whether the vehicle is under our control."""
        holder = self._monitor.control.holder
        return holder is Holder.OURS or (self._guardian and holder is Holder.GUARDIAN)

    def send(self, message: Message) -> bool:
        """Send a message; False if the vehicle is not under our control."""
        if self.may_send:
            self._session.send(message)
        return self.may_send

    # --- modes -------------------------------------------------------------------------------
    async def follow(self) -> None:
        """Into the mode in which the vehicle flies to targets."""
        await self._into(self._view.kind.follows, self._commands.follow)

    async def follow_stream(self) -> None:
        """Into the mode in which it follows a stream of setpoints."""
        await self._into(self._view.kind.stream_mode, self._commands.follow_stream)

    async def land(self, done: Callable[[], bool] = _never) -> None:
        """Land where it is."""
        await self._into(self._view.kind.land, lambda permit: self._commands.land(done, permit))

    async def return_to_launch(self) -> None:
        """Return by its autopilot."""
        await self._into(self._view.kind.rtl, self._commands.return_to_launch)

    async def take_off(self, height_m: float, done: Callable[[], bool]) -> None:
        """Take off; from the first copy on it counts as in the air."""

        def copy() -> None:
            self._monitor.asks(self._view.kind.takes_off_in)
            self._monitor.takes_off()

        await self._into(copy, lambda permit: self._commands.take_off(height_m, done, permit))

    # --- what changes no mode ----------------------------------------------------------------
    async def arm(self) -> None:
        """Motors on."""
        async with self._while_ours():
            await self._commands.arm()

    async def command(self, command: int, *params: float) -> None:
        """A command that changes no mode."""
        async with self._while_ours():
            await self._session.command(command, *params)

    async def fly_to(self, place: LatLon, height_m: float) -> None:
        """Fly to a place at a height (m) above home or above the ground."""
        async with self._while_ours():
            await self._commands.fly_to(place, height_m)

    def point_to(self, place: LatLon, height_m: float) -> None:
        """The same by a message that is not acknowledged."""
        self._check()
        self._commands.point_to(place, height_m)

    async def speed(self, speed_m_s: float) -> None:
        """The speed over ground to targets (m/s)."""
        async with self._while_ours():
            await self._commands.speed(speed_m_s)

    async def descent_speed(self, speed_m_s: float) -> None:
        """The speed down to targets (m/s)."""
        async with self._while_ours():
            await self._commands.descent_speed(speed_m_s)

    # --- control -----------------------------------------------------------------------------
    def _check(self) -> None:
        if not self.may_send:
            raise NotOursError(self._whose())

    def _whose(self) -> str:
        return f"the vehicle is {self._monitor.control.holder.value} now"

    @contextlib.asynccontextmanager
    async def _while_ours(self) -> AsyncIterator[None]:
        self._check()
        try:
            async with asyncio.timeout(None) as scope:
                with self._monitor.ends_with_control(scope):
                    yield
        except TimeoutError:
            if scope.expired():
                raise NotOursError(self._whose()) from None
            raise

    async def _into(
        self, mode: int | Callable[[], None], ask: Callable[[Permit], Awaitable[None]]
    ) -> None:
        """Command a mode, which `mode` notes before each copy. Raises `LinkError` where the present
        mode is not reported."""
        copy = mode if callable(mode) else partial(self._monitor.asks, mode)
        async with self._while_ours():
            try:
                await ask(_KnownMode(self, self._session, self._monitor, copy))
            except CommandRefusedError:
                self._monitor.refused()
                raise


@dataclass(frozen=True, slots=True)
class _KnownMode:
    """Permits a copy of a command while the vehicle is under our control by a mode that was just
    reported; calls `copy` before each."""

    commands: ControlledCommands
    session: Session
    monitor: Monitor
    copy: Callable[[], None]

    async def granted(self) -> None:
        if not await self.session.until(self.grants, HEARTBEAT_WAIT_S):
            raise LinkError("the vehicle does not report its mode")

    def grants(self) -> bool:
        now_s = asyncio.get_running_loop().time()
        known = self.monitor.control.knows_mode(now_s) and not self.session.view.gate.clock.late
        granted = self.commands.may_send and known
        if granted:
            self.copy()
        return granted
