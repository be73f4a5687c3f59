"""The stream of setpoints along a path: place and velocity, ten times a second.

Setpoints depend on mission time only, not on telemetry, so that a slow link does no harm. Each is
the course smoothed over `SMOOTH_S`, its parts ahead by the autopilot's delay
(`uavmap.mavlink.autopilots`). A real ArduCopter follows a rounded path at 6 m/s within 0.54 m in 95
% of the time, as fast as planned. A PX4 is put into OFFBOARD for it, and back into Hold afterwards.

When the stream ends an ArduPilot continues for GUID_TIMEOUT before it brakes, by default 3 s, or 18
m at 6 m/s. It is shortened while paths are flown. PX4's own limit is a second, and is not changed.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import LinkError
from missions.geo.braking import Course
from missions.orders import FlyPath
from missions.units import GridPoint, LatLon
from uavmap.aircraft.controlled_commands import (
    MAX_MODE_CHANGE_S,
    ControlledCommands,
    NotInControlError,
    position_target,
)
from uavmap.aircraft.reporter import Reporter
from uavmap.mavlink.parameters import Parameter, Parameters
from uavmap.mavlink.session import Message, Session

INTERVAL_S: Final = 0.1
"""Interval of setpoints, s; 4 Hz were enough for a real one: some may get lost."""
SMOOTH_S: Final = 0.5
"""Time over which the course is averaged, s: no vehicle changes its acceleration at once."""
SAMPLES: Final = 10
OFFBOARD_LEAD_S: Final = 0.6
"""Time of the stream before the change to OFFBOARD, s: PX4 requires half a second."""
MODE_TRIES: Final = 4
BRAKE_S: Final = 6.0
"""Maximum time to come to rest, s; a real one takes 4.2 s from 10 m/s."""
SLOW_M_S: Final = 0.5
PLACES_INTERVAL_S: Final = 0.5
"""Interval between two places that are sent instead of a stream, s."""
PLACES_SPEED_M_S: Final = 9.0
"""Speed at which it may catch up with a place, m/s."""

_NO_ACCELERATION: Final = 0x1C0
_NO_YAW: Final = 0x400
_NO_YAW_RATE: Final = 0x800
_NO_PLACE: Final = 0x7
_NO_VELOCITY: Final = 0x38
_AS_INT: Final = {
    mav.MAV_FRAME_GLOBAL: mav.MAV_FRAME_GLOBAL_INT,
    mav.MAV_FRAME_GLOBAL_RELATIVE_ALT: mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
}


class Setpoint(NamedTuple):
    """Place (m) and velocity (m/s) along the grid's axes, fixed frame."""

    east_m: float
    north_m: float
    v_east_m_s: float
    v_north_m_s: float


def setpoint(course: Course, t_s: float, place_lead_s: float, velocity_lead_s: float) -> Setpoint:
    """Return the setpoint at mission time `t_s`: the course, smoothed, each part with its lead."""
    first_s, step_s = t_s + place_lead_s - 0.5 * SMOOTH_S, SMOOTH_S / SAMPLES
    places = [course.at(first_s + (index + 0.5) * step_s) for index in range(SAMPLES)]
    ahead_s = t_s + velocity_lead_s
    before, after = course.at(ahead_s - 0.5 * SMOOTH_S), course.at(ahead_s + 0.5 * SMOOTH_S)
    return Setpoint(
        sum(place.east_m for place in places) / SAMPLES,
        sum(place.north_m for place in places) / SAMPLES,
        (after.east_m - before.east_m) / SMOOTH_S,
        (after.north_m - before.north_m) / SMOOTH_S,
    )


class PathStream:
    """The stream to one vehicle. `run` sends it; other orders `leave` it first."""

    def __init__(
        self, commands: ControlledCommands, reporter: Reporter, *, by_places: bool = False
    ) -> None:
        self._session, self._monitor = commands.session, commands.monitor
        self._commands = commands
        self._by_places = by_places
        """True if places ahead are sent instead of a stream: it stops there without the next."""
        self._view = commands.session.view
        self._reporter = reporter
        self._grid = reporter.grid
        self._course: Course | None = None
        self._orders: tuple[FlyPath, ...] = ()
        """The path that is flown, and, until it begins, the path that replaces it."""
        self._home_amsl_m = 0.0
        self._left = True

    @property
    def course(self) -> Course:
        """Course that is flown. Raises RuntimeError before `begin`."""
        if self._course is None:
            raise RuntimeError("no path was given")
        return self._course

    @property
    def order(self) -> FlyPath:
        """The newest order."""
        return self._orders[-1]

    def begin(self, order: FlyPath) -> None:
        """Begin a path from rest, or from its own beginning."""
        self._course, self._orders = Course((order.trajectory,)), (order,)
        # heights are above the present home, even if it moves in flight
        self._home_amsl_m = self._view.home_amsl_m
        self._left = False

    def go_on(self, order: FlyPath) -> None:
        """Replace the present path, which is flown until the new one begins."""
        self._course = self.course.then(order.trajectory, self._reporter.now_s())
        self._orders = (self._flown_now(), order)

    def there(self) -> bool:
        """True if it is past its end in time: it should be at rest there."""
        return self._reporter.now_s() >= self.course.end_s

    # --- sending ----------------------------------------------------------------------------
    async def run(self) -> None:
        """Send setpoints until cancelled, in a mode of their own if they need one.

        Raises `LinkError` when the vehicle does not accept it.
        """
        if self._by_places:
            await self._send_places()
            return
        if not self._view.kind.streams_apart:
            await self._send_on()
            return
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._send_on())
            await asyncio.sleep(OFFBOARD_LEAD_S)
            kind = self._view.kind
            await self._into(kind.stream_mode, self._commands.follow_stream)

    async def _send_on(self) -> None:
        loop = asyncio.get_running_loop()
        due_s = loop.time()
        while self._commands.may_send:  # not one more, however soon this is cancelled
            self._send_once()
            due_s = max(due_s + INTERVAL_S, loop.time())
            await asyncio.sleep(due_s - loop.time())

    async def _send_places(self) -> None:
        """Send its place in a while, until cancelled: it stops there without the next."""
        view, reported = self._view, 0
        while self._commands.may_send:
            if reported % 10 == 0:  # either autopilot may have dropped its speed
                self._session.send_command(mav.MAV_CMD_DO_CHANGE_SPEED, 1, PLACES_SPEED_M_S, -1)
            now_s = self._reporter.now_s()
            at = self.course.at(now_s + view.kind.places_lead_s)
            point = Setpoint(at.east_m, at.north_m, 0.0, 0.0)
            self._session.send(self._place_message(point, self._flown_now()))
            reported += 1
            await asyncio.sleep(PLACES_INTERVAL_S)

    def _place_message(self, point: Setpoint, order: FlyPath) -> Message:
        """Return a target without a velocity: for a PX4 in Hold only MAV_CMD_DO_REPOSITION is
        one."""
        view, height_m = self._view, order.height_m + self._highest_to(point)
        message = self._message(point, order, height_m)
        if not view.kind.streams_apart:
            message.type_mask |= _NO_VELOCITY
            return message
        frame, wire_m = view.kind.altitude_on_wire(height_m, self._home_amsl_m)
        yaw_rad = math.nan if order.yaw_deg is None else message.yaw
        return mav.MAVLink_command_int_message(
            view.system_id, view.autopilot_component, frame, mav.MAV_CMD_DO_REPOSITION, 0, 0,
            -1.0, 0.0, 0.0, yaw_rad, message.lat_int, message.lon_int, wire_m,
        )  # fmt: skip

    def _highest_to(self, point: Setpoint) -> float:
        """Return the highest ground, above home, on the way to a place that is sent early, m."""
        view, here = self._view, self.course.at(self._reporter.now_s())
        if view.ground is None:
            return 0.0
        ground, end = view.ground, GridPoint(point.east_m, point.north_m)
        rise_m = float(ground.terrain.along(here.place, end).max()) - ground.terrain.height_m(end)
        return ground.lift_m(end, view.ground_home) + rise_m

    def _send_once(self) -> None:
        kind, now_s = self._view.kind, self._reporter.now_s()
        point = setpoint(self.course, now_s, kind.place_lead_s, kind.velocity_lead_s)
        order, height_m = self._flown_now(), self._flown_now().height_m
        if self._view.ground is not None:
            at = GridPoint(point.east_m, point.north_m)
            height_m += self._view.ground.lift_m(at, self._view.ground_home)
        self._session.send(self._message(point, order, height_m))

    def _flown_now(self) -> FlyPath:
        now_s = self._reporter.now_s()
        begun = [order for order in self._orders if order.trajectory.begin_s <= now_s]
        return begun[-1] if begun else self._orders[0]

    def _message(self, point: Setpoint, order: FlyPath, height_m: float) -> Message:
        """Return SET_POSITION_TARGET_GLOBAL_INT of a setpoint. Raises `LinkError` if it is not
        finite."""
        if not all(map(math.isfinite, point)):
            raise LinkError(f"no place to send a vehicle to: {point}")
        view, grid = self._view, self._grid
        position = view.as_reported(grid.position(GridPoint(point.east_m, point.north_m)))
        rises_m_s = 0.0
        if view.ground is not None:
            at = GridPoint(point.east_m, point.north_m)
            rises_m_s = view.ground.climb_m_s(at, point.v_east_m_s, point.v_north_m_s)
        frame, wire_m = view.kind.altitude_on_wire(height_m, self._home_amsl_m)
        # the grid's axes are turned against true north
        cos, sin = math.cos(grid.convergence_rad), math.sin(grid.convergence_rad)
        mask = _NO_ACCELERATION | _NO_YAW_RATE | (_NO_YAW if order.yaw_deg is None else 0)
        velocity_ned_m_s = (
            point.v_north_m_s * cos - point.v_east_m_s * sin,
            point.v_east_m_s * cos + point.v_north_m_s * sin,
            -rises_m_s if rises_m_s else 0.0,
        )
        yaw_rad = math.remainder(math.radians(order.yaw_deg or 0.0), math.tau)
        frame = _AS_INT.get(frame, frame)
        return position_target(view, frame, mask, position, wire_m, velocity_ned_m_s, yaw_rad)

    # --- modes ------------------------------------------------------------------------------
    async def _into(self, mode: int, ask: Callable[[], Awaitable[None]]) -> None:
        """Command a mode until a heartbeat shows it: a PX4's acknowledgement means nothing."""
        view, monitor = self._view, self._monitor
        refusal: LinkError | None = None
        for _ in range(MODE_TRIES):
            try:
                await ask()
            except NotInControlError:
                raise
            except LinkError as error:  # refused, or not answered: it may have come anyway
                refusal = error
            seen = lambda: view.mode == mode or not monitor.control.is_under_control  # noqa: E731
            if await self._session.until(seen, MAX_MODE_CHANGE_S):
                return
        name = view.kind.mode_names[mode]
        raise refusal or LinkError(f"the vehicle does not change to {name}{view.recent_texts()}")

    async def leave(self) -> bool:
        """Come to rest before another kind of order; return whether there was a stream.

        An ArduPilot is sent a velocity of zero until it is slow: the shortest way, for it would
        overshoot a place. A PX4 brakes by itself in Hold.
        """
        if self._left:
            return False
        if self._by_places:  # the target of the next order replaces the last place
            self._left = True
            return True
        kind, view = self._view.kind, self._view
        if not kind.streams_apart:
            await self._brake()
        elif view.mode == kind.stream_mode and self._commands.may_send:
            async with asyncio.TaskGroup() as tasks:
                sending = tasks.create_task(self._send_on())
                await self._into(kind.follows, self._commands.follow)
                sending.cancel()
            await self._session.until(lambda: view.ground_speed_m_s <= SLOW_M_S, BRAKE_S)
        self._left = True
        return True

    async def _brake(self) -> None:
        view, loop = self._view, asyncio.get_running_loop()
        until_s = loop.time() + BRAKE_S
        mask = _NO_PLACE | _NO_ACCELERATION | _NO_YAW | _NO_YAW_RATE
        frame, nowhere = mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, LatLon(0.0, 0.0)
        stop = position_target(view, frame, mask, nowhere, 0.0)
        while (
            self._commands.may_send
            and view.mode == view.kind.follows
            and view.armed
            and view.ground_speed_m_s > SLOW_M_S
            and loop.time() < until_s
        ):
            self._session.send(stop)
            await asyncio.sleep(INTERVAL_S)


TIMEOUT_S: Final = 1.0
"""Timeout of a stream, s: from 6 m/s a real ArduCopter stops after 15 m, by default after 27 m."""
MIN_TIMEOUT_S: Final = 0.5
"""Minimum timeout, s: a link that loses some setpoints must not look like a dead one."""


class StreamTimeout:
    """Sets how long a vehicle flies on when its stream ends.

    Its own value is saved before the flight and restored after it
    (`uavmap.runner.preflight.autopilot_setup`).
    """

    def __init__(self, name: str, session: Session, tell: Callable[[str], None]) -> None:
        self._name = name
        self._view = session.view
        self._parameters = Parameters(session)
        self._log = tell
        self._settled = False
        self._logged = False

    async def shorten(self) -> None:
        """Set it to `TIMEOUT_S`, once in a flight; log a failure once."""
        parameter = self._view.kind.stream_timeout
        if parameter is None or self._settled:
            return
        found = await self._parameters.read(parameter)
        if found is None:
            self._note(f"the vehicle does not report its {parameter}")
            return
        if MIN_TIMEOUT_S <= found.value <= TIMEOUT_S:
            self._settled = True
            return
        if await self._parameters.write(parameter, Parameter(TIMEOUT_S, found.type)):
            self._settled = True
        else:
            self._note(f"{parameter} could not be set")

    def _note(self, reason: str) -> None:
        if not self._logged:
            self._logged = True
            self._log(f"{self._name}: {reason}: if the link fails, it flies on for its own timeout")
