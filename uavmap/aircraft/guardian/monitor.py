"""The monitor of a vehicle's own actions: mode changes, landings, its position at every message."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Final, Protocol

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.events import Connected, Landed, LiftedOff, Overridden, Released, Tracked
from missions.guardian import HARD_LANDING_M_S
from missions.units import GridPoint
from uavmap.aircraft.control import AirState, Beat, Control, FlownMode, Ground, Holder
from uavmap.aircraft.guardian.estimates import FALLS_S, Impact, Leaps, WindEstimate
from uavmap.aircraft.reporter import Reporter
from uavmap.mavlink.session import GROUND_SYSTEM_ID, Message
from uavmap.mavlink.vehicle_view import OFF_GROUND_M

TRACK_S: Final = 1.0
PATH_TRACK_S: Final = 0.4
"""Interval on a path that is flown without stopping, s: plans follow that fast."""


class PlaceFinder(Protocol):
    """Finds the position where satellites do not (`uavmap.aircraft.map_navigation`)."""

    @property
    def by_map(self) -> bool:
        """True if positions are corrected by the vehicle's own pictures."""

    def leapt(self, how: str) -> bool:
        """Note that the reported position jumped; return False if the true one cannot be known."""

    def check(self, *, airborne: bool) -> None:
        """Check the telemetry; called with every position."""


class Monitor:
    """The state of a vehicle that matters to the mission, and its events."""

    def __init__(self, reporter: Reporter) -> None:
        self.control = Control()
        """Holder of its control and state of flight, by the latest report."""
        self.connected = False
        self.on_path = False
        """True if its order is a path without stopping."""
        self.met = False
        """True once it has been connected."""
        self.resumed = False
        """True if it was landing or returning by our order when an earlier process ended."""
        self.wind = WindEstimate()
        self.leaps = Leaps()
        self.impact = Impact()
        self.why: Callable[[str], str | None] = lambda mode: None
        """Returns the cause of a mode that was not commanded, by the vehicle's own texts."""
        self.navigation: PlaceFinder | None = None
        self.struck_m_s = 0.0
        """Speed at which it struck the ground, m/s; its reader sets it to 0."""
        self._reporter = reporter
        self._view = reporter.view
        self._scopes: set[asyncio.Timeout] = set()
        self._tracked_s = float("-inf")
        self._down_s: float | None = None
        """Time since which it reports itself on the ground without that being passed on, s."""

    def on_message(self, message: Message) -> None:
        """Check the vehicle after one of its messages."""
        name = message.get_type()
        before = self.control
        if name == "HEARTBEAT" and message.get_srcComponent() == self._view.autopilot_component:
            self._watch_mode(None)
        elif name == "CURRENT_MODE":
            self._watch_mode(self._view.landed_state)
        elif name == "COMMAND_ACK":
            self._note_acknowledgement(message)
        elif name == "ATTITUDE":
            self.wind.add_attitude(message.roll, message.pitch, message.yaw)
        elif name == "GLOBAL_POSITION_INT":
            if self.navigation is not None and self.connected:
                self.navigation.check(airborne=self.control.off_ground)
            self._measure_wind()
            self._look_for_leaps()
            if self._view.gate.clock.boot_s is not None:
                self.impact.add(self._view.gate.clock.boot_s, self._view.velocity_ned_m_s[2])
            self._track()
        self._watch_ground()
        if self.connected:
            self._report_flight(before)

    @property
    def mode(self) -> FlownMode:
        """Flown mode: by us (in what way), or by another."""
        return self.control.flown(self._view.kind)

    @property
    def by_map(self) -> bool:
        """True if its autopilot does not know its position, and its pictures do."""
        return self.navigation is not None and self.navigation.by_map

    @contextlib.contextmanager
    def ends_with_control(self, scope: asyncio.Timeout) -> Iterator[None]:
        """End a scope of asyncio as soon as the vehicle is not under our control."""
        self._scopes.add(scope)
        try:
            yield
        finally:
            self._scopes.discard(scope)

    # --- control -----------------------------------------------------------------------------
    def _watch_mode(self, landed_state: int | None) -> None:
        """End our control at a mode that we did not command, also on the ground: it is the pilot's.

        `landed_state`: None for the mode of a heartbeat.
        """
        view, before = self._view, self.control
        if view.mode is None:
            return
        now_s = self._reporter.loop_s()
        beat = Beat(view.mode, view.armed, view.failsafe, now_s, landed_state)
        if self.met:
            control = before.with_beat(view.kind, beat)
        else:  # an earlier process may have left it returning or landing
            control = before.with_content(beat).with_connection(view.kind, resumed=True)
        if self.connected and before.is_under_control and not control.is_under_control:
            control = control.with_cause(self.why(view.mode_name))
        self.control = control
        while self._scopes and not control.is_under_control:
            self._scopes.pop().reschedule(self._reporter.loop_s())
        if self.connected:
            self._report_control(before)

    def _report_control(self, before: Control) -> None:
        control, reporter = self.control, self._reporter
        # also from one mode to another: RTL and LOITER fly to different places
        turned = control.armed and control.mode != before.mode
        if not control.is_under_control and (before.is_under_control or turned):
            reporter.report_now(Overridden, self._view.mode_name, cause=control.cause or None)
        elif control.is_under_control and not before.is_under_control:
            height_m = reporter.height_m() if control.off_ground else 0.0
            reporter.report_now(Released, reporter.position(), height_m)

    def _note_acknowledgement(self, ack: Message) -> None:
        """Note whether the autopilot accepts the commanded mode.

        A PX4 acknowledges DO_SET_MODE on receipt and when its commander has decided. Either may be
        lost: the first acceptance counts until a refusal follows.
        """
        kind, request = self._view.kind, self.control.request
        if request is None:
            return
        command = {
            kind.stream_mode: mav.MAV_CMD_DO_SET_MODE,
            kind.land: mav.MAV_CMD_NAV_LAND,
            kind.rtl: mav.MAV_CMD_NAV_RETURN_TO_LAUNCH,
        }.get(request.mode)
        if command != ack.command or ack.target_system not in (0, GROUND_SYSTEM_ID):
            return
        if ack.result == mav.MAV_RESULT_ACCEPTED:
            self.control = self.control.with_acknowledgement(self._reporter.loop_s())
        elif ack.result != mav.MAV_RESULT_IN_PROGRESS:
            self.control = self.control.with_denial()

    # --- flight ------------------------------------------------------------------------------
    def _watch_ground(self) -> None:
        """Note whether it is on the ground.

        A vehicle whose motors stopped in the air reports so as well. It still falls, or has struck
        the ground, which its guardian reports as a crash.
        """
        view, now_s = self._view, self._reporter.loop_s()
        height_m = view.height_m if view.position is not None else None
        ground = Ground(view.armed, view.landed_state, height_m)
        if not (ground.stands and self.control.air.is_flying):
            self._down_s = None
        else:
            self._down_s = now_s if self._down_s is None else self._down_s
            if self.impact.sinks and now_s - self._down_s < FALLS_S:
                return
        self.control = self.control.with_ground(ground, view.kind, now_s)

    def _report_flight(self, before: Control) -> None:
        control = self.control
        if control.air.is_flying and not before.air.is_flying:
            self._reporter.report_now(LiftedOff)
        stood = not before.armed and not before.air.may_be_up
        if stood or control.armed or control.air is not AirState.ON_GROUND:
            return
        if before.air.is_flying and self.impact.speed_m_s > HARD_LANDING_M_S:
            self.struck_m_s = self.impact.speed_m_s
            self.wind.forget()
            return
        lands = before.request is not None and before.request.mode == self._view.kind.land
        if before.air.is_flying or lands or control.holder is not Holder.OURS:
            self.report_landing()

    def report_landing(self) -> None:
        """Report that the vehicle is on the ground."""
        reporter = self._reporter
        self.wind.forget()
        reporter.report_now(Landed, reporter.remaining(), position=reporter.position())

    def _measure_wind(self) -> None:
        north_m_s, east_m_s, _ = self._view.velocity_ned_m_s
        if self.control.off_ground and self._view.height_m > OFF_GROUND_M:
            self.wind.add_velocity(self._reporter.loop_s(), north_m_s, east_m_s)
        else:
            self.wind.forget()

    def _look_for_leaps(self) -> None:
        view = self._view
        if not self.control.off_ground or view.position is None or view.gate.clock.boot_s is None:
            self.leaps.forget()
            return
        north_m_s, east_m_s, _ = view.velocity_ned_m_s
        self.leaps.add(view.gate.clock.boot_s, view.position, (north_m_s, east_m_s))

    def _track(self) -> None:
        reporter = self._reporter
        now_s = reporter.now_s()
        every_s = PATH_TRACK_S if self.on_path else TRACK_S
        if self.connected and now_s - self._tracked_s >= every_s - 1e-6:
            self._tracked_s = now_s
            reporter.report_now(
                Tracked, reporter.position(), reporter.height_m(), reporter.remaining(),
                wind_m_s=self.wind.speed_m_s,
            )  # fmt: skip

    def report_connected(self) -> None:
        """Report the vehicle's position after its link was opened."""
        view, reporter = self._view, self._reporter
        self.connected = self.met = True
        self.control = replace(self.control, air=AirState.UNKNOWN)
        self._watch_ground()
        self.control = self.control.with_connection(view.kind, resumed=self.resumed)
        airborne = self.control.in_air
        home = reporter.home() if view.home is not None else GridPoint(0.0, 0.0)
        reporter.report_now(
            Connected, home, reporter.position(), reporter.height_m(), airborne,
            self.control.is_under_control, reporter.remaining(), home_amsl_m=reporter.home_amsl_m(),
            mode=self.mode if airborne else None,
        )  # fmt: skip
