"""The commands of one vehicle, sent only while it is under our control.

    manoeuvres, guardian -> control is asked -> session -> MAVLink

Each command ends as soon as a pilot or a failsafe has the vehicle, including its repetitions. Each
copy of a command for a mode is sent only after a recent report of the mode; no other command
changes the mode. The guardian has commands of its own: while it acts, those of the mission are
refused.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import CommandRefusedError, LinkError
from missions.units import LatLon
from uavmap.aircraft.control import HEARTBEAT_WAIT_S, Control, Holder
from uavmap.aircraft.guardian.monitor import Monitor
from uavmap.mavlink.session import Message, Session
from uavmap.mavlink.vehicle_view import VehicleView

RESEND_PAUSE_S: Final = 0.1
"""Pause before a command without an acknowledgement, or unsent, is sent again, s."""
MAX_MODE_CHANGE_S: Final = 2.5
"""Maximum time until a new mode is reported, s."""
_STAMP_WRAPS_S: Final = 250.0
"""Time after which a time of transmission restarts, s: a float would lose its milliseconds."""
_LEAPS_WITHIN_S: Final = 1.0
"""Time after an accepted position in which the reported position jumps to it, s."""
Copy = Callable[[Control, float], Control]
"""Returns the control after a copy of a command for a mode was sent at a time of the loop's
clock."""
_PLACE_ALONE: Final = 0b1101_1111_1000
"""The type mask of a target without velocity, acceleration, yaw and turn rate."""


class NotInControlError(CommandRefusedError):
    """The vehicle is not under our control: no command is sent."""


def _never() -> bool:
    return False


def position_target(
    view: VehicleView,
    frame: int,
    type_mask: int,
    place: LatLon,
    z: float,
    velocity_ned_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0),
    yaw_rad: float = 0.0,
) -> Message:
    """Return SET_POSITION_TARGET_GLOBAL_INT; `type_mask` marks its unused fields."""
    return mav.MAVLink_set_position_target_global_int_message(
        0, view.system_id, view.autopilot_component, frame, type_mask, round(place.lat_deg * 1e7),
        round(place.lon_deg * 1e7), z, *velocity_ned_m_s, 0.0, 0.0, 0.0, yaw_rad, 0.0,
    )  # fmt: skip


class ControlledCommands:
    """Commands, each repeated until it is acknowledged, or `done`: the vehicle is seen to do it.

    Each raises `NotInControlError`, `CommandRefusedError` if the vehicle refuses, and `LinkError`
    without an answer.
    """

    def __init__(self, session: Session, monitor: Monitor, *, guardian: bool = False) -> None:
        self.session = session
        self.monitor = monitor
        self._view = session.view
        self._guardian = guardian

    @property
    def may_send(self) -> bool:
        """True if the vehicle is under our control."""
        holder = self.monitor.control.holder
        return holder is Holder.OURS or (self._guardian and holder is Holder.GUARDIAN)

    # --- modes -------------------------------------------------------------------------------
    async def follow(self) -> None:
        """Command the mode in which the vehicle flies to targets."""
        kind = self._view.kind
        await self._into(kind.follows, mav.MAV_CMD_DO_SET_MODE, *kind.follow_params)

    async def follow_stream(self) -> None:
        """Command the mode in which it follows a stream of setpoints."""
        kind = self._view.kind
        await self._into(kind.stream_mode, mav.MAV_CMD_DO_SET_MODE, *kind.stream_params)

    async def land(self, done: Callable[[], bool] = _never) -> None:
        """Command a landing in place."""
        await self._into(self._view.kind.land, mav.MAV_CMD_NAV_LAND, done=done)

    async def return_to_launch(self) -> None:
        """Command a return by its autopilot."""
        await self._into(self._view.kind.rtl, mav.MAV_CMD_NAV_RETURN_TO_LAUNCH)

    async def take_off(self, height_m: float, done: Callable[[], bool]) -> None:
        """Command a take-off to a height (m) above home; from the first copy on it counts as
        airborne."""
        kind = self._view.kind
        _, wire_m = kind.altitude_on_wire(height_m, self._view.home_amsl_m)
        unused = kind.unused_param

        def copy(control: Control, now_s: float) -> Control:
            return control.with_request(kind.takes_off_in, now_s).with_take_off(now_s)

        params = (0, 0, 0, unused, unused, unused, wire_m)
        await self._into(copy, mav.MAV_CMD_NAV_TAKEOFF, *params, done=done)

    # --- what changes no mode ----------------------------------------------------------------
    async def command(
        self, command: int, *params: float, done: Callable[[], bool] = _never
    ) -> None:
        """Send a command that changes no mode."""
        async with self._while_in_control():
            await self.session.command(command, *params, done=done)

    async def arm(self) -> None:
        """Arm the motors."""
        await self.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1, done=lambda: self._view.armed)

    async def speed(self, speed_m_s: float) -> None:
        """Set the speed over ground to targets (m/s), until the mode changes."""
        await self.command(mav.MAV_CMD_DO_CHANGE_SPEED, 1, speed_m_s, -1)

    async def descent_speed(self, speed_m_s: float) -> None:
        """Set the descent speed to targets (m/s), until the mode changes."""
        await self.command(mav.MAV_CMD_DO_CHANGE_SPEED, 3, speed_m_s, -1)

    async def fly_to(self, place: LatLon, height_m: float) -> None:
        """Send MAV_CMD_DO_REPOSITION, without the flag that changes the mode.

        It is refused in any mode but that of `follow`. `height_m` is above home, or above the
        ground there if the view has one.
        """
        kind = self._view.kind
        above_home_m = height_m + self._view.ground_m(place)
        frame, wire_m = kind.altitude_on_wire(above_home_m, self._view.home_amsl_m)
        async with self._while_in_control():
            await self.session.command_at(
                mav.MAV_CMD_DO_REPOSITION,
                frame,
                (-1.0, 0.0, 0.0, math.nan),
                self._view.as_reported(place),
                wire_m,
                kind.target_taken,
            )

    def point_to(self, place: LatLon, height_m: float) -> None:
        """Send SET_POSITION_TARGET_GLOBAL_INT of a place, for a vehicle that refuses `fly_to`.

        It is not acknowledged, and ignored in any mode but that of streams.
        """
        if not self.may_send:
            raise self._control_error()
        frame, up_m = mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, height_m + self._view.ground_m(place)
        target = position_target(
            self._view, frame, _PLACE_ALONE, self._view.as_reported(place), up_m
        )
        self.session.send(target)

    async def send_external_position_estimate(self, place: LatLon, sigma_m: float) -> None:
        """Send MAV_CMD_EXTERNAL_POSITION_ESTIMATE, good to `sigma_m`.

        Either autopilot accepts it while it has no satellites, but not a PX4 with optical flow. It
        moves nothing, so no permission is needed.
        """
        boot_s = self._view.since_boot_s or 0.0
        self._view.aided_until_s = math.inf
        stamp = (boot_s % _STAMP_WRAPS_S, 0.0, sigma_m, 0.0)
        try:
            await self.session.command_at(
                mav.MAV_CMD_EXTERNAL_POSITION_ESTIMATE, mav.MAV_FRAME_GLOBAL, stamp, place, math.nan
            )
        finally:
            self._view.aided_until_s = asyncio.get_running_loop().time() + _LEAPS_WITHIN_S

    # --- control -----------------------------------------------------------------------------
    def _control_error(self) -> NotInControlError:
        return NotInControlError(f"the vehicle is {self.monitor.control.holder.value} now")

    @contextlib.asynccontextmanager
    async def _while_in_control(self) -> AsyncIterator[None]:
        if not self.may_send:
            raise self._control_error()
        try:
            async with asyncio.timeout(None) as scope:
                with self.monitor.ends_with_control(scope):
                    yield
        except TimeoutError:
            if scope.expired():
                raise self._control_error() from None
            raise

    async def _into(
        self, mode: int | Copy, command: int, *params: float, done: Callable[[], bool] = _never
    ) -> None:
        """Command a mode, noted before each copy. Raises `LinkError` if none is reported."""
        copy: Copy = (
            mode if callable(mode) else lambda control, now_s: control.with_request(mode, now_s)
        )
        permit = _ModePermit(self, self.session, self.monitor, copy)
        async with self._while_in_control():
            try:
                await self.session.command(command, *params, done=done, permit=permit)
            except CommandRefusedError:
                self.monitor.control = self.monitor.control.with_refusal()
                raise


@dataclass(frozen=True, slots=True)
class _ModePermit:
    """Permits a copy of a command while the vehicle is under our control by a recent mode.

    It notes the copy in the control before each send.
    """

    commands: ControlledCommands
    session: Session
    monitor: Monitor
    copy: Copy

    async def wait_for_grant(self) -> None:
        if not await self.session.until(self.grants, HEARTBEAT_WAIT_S):
            raise LinkError("the vehicle does not report its mode")

    def grants(self) -> bool:
        now_s = asyncio.get_running_loop().time()
        known = self.monitor.control.is_mode_known(now_s) and not self.session.view.gate.clock.late
        granted = self.commands.may_send and known
        if granted:
            self.monitor.control = self.copy(self.monitor.control, now_s)
        return granted
