"""What a vehicle does without being told: a pilot's mode change, a landing, its whereabouts.

Watched at every message, whatever the vehicle carries out just then.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import LinkError
from missions.events import Connected, Event, Landed, Overridden, Released, Tracked
from missions.ground.grid import Grid
from missions.units import GridPoint
from uavmap.link.session import Message
from uavmap.link.view import VehicleView

Report = Callable[[Event], None]

TRACK_S: Final = 1.0
BATTERY_STALE_S: Final = 10.0
"""A charge that is older counts as none: the vehicle comes home while it can."""

_OFF_GROUND: Final = (
    mav.MAV_LANDED_STATE_TAKEOFF,
    mav.MAV_LANDED_STATE_IN_AIR,
    mav.MAV_LANDED_STATE_LANDING,
)
"""A take-off that is called off goes from the first of these to the last."""


class Watch:
    """The state of a vehicle that matters to the mission, and the events that follow from it.

    `commanded` are the modes that follow from what we asked for last; every other is somebody
    else's, and so is each while a failsafe flies.
    """

    def __init__(
        self,
        number: int,
        name: str,
        view: VehicleView,
        capacity_wh: float,
        grid: Grid,
        now_s: Callable[[], float],
        loop_s: Callable[[], float],
    ) -> None:
        self.number = number
        self.name = name
        self.now_s = now_s
        self.report: Report = lambda event: None
        self.commanded: tuple[int, ...] = ()
        self.connected = False
        self.was_airborne = False
        self.mode_changes = 0
        self._loop_s = loop_s
        self._view = view
        self._capacity_wh = capacity_wh
        self._grid = grid
        self._mode: int | None = None
        self._armed = self._failsafe = False
        self._overridden = False
        self._tracked_s = float("-inf")

    def on_message(self, message: Message) -> None:
        """Look at the vehicle after a message of it."""
        name = message.get_type()
        if name == "HEARTBEAT":
            self._watch_mode()
        elif name == "GLOBAL_POSITION_INT":
            self._track()
        self._watch_landing()

    def _watch_mode(self) -> None:
        """The pilot has the last word: a mode that we did not ask for ends our say."""
        view, kind = self._view, self._view.kind
        mode, armed, failsafe = view.mode, view.armed, view.failsafe
        before = self._mode
        if not self.connected or (mode, armed, failsafe) == (before, self._armed, self._failsafe):
            return
        turned = mode != before
        self._mode, self._armed, self._failsafe = mode, armed, failsafe
        self.mode_changes += turned
        if self._overridden:
            given = turned and mode == kind.follows and before not in kind.by_itself
            if given and armed and not failsafe:
                self._overridden = False
                self.commanded = (kind.follows,)
                self.report(Released(self.number, self.t_s(), self.position(), self._height_m()))
        elif armed and (failsafe or mode not in self.commanded):
            self._overridden = True
            self.report(Overridden(self.number, self.t_s(), self._view.mode_name))

    def _watch_landing(self) -> None:
        if not self.connected:
            return
        if self._view.on_ground and self.was_airborne:
            self.was_airborne = False
            self.report(Landed(self.number, self.t_s(), self.remaining()))
        elif self._view.landed_state in _OFF_GROUND and self._view.armed:
            self.was_airborne = True

    def _track(self) -> None:
        now_s = self.now_s()
        if self.connected and now_s - self._tracked_s >= TRACK_S - 1e-6:
            self._tracked_s = now_s
            self.report(
                Tracked(
                    self.number, self.t_s(), self.position(), self._height_m(), self.remaining()
                )
            )

    def report_connected(self) -> None:
        """Say where the vehicle is, after its link was opened."""
        view = self._view
        airborne = view.armed and view.landed_state != mav.MAV_LANDED_STATE_ON_GROUND
        self.connected = True
        self.mode_changes += 1
        self._mode, self._armed, self._failsafe = view.mode, view.armed, view.failsafe
        self.was_airborne = airborne
        ours = view.mode in view.kind.ours and not view.failsafe
        self.commanded = self.commanded or view.kind.ours
        self._overridden = airborne and not ours
        home = self._grid.fixed(view.home) if view.home is not None else GridPoint(0.0, 0.0)
        self.report(
            Connected(
                self.number,
                self.t_s(),
                _rounded(home),
                self.position(),
                self._height_m(),
                airborne,
                ours,
                self.remaining(),
            )
        )

    # --- what it knows, rounded for the journal ----------------------------------------------
    def t_s(self) -> float:
        """Mission time, to a millisecond."""
        return round(self.now_s(), 3)

    def position(self) -> GridPoint:
        """Where the vehicle is, in the fixed frame. Raises `LinkError` if it has not said."""
        if self._view.position is None:
            raise LinkError(f"{self.name}: the vehicle has not said where it is")
        return _rounded(self._grid.fixed(self._view.position))

    def _height_m(self) -> float:
        return round(self._view.height_m, 2)

    def remaining_wh(self) -> float | None:
        """The charge, None when it is not known or not known any more."""
        if self._loop_s() - self._view.battery_s > BATTERY_STALE_S:
            return None
        return self._view.remaining_wh(self._capacity_wh)

    def remaining(self) -> float:
        """The charge for an event; unknown counts as empty, so that the vehicle comes home."""
        return round(self.remaining_wh() or 0.0, 3)


def _rounded(point: GridPoint) -> GridPoint:
    return GridPoint(round(point.east_m, 2), round(point.north_m, 2))
