"""The guardian of one aircraft, on the wire: whatever becomes of the mission, it is not left alone.

It sends our heartbeat, watches telemetry by the rules of `missions.guardian`, and, where those say
so, has the autopilot return or land by itself until that is seen to happen. It needs a session and
nothing else: no journal, no explorer, no camera. So it goes on when the service has ended, until
the aircraft is on the ground or a pilot has it.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from dataclasses import replace
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import CommandRefusedError, LinkError
from missions.events import Crashed, Guarded
from missions.guardian import (
    HASTE_M_S,
    PAD_M,
    Action,
    Guard,
    Limits,
    Seen,
    Task,
    corners_home,
    quick_aim_m,
    watch,
)
from missions.guardian.down import low
from missions.units import GridPoint
from uavmap.fly.monitor import Monitor
from uavmap.fly.over_ground import aim_over_ground, leg_over_ground_s
from uavmap.fly.reporter import Reporter
from uavmap.link.commands import Commands
from uavmap.link.session import Session

HEARTBEAT_S: Final = 1.0
WATCH_S: Final = 0.5
"""Between two looks, if the vehicle has told a new position; else twice as long."""
SLEW_S: Final = 4.0
"""So long a navigation filter takes to follow a leap."""
STALE_S: Final = 3.0
"""Telemetry that is older says nothing of now."""
RETRY_S: Final = 2.0
DESCENT_M_S: Final = 1.0
"""A multicopter that is told to sink does so at least this fast, in GUIDED or Hold."""
PATIENCE_S: Final = 60.0
"""Beyond what its battery can have lasted, a silent vehicle is waited for so long."""
CORNER_M: Final = 2.0
"""A corner of the way around a fence is turned so near to it."""
OVER_HOME_M: Final = 1.0
"""Who is nearer than this to the place above its home lands there."""
BRISK_M_S: Final = 1.0
"""Who is slower than this turns on the spot."""
CORNER_S: Final = 5.0
"""To get going towards one, and to come to rest there."""
PAUSE_S: Final = 0.1
"""Before a command is asked for again that nobody acknowledged, or that could not be sent."""
LEAVE_S: Final = 15.0
"""An operator who leaves at once still waits so long to see that the autopilot returns."""

_WORDS: Final = {"rtl": "return by its autopilot", "land": "land where it is"}


class Guardian:
    """Keeps one aircraft from being left alone.

    `stand_aside` is called when the guardian takes the vehicle: whatever the mission had it do
    ends, and nothing more is begun. `tell` takes a line for the operator.
    """

    def __init__(
        self,
        session: Session,
        commands: Commands,
        reporter: Reporter,
        monitor: Monitor,
        limits: Limits,
        tell: Callable[[str], None],
    ) -> None:
        self._session = session
        self._commands = commands
        self._view = session.view
        self._reporter = reporter
        self._monitor = monitor
        self._limits = limits
        self._operator = tell
        self._guard = Guard()
        self._pursuit: asyncio.Task[None] | None = None
        self._tasks: asyncio.TaskGroup | None = None
        self._jumps = session.view.gate.track.jumps
        self._last_wh = limits.energy.capacity_wh
        self._reason = ""
        self._leapt_s = float("-inf")
        """When its position leapt last, on the loop's clock."""
        self._flew = False
        """Whether it was in the air since it was taken over."""
        self.entrusted = False
        """Whether it was in the air by our order when an earlier process ended."""
        self.stand_aside: Callable[[], None] = lambda: None
        self.order_failed: Callable[[str, bool], None] = lambda reason, behind: None

    def _tell(self, text: str) -> None:
        """A line for the operator; a terminal that is gone must not keep an aircraft in the air."""
        with contextlib.suppress(Exception):
            self._operator(text)

    # --- what the driver tells it -----------------------------------------------------------
    @property
    def acting(self) -> bool:
        """Whether the vehicle is the guardian's now."""
        return self._guard.action is not None

    def told(self, task: Task) -> None:
        """The mission gave a new order."""
        if self.acting and not self._view.armed:
            self._let_go()
        self._guard = self._guard.told(task)

    def take_over(self, action: Action, reason: str, *, hurry: bool = False) -> None:
        """Have the autopilot return or land by itself, and see to it.

        `hurry`: it descends as fast as it flies before it lands.
        """
        self._guard = self._guard.acting(action, self._reporter.now_s(), hurry=hurry)
        self._reason = reason
        self._flew = self._monitor.was_airborne
        self.stand_aside()
        kind = self._view.kind
        self._monitor.commanded = (kind.rtl, kind.land)
        number = self._reporter.number
        way = "fly home by its own map" if action == "rtl" and self._by_map else _WORDS[action]
        self._tell(f"vehicle {number}: {reason}; it is told to {way}")
        self._reporter.report(Guarded(number, self._reporter.t_s(), action, reason))
        if self._pursuit is not None:
            self._pursuit.cancel()
        begin = self._tasks.create_task if self._tasks is not None else asyncio.ensure_future
        self._pursuit = begin(self._pursue(action, hurry=hurry))

    def heard_again(self) -> None:
        """The link is back: what it had the vehicle do before, it sees to again, and says so."""
        action = self._guard.action
        if action is not None and self._view.armed:
            self.take_over(action, self._reason)

    # --- its own life -----------------------------------------------------------------------
    async def run(self) -> None:
        """Send heartbeats, watch and act until cancelled."""
        async with asyncio.TaskGroup() as tasks:
            self._tasks = tasks
            try:
                tasks.create_task(self._beat())
                tasks.create_task(self._watch())
                await asyncio.Event().wait()
            finally:
                self._tasks = None

    async def _beat(self) -> None:
        while True:
            self._session.heartbeat()
            await asyncio.sleep(HEARTBEAT_S)

    async def _watch(self) -> None:
        """Look at every new position, but not too often: of an old one it seems to stand still."""
        looked_s = seen_s = float("-inf")
        while True:
            await asyncio.sleep(WATCH_S)
            now_s, told_s = self._reporter.loop_s(), self._view.position_s
            if told_s > seen_s or now_s - looked_s >= 2.0 * WATCH_S:
                looked_s, seen_s = now_s, told_s
                self._look()

    def _look(self) -> None:
        """One look at the vehicle."""
        seen = self._seen()
        if seen is None:
            return
        if seen.remaining_wh is not None:
            self._last_wh = seen.remaining_wh
        self._flew = self._flew or self._monitor.was_airborne
        if self._monitor.overridden and self.acting:
            self._let_go()
        self._look_for_leaps(seen)
        seen = replace(seen, slews=self._reporter.loop_s() - self._leapt_s < SLEW_S)
        self._guard, verdict = watch(self._limits, self._guard, seen)
        self._monitor.struck_m_s = 0.0
        if not seen.armed and not seen.airborne and self.acting:
            self._let_go()
            if not self._flew:  # it never left the ground, so no landing was seen
                self._monitor.landed()
        if verdict is None:
            return
        if verdict.rung == "report":
            self.order_failed(verdict.reason, verdict.behind)
        elif verdict.rung == "crashed":
            self._crashed(seen, verdict.reason)
        else:
            action: Action = "land" if verdict.rung == "land" else "rtl"
            self.take_over(action, verdict.reason, hurry=verdict.hurry)

    def _look_for_leaps(self, seen: Seen) -> None:
        """A position that leapt ends the mission of this vehicle: its places mean nothing."""
        track, leaps = self._view.gate.track, self._monitor.leaps
        leapt, leaps.leapt = leaps.leapt, ""
        if track.jumps != self._jumps:  # too far to be believed at once, and it stayed
            self._jumps, leapt = track.jumps, f"its position has leapt by {track.jumped_m:.0f} m"
        if leapt:
            self._leapt_s = self._reporter.loop_s()
        if low(seen):
            return  # the ground has stopped it: nothing that lies there is told to fly on
        if leapt and not self.acting and seen.airborne and seen.mode != "other":
            finder = self._monitor.navigation
            if finder is not None and finder.leapt(leapt):
                return
            self.order_failed(f"{leapt}: satellite navigation is not to be trusted", False)

    def _seen(self) -> Seen | None:
        """What telemetry says, None where it says nothing of now."""
        view, reporter = self._view, self._reporter
        if not self._monitor.connected or view.position is None or view.home is None:
            return None
        if reporter.loop_s() - view.position_s > STALE_S:
            return None
        return Seen(
            t_s=reporter.now_s() - self._age_s(),
            position=reporter.position(),
            height_m=view.height_m,
            ground_speed_m_s=view.ground_speed_m_s,
            home=reporter.home(),
            armed=view.armed,
            airborne=self._monitor.airborne,
            mode=self._monitor.mode,
            remaining_wh=reporter.remaining_wh(),
            wind_m_s=self._monitor.wind.speed_m_s,
            struck_m_s=self._monitor.struck_m_s,
            by_map=self._by_map,
        )

    def _age_s(self) -> float:
        """How old the position is by the vehicle's own clock: a link may delay frames unevenly."""
        view, clock = self._view, self._view.gate.clock
        if clock.boot_s is None or clock.offset_s is None:
            return 0.0
        told_s = min(clock.boot_s + clock.offset_s, view.position_s)
        return max(self._reporter.loop_s() - told_s, 0.0)

    def _crashed(self, seen: Seen, reason: str) -> None:
        """It is down: say where, and have a vehicle whose motors still run land and disarm."""
        reporter = self._reporter
        place = reporter.grid.position(seen.position)
        self._tell(
            f"vehicle {reporter.number} is down near {place.lat_deg:.6f}, {place.lon_deg:.6f}: "
            f"{reason}"
        )
        self.stand_aside()
        reporter.report(Crashed(reporter.number, reporter.t_s(), seen.position, reason))
        if seen.armed and not self._monitor.overridden:
            self._monitor.commanded = (self._view.kind.rtl, self._view.kind.land)
            if self._tasks is not None:
                self._pursuit = self._tasks.create_task(self._pursue("land"))

    def _let_go(self) -> None:
        """A pilot has it, or it stands on the ground."""
        self._guard = self._guard.released()
        if self._pursuit is not None:
            self._pursuit.cancel()
            self._pursuit = None

    def _aim_m(self) -> float | None:
        """How high to aim in a quick descent; None where it should land from, on the ground, and
        when a pilot has it."""
        ours = self._monitor.airborne and not self._monitor.overridden
        return quick_aim_m(self._view.height_m) if ours else None

    async def _descend(self) -> bool:
        """Quickly down to where a landing takes but a few seconds; False if it refuses that."""
        kind, view, session = self._view.kind, self._view, self._session
        self._monitor.commanded = (*kind.ours, kind.rtl, kind.land)
        loop = asyncio.get_running_loop()
        due_s = loop.time() + abs(view.height_m) / DESCENT_M_S + RETRY_S
        fenced, slow = kind.fence_by_command, True
        while (aim_m := self._aim_m()) is not None and view.armed and loop.time() < due_s:
            try:
                if fenced:  # outside of its own fence it takes no target, and turns round
                    with contextlib.suppress(CommandRefusedError):
                        await session.command(mav.MAV_CMD_DO_FENCE_ENABLE, 0)
                    fenced = False
                await self._aim_or_point(self._reporter.position(), aim_m)
                if slow:  # after the target: an ArduPilot forgets its speeds at the first one
                    with contextlib.suppress(CommandRefusedError):
                        await self._commands.descent_speed(HASTE_M_S)
                    slow = False
            except CommandRefusedError:
                return False
            except LinkError:
                await asyncio.sleep(PAUSE_S)
                continue
            await session.until(lambda: self._aim_m() is None, RETRY_S)
        return True

    async def _aim_or_point(self, point: GridPoint, height_m: float) -> None:
        """A target, if need be by a message where the command for it is refused."""
        try:
            await self._aim(point, height_m)
        except CommandRefusedError:
            kind = self._view.kind
            if kind.streams_apart or self._view.mode != kind.follows:
                raise
            aim, aim_m = aim_over_ground(self._view, self._reporter.position(), point, height_m)
            self._commands.point_to(self._reporter.grid.position(aim), aim_m)

    async def _aim(self, point: GridPoint, height_m: float) -> None:
        """Into the mode that follows targets, and a target. Raises `LinkError`."""
        view = self._view
        if view.mode != view.kind.follows:
            await self._commands.follow()
        aim, aim_m = aim_over_ground(view, self._reporter.position(), point, height_m)
        await self._commands.fly_to(self._reporter.grid.position(aim), aim_m)

    async def _pursue(self, action: Action, *, hurry: bool = False) -> None:
        """Ask until the autopilot is seen to do it; what it refuses, it lands instead."""
        kind = self._view.kind
        if action == "rtl" and await self._home_by_map():
            self.take_over("land", "it is over its home, as its own map tells")
            return
        quickly = hurry and await self._descend()
        self._monitor.commanded = (kind.rtl, kind.land)  # in the descent targets were ours, too
        wanted = kind.rtl if action == "rtl" else kind.land
        commands = self._commands
        ask = commands.return_to_launch if action == "rtl" else commands.land
        while self._view.mode != wanted and self._view.armed and not self._monitor.overridden:
            try:
                await ask()
            except CommandRefusedError as refusal:
                if action == "rtl":
                    self.take_over("land", str(refusal))
                    return
            except LinkError:
                pass  # no answer: ask again, for as long as it takes
            await self._session.until(lambda: self._view.mode == wanted, RETRY_S)
        # where it has been carried to the ground may be lower than at its home
        if quickly and await self._session.until(lambda: self._aim_m() is not None, PATIENCE_S):
            await self._pursue(action, hurry=True)

    @property
    def _by_map(self) -> bool:
        """Whether its autopilot does not know where it is, and its pictures do."""
        navigation = self._monitor.navigation
        return navigation is not None and navigation.by_map

    async def _home_by_map(self) -> bool:
        """To its home by targets; False where it does not take them, or needs none."""
        kind, view, fence = self._view.kind, self._view, self._limits.fence
        height_m = self._view.height_m
        while self._by_map and view.armed and not self._monitor.overridden:
            self._monitor.commanded = (*kind.ours, kind.stream_mode, kind.rtl, kind.land)
            here, home = self._reporter.position(), self._reporter.home()
            if here.distance_to(home) <= OVER_HOME_M and view.ground_speed_m_s <= BRISK_M_S:
                return True
            corners = corners_home(fence, here, home)
            try:
                await self._aim(corners[0] if corners else home, height_m)
                await self._commands.speed(self._limits.energy.speed_m_s)
            except CommandRefusedError:
                return False
            except LinkError:
                await asyncio.sleep(PAUSE_S)
                continue
            # the place that its autopilot takes for home changes with every picture
            await asyncio.sleep(WATCH_S)
        return False

    # --- the end of a flight ----------------------------------------------------------------
    @property
    def responsible(self) -> bool:
        """Whether the vehicle is in the air, as far as anybody knows, and ours to bring home."""
        if self.entrusted and not self._monitor.met:
            return self._monitor.in_air_as_before
        in_air = self._monitor.was_airborne and not self._guard.down
        return in_air and not self._monitor.overridden

    def return_home(self, reason: str) -> None:
        """Have its autopilot return, from where home lies straight ahead."""
        if self._tasks is None or not self._corners():
            self.take_over("rtl", reason)
            return

        async def around() -> None:
            await self._turn_corners(reason)
            if self.responsible and not self.acting:
                self.take_over("rtl", reason)

        self._tasks.create_task(around())

    async def bring_home(self, reason: str) -> None:
        """Return a vehicle that is in the air, and wait until it is down or a pilot has it.

        Gives up on a silent one when its battery cannot have lasted any longer.
        """
        await self._turn_corners(reason)
        while self.responsible and (left_s := self._endurance_left_s()) > 0.0:
            self._take_up()
            if not self.acting:
                self.take_over("rtl", reason)
            await self._session.until(lambda: not self.responsible, min(left_s, HEARTBEAT_S))
        self._look()  # how it came down is told by nobody else

    def _take_up(self) -> None:
        """A vehicle that was silent when the mission ended, and speaks again."""
        monitor, view = self._monitor, self._view
        heard = self._reporter.loop_s() - min(view.heard_s, view.position_s) <= STALE_S
        if monitor.met and not monitor.connected and heard:
            monitor.report_connected()
            self.heard_again()

    async def _turn_corners(self, reason: str) -> None:
        """Fly it around what the fence forbids until home lies straight ahead.

        Watched by the same rules as ever: what goes wrong ends in its autopilot's return.
        """
        reporter, height_m, energy = self._reporter, self._view.height_m, self._limits.energy
        if not self._corners():
            return
        self._tell(f"vehicle {reporter.number}: {reason}; it is flown home around the fence")
        self.stand_aside()
        kind = self._view.kind
        # on a path it is in the mode of streams, which is ours until it has changed
        self._monitor.commanded = (*kind.ours, kind.stream_mode, kind.rtl, kind.land)
        here = reporter.position()
        if self._view.ground_speed_m_s > BRISK_M_S:
            # who flies fast flies on for a while, perhaps over a corner
            self.told(self._towards(here, here, height_m, CORNER_S))
            if not await self._reach(here, height_m, slow=True):
                return
        for corner in self._corners():
            here = reporter.position()
            leg_s = leg_over_ground_s(self._view, energy, here, corner) + CORNER_S
            self.told(self._towards(here, corner, height_m, leg_s))
            if not await self._reach(corner, height_m):
                return

    def _corners(self) -> tuple[GridPoint, ...]:
        """Where to turn until home lies straight ahead, if it flies to where it is told."""
        if self.acting or not self._flies_for_us():
            return ()
        return corners_home(self._limits.fence, self._reporter.position(), self._reporter.home())

    def _towards(
        self, here: GridPoint, corner: GridPoint, height_m: float, estimate_s: float
    ) -> Task:
        """The task of flying to a corner on the way home."""
        return Task(
            "leg", self._reporter.now_s(), (here, corner), homeward=True, height_m=height_m,
            estimate_s=estimate_s, name="way home",
        )  # fmt: skip

    async def _reach(self, corner: GridPoint, height_m: float, *, slow: bool = False) -> bool:
        """Fly to a corner, or, `slow`, only come to rest; False if that ends, or is refused."""

        def there() -> bool:
            if slow:
                return self._view.ground_speed_m_s <= BRISK_M_S
            return self._reporter.position().distance_to(corner) <= CORNER_M

        def over() -> bool:
            return self.acting or not self._flies_for_us()

        while not over() and self._endurance_left_s() > 0.0:
            try:
                await self._aim(corner, height_m)
                await self._commands.speed(self._limits.energy.speed_m_s)
            except CommandRefusedError:
                return False
            except LinkError:
                await asyncio.sleep(PAUSE_S)
                continue
            pause_s = RETRY_S if self._view.ground is None else WATCH_S
            await self._session.until(lambda: there() or over(), pause_s)
            if there():
                return not over()
        return False

    def _flies_for_us(self) -> bool:
        """Whether it is in the air, heard, and in a mode that follows targets."""
        heard = self._monitor.met and self._reporter.loop_s() - self._view.position_s <= STALE_S
        return self.responsible and heard and self._monitor.mode == "follow"

    def _endurance_left_s(self) -> float:
        """How long a vehicle that is silent since then can still be in the air."""
        endurance_s = self._last_wh * 3600.0 / self._limits.energy.hover_power_w + PATIENCE_S
        return max(self._view.heard_s, 0.0) + endurance_s - self._reporter.loop_s()

    async def leave(self, reason: str) -> None:
        """Have a vehicle that is in the air return, and wait only until it is seen to do so."""
        if not self.responsible:
            return
        if not self.acting:
            self.take_over("rtl", reason)
        kind = self._view.kind
        await self._session.until(
            lambda: self._view.mode in (kind.rtl, kind.land) or not self.responsible, LEAVE_S
        )

    def fate(self) -> str:
        """What is known of the vehicle at the very end, in words; empty if it is at home."""
        view, reporter = self._view, self._reporter
        if view.position is None or view.home is None:
            return ""  # it never came so far that it could have been told anything
        place = reporter.grid.position(reporter.position())
        where = f"{place.lat_deg:.6f}, {place.lon_deg:.6f}, {view.height_m:.0f} m up"
        if self.responsible:
            silent_s = reporter.loop_s() - view.heard_s
            if silent_s > STALE_S * 2:
                return f"in the air when it was last heard, {silent_s:.0f} s ago, at {where}"
            return f"left to its autopilot in {view.mode_name} at {where}"
        if self._monitor.was_airborne:
            return f"left to whoever flies it in {view.mode_name} at {where}"
        away_m = self._away_m()
        return f"on the ground {away_m:.0f} m from home, at {where}" if away_m > PAD_M else ""

    def _away_m(self) -> float:
        home: GridPoint = self._reporter.home()
        return self._reporter.position().distance_to(home)
