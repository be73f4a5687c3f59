"""The guardian of one aircraft, on its link: it keeps watch, whatever becomes of the mission.

It sends our heartbeat and watches telemetry by the rules of `missions.guardian`. If those demand
it, it has the autopilot return or land, until that is seen to happen. It needs a session and
nothing else: no journal, no strategy, no camera. So it continues when the service has ended, until
the aircraft is on the ground or a pilot has it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from dataclasses import replace
from typing import Any, Final

from missions.events import Crashed, Guarded
from missions.guardian import (
    HARD_LANDING_M_S,
    PAD_M,
    Action,
    Guard,
    Limits,
    Snapshot,
    Task,
    corners_home,
    watch,
)
from missions.guardian.rules import low
from missions.units import GridPoint
from uavmap.aircraft.control import AirState, Holder
from uavmap.aircraft.controlled_commands import ControlledCommands
from uavmap.aircraft.guardian.monitor import Monitor
from uavmap.aircraft.guardian.recovery import (
    BRISK_M_S,
    CHECK_INTERVAL_S,
    STOP_MOTORS_S,
    RecoveryFlight,
)
from uavmap.aircraft.legs import leg_over_ground_s
from uavmap.aircraft.reporter import Reporter
from uavmap.mavlink.session import Session

HEARTBEAT_S: Final = 1.0
SLEW_S: Final = 4.0
"""Time that a navigation filter takes to follow a jump, s."""
MAX_TELEMETRY_AGE_S: Final = 3.0
"""Maximum age of telemetry, s."""
MAX_POSITION_AGE_S: Final = 1.0
"""Maximum age of a position by which a vehicle is judged, s, by the vehicle's own clock."""
SILENCE_AFTER_BATTERY_S: Final = 60.0
"""Wait for a silent vehicle beyond what its battery can have lasted, s."""
CORNER_S: Final = 5.0
"""Time to start towards a corner, and to come to rest there, s."""
MAX_RETURN_WAIT_S: Final = 15.0
"""Wait, for an operator who leaves at once, to see that the autopilot returns, s."""

_WORDS: Final = {"rtl": "return (RTL)", "land": "land where it is"}


class Guardian:
    """Keeps watch over one aircraft; `stand_aside` ends the mission's order."""

    def __init__(
        self, session: Session, reporter: Reporter, monitor: Monitor, limits: Limits
    ) -> None:
        self._session = session
        commands = ControlledCommands(session, monitor, guardian=True)
        self._flight = RecoveryFlight(commands, reporter, limits)
        self._view = session.view
        self._reporter = reporter
        self._monitor = monitor
        self._limits = limits
        self._guard = Guard()
        self._pursuit: asyncio.Task[None] | None = None
        self._tasks: asyncio.TaskGroup | None = None
        self._jumps = session.view.gate.track.jumps
        self._last_wh = limits.energy.capacity_wh
        self._reason = ""
        self._leapt_s = float("-inf")
        """Time of the last jump of its position, on the loop's clock, s."""
        self.entrusted = False
        """True if it was in the air by our order when an earlier process ended."""
        self.stand_aside: Callable[[], None] = lambda: None
        self.order_failed: Callable[[str, bool], None] = lambda reason, behind: None

    # --- what the driver tells it -----------------------------------------------------------
    @property
    def acting(self) -> bool:
        """True if the guardian has the vehicle now."""
        return self._monitor.control.holder is Holder.GUARDIAN

    def note_task(self, task: Task) -> None:
        """Note a new order of the mission."""
        if self.acting and not self._view.armed:
            self._let_go()
        self._guard = self._guard.with_task(task)

    def take_over(self, action: Action, reason: str, *, hurry: bool = False) -> None:
        """Have the autopilot return or land by itself, and ensure it; not if a pilot has control.

        `hurry`: it first descends as fast as it flies.
        """
        if not self._monitor.control.is_under_control:
            return
        self._guard = self._guard.with_action(action, self._reporter.now_s(), hurry=hurry)
        self._reason = reason
        self.stand_aside()
        self._monitor.control = self._monitor.control.with_guardian(guardian=True)
        number = self._reporter.number
        by_map = action == "rtl" and self._monitor.by_map
        way = "fly home by its own map" if by_map else _WORDS[action]
        self._reporter.line(f"vehicle {number}: {reason}; it is commanded to {way}")
        self._reporter.report_now(Guarded, action, reason)
        self._begin(self._pursue(action, hurry=hurry))

    def _begin(self, pursuit: Coroutine[Any, Any, None]) -> None:
        if self._pursuit is not None:
            self._pursuit.cancel()
        begin = self._tasks.create_task if self._tasks is not None else asyncio.ensure_future
        self._pursuit = begin(pursuit)

    def repeat_command(self) -> None:
        """Repeat, and log, its command from before the link was lost."""
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
        """Check every new position, but not too often: by an old one it seems to stand still."""
        looked_s = seen_s = float("-inf")
        while True:
            await asyncio.sleep(CHECK_INTERVAL_S)
            now_s, told_s = self._reporter.loop_s(), self._view.position_s
            if told_s > seen_s or now_s - looked_s >= 2.0 * CHECK_INTERVAL_S:
                looked_s, seen_s = now_s, told_s
                self._check()

    def _check(self) -> None:
        seen = self._snapshot()
        if seen is None:
            return
        if seen.remaining_wh is not None:
            self._last_wh = seen.remaining_wh
        if self._guard.action is not None and not self.acting:
            self._let_go()
        self._look_for_leaps(seen)
        seen = replace(seen, slews=self._reporter.loop_s() - self._leapt_s < SLEW_S)
        self._guard, verdict = watch(self._limits, self._guard, seen)
        self._monitor.struck_m_s = 0.0
        if not seen.armed and not seen.airborne and self._guard.action is not None:
            self._let_go()
        if verdict is None:
            return
        if verdict.rung == "report":
            self.order_failed(verdict.reason, verdict.behind)
        elif verdict.rung == "crashed":
            self._report_crash(seen, verdict.reason)
        else:
            action: Action = "land" if verdict.rung == "land" else "rtl"
            self.take_over(action, verdict.reason, hurry=verdict.hurry)

    def _look_for_leaps(self, seen: Snapshot) -> None:
        """End the mission of a vehicle whose position jumped: its positions mean nothing."""
        track, leaps = self._view.gate.track, self._monitor.leaps
        leapt, leaps.leapt = leaps.leapt, ""
        if track.jumps != self._jumps:  # too far to be accepted at once, and it persisted
            self._jumps, leapt = track.jumps, f"its position has jumped by {track.jumped_m:.0f} m"
        if leapt:
            self._leapt_s = self._reporter.loop_s()
        if low(seen):
            return  # the ground has stopped it: a vehicle on the ground gets no order to fly on
        if leapt and not self.acting and seen.airborne and seen.mode != "other":
            finder = self._monitor.navigation
            if finder is not None and finder.leapt(leapt):
                return
            self.order_failed(f"{leapt}: satellite navigation cannot be trusted", False)

    def _snapshot(self) -> Snapshot | None:
        """Return the telemetry, None if it is too old."""
        view, reporter = self._view, self._reporter
        if not self._monitor.connected or view.position is None or view.home is None:
            return None
        age_s = view.age_s(reporter.loop_s())
        if age_s > MAX_POSITION_AGE_S + self._limits.slack_s:
            return None
        return Snapshot(
            t_s=reporter.now_s() - age_s,
            position=reporter.position(),
            height_m=view.height_m,
            home_amsl_m=view.home_amsl_m,
            ground_speed_m_s=view.ground_speed_m_s,
            home=reporter.home(),
            armed=view.armed,
            airborne=self._monitor.control.off_ground,
            mode=self._monitor.mode,
            remaining_wh=reporter.remaining_wh(),
            wind_m_s=self._monitor.wind.speed_m_s,
            struck_m_s=self._monitor.struck_m_s,
            by_map=self._monitor.by_map,
        )

    def _report_crash(self, seen: Snapshot, reason: str) -> None:
        """Report the place of a crash, and have motors stopped that still run."""
        reporter = self._reporter
        place = reporter.grid.position(seen.position)
        reporter.line(
            f"vehicle {reporter.number} is down near {place.lat_deg:.6f}, {place.lon_deg:.6f}: "
            f"{reason}"
        )
        self.stand_aside()
        reporter.report_now(Crashed, seen.position, reason)
        self._monitor.control = self._monitor.control.with_guardian(guardian=True).with_crash()
        struck = self._guard.fell or seen.struck_m_s > HARD_LANDING_M_S
        self._begin(self._flight.stop_motors(struck=struck))

    def _let_go(self) -> None:
        """End its action: a pilot has control, or the vehicle is on the ground."""
        self._monitor.control = self._monitor.control.with_guardian(guardian=False)
        self._guard = self._guard.released()
        if self._pursuit is not None:
            self._pursuit.cancel()
            self._pursuit = None

    async def _pursue(self, action: Action, *, hurry: bool = False) -> None:
        """Command the action until the autopilot does it; if it refuses, land instead."""
        if action == "rtl" and await self._flight.fly_home_by_map():
            self.take_over("land", "it is over its home by its own map")
            return
        quickly = hurry and await self._flight.descend()
        refusal = await self._flight.ask_autopilot(action)
        if refusal:
            self.take_over("land", refusal)
            return
        # at its place the ground may be lower than at its home
        high = lambda: self._flight.descent_aim_m() is not None  # noqa: E731
        if quickly and await self._session.until(high, SILENCE_AFTER_BATTERY_S):
            await self._pursue(action, hurry=True)

    # --- the end of a flight ----------------------------------------------------------------
    @property
    def responsible(self) -> bool:
        """True if the vehicle is in the air, as far as known, and under our control."""
        control = self._monitor.control
        known = self._monitor.met or self.entrusted
        return known and control.air.may_be_up and control.is_under_control

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
        """Return a vehicle in the air, and wait for the end of its flight.

        The flight ends when it is down, a pilot has it, or it is silent for longer than its battery
        can have lasted.
        """
        await self._turn_corners(reason)
        while self.responsible and (left_s := self._endurance_left_s()) > 0.0:
            self._reconnect()
            if not self.acting:
                self.take_over("rtl", reason)
            await self._session.until(lambda: not self.responsible, min(left_s, HEARTBEAT_S))
        self._check()  # no other code reports how it came down
        if self._monitor.control.air is AirState.DOWN:
            await self._session.until(lambda: not self._view.armed, STOP_MOTORS_S)

    def _reconnect(self) -> None:
        """Reconnect a vehicle that was silent when the mission ended, and is received again."""
        monitor, view = self._monitor, self._view
        received = view.silent_s(self._reporter.loop_s()) <= MAX_TELEMETRY_AGE_S
        if monitor.met and not monitor.connected and received:
            monitor.report_connected()
            self.repeat_command()

    async def _turn_corners(self, reason: str) -> None:
        """Fly it around holes of the fence until home lies straight ahead.

        The same rules watch it: a fault ends in its autopilot's return.
        """
        reporter, height_m, energy = self._reporter, self._view.height_m, self._limits.energy
        if not self._corners():
            return
        reporter.line(f"vehicle {reporter.number}: {reason}; it is flown home around the fence")
        self.stand_aside()
        here = reporter.position()
        if self._view.ground_speed_m_s > BRISK_M_S:
            # a fast vehicle flies on for a while, perhaps over a corner
            self.note_task(self._towards(here, here, height_m, CORNER_S))
            if not await self._flight.reach(here, height_m, self._over, slow=True):
                return
        for corner in self._corners():
            here = reporter.position()
            leg_s = leg_over_ground_s(self._view, energy, here, corner) + CORNER_S
            self.note_task(self._towards(here, corner, height_m, leg_s))
            if not await self._flight.reach(corner, height_m, self._over):
                return

    def _corners(self) -> tuple[GridPoint, ...]:
        """Return the places to turn at until home lies straight ahead, if it follows targets."""
        if self.acting or not self._flies_for_us():
            return ()
        return corners_home(self._limits.fence, self._reporter.position(), self._reporter.home())

    def _towards(
        self, here: GridPoint, corner: GridPoint, height_m: float, estimate_s: float
    ) -> Task:
        return Task(
            "leg", self._reporter.now_s(), (here, corner), homeward=True, height_m=height_m,
            estimate_s=estimate_s, name="return path",
        )  # fmt: skip

    def _over(self) -> bool:
        """Return whether a flight to a corner ends: guardian, pilot, or empty battery."""
        return self.acting or not self._flies_for_us() or self._endurance_left_s() <= 0.0

    def _flies_for_us(self) -> bool:
        late_s = self._reporter.loop_s() - self._view.position_s
        received = (
            self._monitor.met and late_s <= MAX_TELEMETRY_AGE_S and not self._view.gate.clock.late
        )
        return self.responsible and received and self._monitor.mode == "follow"

    def _endurance_left_s(self) -> float:
        endurance_s = (
            self._last_wh * 3600.0 / self._limits.energy.hover_power_w + SILENCE_AFTER_BATTERY_S
        )
        return max(self._view.received_s, 0.0) + endurance_s - self._reporter.loop_s()

    async def leave(self, reason: str) -> None:
        """Have a vehicle that is in the air return, and wait only until that is seen."""
        if not self.responsible:
            return
        if not self.acting:
            self.take_over("rtl", reason)
        kind = self._view.kind
        await self._session.until(
            lambda: self._view.mode in (kind.rtl, kind.land) or not self.responsible,
            MAX_RETURN_WAIT_S,
        )

    def fate(self) -> str | None:
        """Return where the vehicle is at the very end, as text.

        Empty at home; None if it never reported enough to be commanded.
        """
        view, reporter = self._view, self._reporter
        if view.position is None or view.home is None:
            return None
        place = reporter.grid.position(reporter.position())
        where = f"{place.lat_deg:.6f}, {place.lon_deg:.6f}, {view.height_m:.0f} m up"
        if self.responsible:
            silent_s = view.silent_s(reporter.loop_s())
            if silent_s > MAX_TELEMETRY_AGE_S * 2:
                return f"in the air at its last report, {silent_s:.0f} s ago, at {where}"
            return f"left to its autopilot in {view.mode_name} at {where}"
        if self._monitor.control.air.may_be_up:
            return f"flown by a pilot or a failsafe in {view.mode_name} at {where}"
        away_m = reporter.position().distance_to(reporter.home())
        runs = ", and its motors still run" if view.armed else ""
        if away_m > PAD_M or runs:
            return f"on the ground {away_m:.0f} m from home, at {where}{runs}"
        return ""
