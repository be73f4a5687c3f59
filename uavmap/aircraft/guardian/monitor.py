"""What a vehicle does without being told: a pilot's mode change, a landing, its whereabouts.

Watched at every message, whatever the vehicle carries out just then.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Literal, Protocol

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.events import Connected, Landed, LiftedOff, Overridden, Released, Tracked
from missions.guardian import HARD_M_S
from missions.units import GridPoint
from uavmap.aircraft.guardian.impact import FALLS_S, Impact
from uavmap.aircraft.guardian.position_jumps import Leaps
from uavmap.aircraft.guardian.wind import WindEstimate
from uavmap.aircraft.reporter import Reporter
from uavmap.mavlink.session import Message
from uavmap.mavlink.vehicle_view import VehicleView

TRACK_S: Final = 1.0
PATH_TRACK_S: Final = 0.4
"""On a path that is flown without stopping: plans follow one another so fast."""
OFF_GROUND_M: Final = 2.0


class PlaceFinder(Protocol):
    """Finds out where the vehicle is when satellites do not say it
    (`uavmap.aircraft.map_navigation`).
    """

    @property
    def by_map(self) -> bool:
        """Whether positions are corrected by the vehicle's own pictures."""
        ...

    def leapt(self, how: str) -> bool:
        """The told position has leapt; False where nobody can tell where the vehicle is now."""
        ...

    def look(self, *, airborne: bool) -> None:
        """Look at what the vehicle tells; called with every position."""
        ...


class Monitor:
    """The state of a vehicle that matters to the mission, and the events that follow from it.

    `commanded` are the modes that follow from what we asked for last. Any other mode is somebody
    else's, and so is every mode while a failsafe flies.
    """

    def __init__(self, reporter: Reporter, view: VehicleView) -> None:
        self.commanded: tuple[int, ...] = ()
        self.connected = False
        self.on_path = False
        """Whether it was told to fly a path without stopping."""
        self.met = False
        """Whether it was ever connected."""
        self.was_airborne = False
        self.overridden = False
        self.mode_changes = 0
        self.wind = WindEstimate()
        self.leaps = Leaps()
        self.impact = Impact()
        self.why: Callable[[str], str | None] = lambda mode: None
        """Why the vehicle is in a mode that nobody asked for, by its own words."""
        self.navigation: PlaceFinder | None = None
        self.struck_m_s = 0.0
        """How fast it struck the ground; whoever takes note of it sets it to 0."""
        self._reporter = reporter
        self._view = view
        self._mode: int | None = None
        self._armed = self._failsafe = False
        self._refused = False
        """Whether it was taken from us on the ground, before a take-off."""
        self._tracked_s = float("-inf")
        self._down_s: float | None = None
        """Since when it stands on the ground by its own word, while that is not told yet."""

    def on_message(self, message: Message) -> None:
        """Look at the vehicle after a message of it."""
        name = message.get_type()
        if name == "HEARTBEAT":
            self._watch_mode()
        elif name == "ATTITUDE":
            self.wind.tilted(message.roll, message.pitch, message.yaw)
        elif name == "GLOBAL_POSITION_INT":
            if self.navigation is not None and self.connected:
                self.navigation.look(airborne=self.airborne)
            self._measure_wind()
            self._look_for_leaps()
            if self._view.gate.clock.boot_s is not None:
                self.impact.take(self._view.gate.clock.boot_s, self._view.velocity_ned_m_s[2])
            self._track()
        self._watch_landing()

    @property
    def mode(self) -> Literal["follow", "rtl", "land", "other"]:
        """Who flies: we (in what way), or somebody else."""
        view, kind = self._view, self._view.kind
        if self.overridden or view.failsafe:
            return "other"
        if view.mode == kind.rtl:
            return "rtl"
        if view.mode == kind.land:
            return "land"
        streamed = view.mode == kind.stream_mode and view.mode in self.commanded
        return "follow" if streamed or view.mode in kind.ours else "other"

    @property
    def by_map(self) -> bool:
        """Whether its autopilot does not know where it is, and its pictures do."""
        return self.navigation is not None and self.navigation.by_map

    @property
    def airborne(self) -> bool:
        """Armed, and not on the ground by the autopilot's own word."""
        return self._view.off_ground

    @property
    def in_air_as_before(self) -> bool:
        """In the air, in a mode that an earlier process of ours may have left it in.

        For a vehicle that is not connected yet: it may not have told everything.
        """
        view, kind = self._view, self._view.kind
        unsaid = (
            view.landed_state == mav.MAV_LANDED_STATE_UNDEFINED and view.height_m > OFF_GROUND_M
        )
        in_air = view.off_ground or (view.armed and unsaid)
        return in_air and not view.failsafe and view.mode in (*kind.ours, kind.rtl, kind.land)

    def _watch_mode(self) -> None:
        """The pilot has the last word: a mode that we did not ask for ends our say.

        On the ground, too: who turns the switch away while we wait to take off means it.
        """
        view, kind = self._view, self._view.kind
        mode, armed, failsafe = view.mode, view.armed, view.failsafe
        before = self._mode
        if not self.connected or (mode, armed, failsafe) == (before, self._armed, self._failsafe):
            return
        turned, was_armed = mode != before, self._armed
        self._mode, self._armed, self._failsafe = mode, armed, failsafe
        self.mode_changes += turned
        reporter = self._reporter
        if self.overridden:
            given = turned and mode == kind.follows and before not in kind.by_itself
            # what was taken in the air is given back in the air: a landed PX4 holds by itself
            if given and not failsafe and (armed or self._refused):
                self.overridden = False
                self.commanded = (kind.follows,)
                height_m = reporter.height_m() if self.airborne else 0.0
                reporter.report(
                    Released(reporter.number, reporter.t_s(), reporter.position(), height_m)
                )
            elif was_armed and not armed and not self.was_airborne:
                self.landed()  # taken from us between its arming and its take-off
        elif armed and not (was_armed or turned or failsafe) and mode in kind.ours:
            # by our order, though we may have asked for something else since
            if mode in self.commanded and mode == kind.follows:
                self.commanded = (*kind.ours, *self._unheard(before))
        elif self._not_by_us(mode, armed=armed, failsafe=failsafe, turned=turned):
            self.overridden = True
            self._refused = not armed
            cause = self.why(view.mode_name)
            reporter.report(
                Overridden(reporter.number, reporter.t_s(), view.mode_name, cause=cause)
            )
        elif mode == kind.follows:
            # what it stood in before counts no more: who turns the switch back there means it
            self.commanded = (*kind.ours, *self._unheard(before))

    def _unheard(self, before: int | None) -> tuple[int, ...]:
        """The landing that was asked for instead of a take-off, as long as it did not stand in that
        mode `before`: a slow link tells of it after others.

        In the air there is none: whoever turns a vehicle to land there is its pilot.
        """
        kind = self._view.kind
        if self.was_airborne or before == kind.land or kind.land not in self.commanded:
            return ()
        return (kind.land,)

    def _not_by_us(self, mode: int | None, *, armed: bool, failsafe: bool, turned: bool) -> bool:
        """Whether somebody else has the vehicle in this mode."""
        if armed:
            return failsafe or mode not in self.commanded
        waiting = turned and not self.was_airborne and not failsafe
        return waiting and mode not in (*self.commanded, *self._view.kind.ours)

    def _watch_landing(self) -> None:
        if not self.connected:
            return
        if self._view.on_ground and self.was_airborne:
            self._watch_touch_down()
            return
        self._down_s = None
        if self.airborne and not self.was_airborne:
            self.was_airborne = True
            self._reporter.report(LiftedOff(self._reporter.number, self._reporter.t_s()))

    def _watch_touch_down(self) -> None:
        """It has landed, by its own word: so has one whose motors were stopped in the air.

        That one falls still, or has struck the ground. Of a crash its guardian tells.
        """
        now_s = self._reporter.loop_s()
        self._down_s = now_s if self._down_s is None else self._down_s
        if self.impact.sinks and now_s - self._down_s < FALLS_S:
            return
        self.was_airborne = False
        if self.impact.speed_m_s <= HARD_M_S:
            self.landed()
            return
        self.struck_m_s = self.impact.speed_m_s
        self.wind.forget()

    def landed(self) -> None:
        """Say that the vehicle stands on the ground."""
        reporter = self._reporter
        # it keeps the mode in which it landed until somebody changes it
        if not self.overridden and self._view.mode is not None:
            mode = self._view.mode
            self.commanded = (*self._view.kind.ours, mode, *self._unheard(mode))
        self.wind.forget()
        reporter.report(
            Landed(
                reporter.number, reporter.t_s(), reporter.remaining(), position=reporter.position()
            )
        )

    def _measure_wind(self) -> None:
        north_m_s, east_m_s, _ = self._view.velocity_ned_m_s
        if self.airborne and self._view.height_m > 2.0:
            self.wind.moved(self._reporter.loop_s(), north_m_s, east_m_s)
        else:
            self.wind.forget()

    def _look_for_leaps(self) -> None:
        view = self._view
        if not self.airborne or view.position is None or view.gate.clock.boot_s is None:
            self.leaps.forget()
            return
        north_m_s, east_m_s, _ = view.velocity_ned_m_s
        self.leaps.take(view.gate.clock.boot_s, view.position, (north_m_s, east_m_s))

    def _track(self) -> None:
        reporter = self._reporter
        now_s = reporter.now_s()
        every_s = PATH_TRACK_S if self.on_path else TRACK_S
        if self.connected and now_s - self._tracked_s >= every_s - 1e-6:
            self._tracked_s = now_s
            reporter.report(
                Tracked(
                    reporter.number,
                    reporter.t_s(),
                    reporter.position(),
                    reporter.height_m(),
                    reporter.remaining(),
                    wind_m_s=self.wind.speed_m_s,
                )
            )

    def report_connected(self) -> None:
        """Say where the vehicle is, after its link was opened."""
        view, reporter = self._view, self._reporter
        airborne = view.armed and view.landed_state != mav.MAV_LANDED_STATE_ON_GROUND
        self.connected = self.met = True
        self.mode_changes += 1
        self._mode, self._armed, self._failsafe = view.mode, view.armed, view.failsafe
        self.was_airborne = airborne
        ours = view.mode in (*view.kind.ours, *self.commanded) and not view.failsafe
        if not airborne and view.mode is not None:
            # whatever mode it stands in, nobody has said no to us yet
            self.commanded = (*view.kind.ours, view.mode)
        self.commanded = self.commanded or view.kind.ours
        self.overridden = airborne and not ours
        home = reporter.home() if view.home is not None else GridPoint(0.0, 0.0)
        reporter.report(
            Connected(
                reporter.number,
                reporter.t_s(),
                home,
                reporter.position(),
                reporter.height_m(),
                airborne,
                ours,
                reporter.remaining(),
                home_amsl_m=reporter.home_amsl_m(),
                mode=self.mode if airborne else None,
            )
        )
