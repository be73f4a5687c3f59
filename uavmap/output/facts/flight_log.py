"""The course of a flight from its journal, event by event, and its counts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal, NamedTuple, TypeVar

from missions import events as ev
from missions.events import (
    AutopilotText,
    BatterySwapped,
    Connected,
    Event,
    Landed,
    Navigated,
    Tracked,
)
from missions.flight.state import State
from missions.flight.vehicle_state import Phase, VehicleState
from missions.orders import FlyPath
from missions.units import GridPoint
from uavmap.base.printable import printable

E = TypeVar("E", bound=Event)
Kind = Literal["fault", "refusal", "link", "pilot", "operator", "frame", "text"]

WARNING: Final = 4
"""Maximum MAV_SEVERITY at which a text of a vehicle counts as a fault."""


_ORDERS: Final[Mapping[type[Event], str]] = {
    ev.VehicleRecalled: "called home",
    ev.Recalled: "all vehicles called home",
    ev.Paused: "paused",
    ev.Continued: "continued",
    ev.Resumed: "resumed after an interruption",
}
_GNSS: Final = {
    "good": "satellite navigation is back",
    "lost": "satellite navigation is lost",
    "wrong": "satellite navigation gives a wrong position",
}


class Fix(NamedTuple):
    """A vehicle's place in the fixed frame, its height above home and its charge."""

    t_s: float
    place: GridPoint
    height_m: float
    remaining_wh: float


class FrameRow(NamedTuple):
    """A judged frame: the number of cells with a vote, and of votes for region."""

    vehicle: int
    t_s: float
    cells: int
    positive: int


class Trouble(NamedTuple):
    """A fault, or an action of a person; `vehicle` 0 stands for the whole mission."""

    t_s: float
    vehicle: int
    kind: Kind
    text: str


class Sortie(NamedTuple):
    """A flight of a vehicle from lift-off to touch-down, or to its last known position."""

    vehicle: int
    number: int
    start_s: float
    end_s: float
    ended: bool
    """True if it has landed."""


@dataclass(slots=True)
class FlightLog:
    """The course of a flight; times are mission seconds.

    Attributes:
        frames: Judged frames, in the order of judging.
        swaps: Vehicle and time of each fresh battery.
        homes: Last reported home of each vehicle.
        amsl_m: Height above the sea of the first reported home.
    """

    fixes: dict[int, list[Fix]] = field(default_factory=dict)
    frames: list[FrameRow] = field(default_factory=list)
    troubles: list[Trouble] = field(default_factory=list)
    swaps: list[tuple[int, float]] = field(default_factory=list)
    homes: dict[int, GridPoint] = field(default_factory=dict)
    amsl_m: float | None = None
    _on_ground: dict[int, list[float]] = field(default_factory=dict)
    _gnss: dict[int, str] = field(default_factory=dict)

    @classmethod
    def from_events(cls, events: Iterable[Event]) -> FlightLog:
        """Create the log of a journal's events."""
        log = cls()
        for event in events:
            log.note(event)
        return log

    def noting(self, events: Iterable[E]) -> Iterator[E]:
        """Note events, and yield each of them."""
        for event in events:
            self.note(event)
            yield event

    def note(self, event: Event) -> None:
        """Note an event."""
        if isinstance(event, ev.Tracked):
            fix = Fix(event.t_s, event.position, event.height_m, event.remaining_wh)
            self.fixes.setdefault(event.vehicle, []).append(fix)
        elif isinstance(event, ev.FrameSeen):
            positive = sum(vote.positive for vote in event.votes)
            self.frames.append(FrameRow(event.vehicle, event.t_s, len(event.votes), positive))
        elif isinstance(event, ev.Landed):
            self._on_ground.setdefault(event.vehicle, []).append(event.t_s)
        elif isinstance(event, ev.BatterySwapped):
            self.swaps.append((event.vehicle, event.t_s))
        elif isinstance(event, ev.Connected | ev.Airborne):
            self._home(event)
        elif isinstance(event, ev.Navigated):
            before = self._gnss.get(event.vehicle, "good")
            self._gnss[event.vehicle] = event.gnss
            if event.gnss != before:
                self.troubles.append(Trouble(event.t_s, event.vehicle, "fault", _GNSS[event.gnss]))
        elif (trouble := _trouble(event)) is not None:
            self.troubles.append(trouble)

    def _home(self, event: ev.Connected | ev.Airborne) -> None:
        if event.home is not None:
            self.homes[event.vehicle] = event.home
        if self.amsl_m is None:
            self.amsl_m = event.home_amsl_m
        if isinstance(event, ev.Connected) and not event.airborne:
            self._on_ground.setdefault(event.vehicle, []).append(event.t_s)

    def fixes_of(self, sortie: Sortie) -> list[Fix]:
        """Return the positions of a sortie."""
        own = self.fixes[sortie.vehicle]
        return [fix for fix in own if sortie.start_s <= fix.t_s <= sortie.end_s]

    def sorties(self) -> list[Sortie]:
        """Return all flights, by vehicle and time."""
        found: list[Sortie] = []
        for vehicle, fixes in sorted(self.fixes.items()):
            landings = iter(sorted(self._on_ground.get(vehicle, ())))
            landing, start_s, last_s, number = next(landings, None), None, 0.0, 0
            for fix in fixes:
                while landing is not None and fix.t_s > landing:
                    if start_s is not None:
                        # after an interruption the time of landing is unknown
                        number += 1
                        found.append(Sortie(vehicle, number, start_s, landing, True))
                        start_s = None
                    landing = next(landings, None)
                if start_s is None and fix.height_m >= LIFT_OFF_M:
                    start_s = fix.t_s
                last_s = fix.t_s
            if start_s is not None:
                end_s = last_s if landing is None else landing
                found.append(Sortie(vehicle, number + 1, start_s, end_s, landing is not None))
        return found


def _trouble(event: Event) -> Trouble | None:
    """Return the fault, or the action of a person, in an event; None for other events."""
    kind: Kind
    match event:
        case ev.FrameLost(reason=text):
            kind = "frame"
        case ev.OrderFailed(order=order, reason=reason):
            kind, text = "refusal" if "refused" in reason else "fault", f"{order} failed: {reason}"
        case ev.Guarded(action=action, reason=reason):
            kind, text = "fault", f"guardian: {action}, {reason}"
        case ev.Crashed(reason=reason):
            kind, text = "fault", f"down: {reason}"
        case ev.GivenUp(reason=reason):
            kind, text = "link", f"given up: {reason}"
        case ev.LinkLost():
            kind, text = "link", "link lost"
        case ev.Overridden(mode=mode, cause=cause):
            why = f" ({cause})" if cause else ""
            kind, text = "pilot", f"changed by the pilot or a failsafe: {mode}{why}"
        case ev.Released():
            kind, text = "pilot", "under our control again"
        case ev.AutopilotText(severity=severity, text=found, times=times) if severity <= WARNING:
            kind, text = "text", f"{found} ({times} times)" if times > 1 else found
        case ev.CellSkipped(cell=cell):
            kind, text = "operator", f"cell {cell.east}, {cell.north} skipped"
        case _ if type(event) in _ORDERS:
            kind, text = "operator", _ORDERS[type(event)]
        case _:
            return None
    return Trouble(event.t_s, getattr(event, "vehicle", 0), kind, printable(text))


# --- counts, event by event -----------------------------------------------------------------------
@dataclass(slots=True)
class NavigationLog:
    """The accuracy of one vehicle's position; times are mission seconds.

    >>> from missions.units import GridPoint
    >>> log = NavigationLog()
    >>> log.note(Navigated(1, 60.0, "lost", sigma_m=0.4, off_m=GridPoint(0.0, 0.0)))
    >>> log.note(Navigated(1, 90.0, "lost", sigma_m=0.6, off_m=GridPoint(3.0, 4.0)))
    >>> log.note(Landed(1, 100.0, 30.0))
    >>> log.figures()["lost_s"], log.figures()["off_m"], log.figures()["sigma_m"]
    (40.0, 5.0, 0.6)
    """

    noticed_s: float | None = None
    """Mission time at which satellites were first lost or found wrong."""
    lost_s: float = 0.0
    wrong_s: float = 0.0
    off_m: float | None = None
    """Largest error of the reported position, by the vehicle's own pictures, m."""
    sigma_m: float | None = None
    """Largest standard deviation of the position used instead, m."""
    _gnss: str = "good"
    _since_s: float = 0.0

    def note(self, event: Event) -> None:
        """Note a change of navigation or a landing of this vehicle."""
        if isinstance(event, Landed):
            self._pass(event.t_s)
        if not isinstance(event, Navigated):
            return
        self._pass(event.t_s)
        self._gnss = event.gnss
        if event.gnss != "good" and self.noticed_s is None:
            self.noticed_s = event.t_s
        if event.off_m is not None:
            self.off_m = max(self.off_m or 0.0, math.hypot(*event.off_m))
        if event.sigma_m is not None:
            self.sigma_m = max(self.sigma_m or 0.0, event.sigma_m)

    def _pass(self, t_s: float) -> None:
        passed_s = max(t_s - self._since_s, 0.0)
        if self._gnss == "lost":
            self.lost_s += passed_s
        elif self._gnss == "wrong":
            self.wrong_s += passed_s
        self._since_s = t_s

    def figures(self) -> dict[str, Any]:
        """Return the figures for summary.json; empty if satellites were always good."""
        if self.noticed_s is None:
            return {}
        return {
            "noticed_s": self.noticed_s,
            "lost_s": round(self.lost_s, 1),
            "wrong_s": round(self.wrong_s, 1),
            "off_m": None if self.off_m is None else round(self.off_m, 2),
            "sigma_m": self.sigma_m,
        }


def navigation_in_words(figures: Mapping[str, Any]) -> str:
    """Write the figures of one vehicle for the report.

    >>> one = {"noticed_s": 138.7, "lost_s": 90.0, "wrong_s": 0.0, "off_m": 0.8, "sigma_m": 0.9}
    >>> navigation_in_words(one)[49:]
    'the reported position was wrong by up to 0.8 m; its own map gave it to within 0.9 m (1 sigma)'
    """
    what = " and ".join(
        f"{word} for {figures[key]:.0f} s"
        for word, key in (("lost", "lost_s"), ("wrong", "wrong_s"))
        if figures[key]
    )
    text = f"satellites were {what or 'lost'}, noticed at {figures['noticed_s']:.0f} s"
    if figures["off_m"] is None or figures["sigma_m"] is None:
        return text
    return (
        f"{text}; the reported position was wrong by up to {figures['off_m']:.1f} m; its own "
        f"map gave it to within {figures['sigma_m']:.1f} m (1 sigma)"
    )


LIFT_OFF_M = 0.3


@dataclass(slots=True)
class Count:
    """The counts of one vehicle."""

    position: GridPoint | None = None
    distance_m: float = 0.0
    last_on_ground_s: float = 0.0
    lift_off_s: float | None = None
    flight_s: float = 0.0
    sorties: int = 0
    swaps: int = 0
    on_task_s: float = 0.0
    on_tree: bool = False
    stints: int = 0
    points: list[tuple[float, GridPoint, float]] = field(default_factory=list)
    navigation: NavigationLog = field(default_factory=NavigationLog)

    def track(self, event: Tracked) -> None:
        """Count a new position; above the ground it may begin a sortie."""
        if self.position is not None:
            self.distance_m += self.position.distance_to(event.position)
        self.position = event.position
        if event.height_m < LIFT_OFF_M and self.lift_off_s is None:
            self.last_on_ground_s = event.t_s
            return
        if self.lift_off_s is None:
            self.lift_off_s = self.last_on_ground_s
            self.sorties += 1
        self.points.append((event.t_s, event.position, event.height_m))

    def land(self, t_s: float) -> None:
        """End a sortie."""
        if self.lift_off_s is not None:
            self.flight_s += t_s - self.lift_off_s
        self.lift_off_s = None
        self.last_on_ground_s = t_s


class Counter:
    """The counts of every vehicle; call `before` and `after` with each event of the mission."""

    def __init__(self, numbers: Iterable[int]) -> None:
        self.vehicles: Mapping[int, Count] = {number: Count() for number in numbers}
        self.first_s: float | None = None
        """Mission time of the first lift-off, s."""
        self.last_s = 0.0
        """Mission time of the last touch-down, s."""
        self._before_s = 0.0

    def before(self, event: Event, state: State) -> None:
        """Count the time up to an event; `state` is the state before it."""
        if isinstance(event, AutopilotText):  # texts of vehicles do not count as flight
            return
        for number, vehicle in state.vehicles.items():
            elapsed_s = max(event.t_s - self._before_s, 0.0)
            _on_task(self.vehicles[number], vehicle, state, elapsed_s)
        self._before_s = max(self._before_s, event.t_s)

    def after(self, event: Event) -> None:
        """Count the event itself."""
        if isinstance(event, Landed | Navigated):
            self.vehicles[event.vehicle].navigation.note(event)
        if isinstance(event, Tracked):
            count = self.vehicles[event.vehicle]
            count.track(event)
            if self.first_s is None and count.lift_off_s is not None:
                self.first_s = count.lift_off_s
        elif isinstance(event, Landed):
            self.vehicles[event.vehicle].land(event.t_s)
            self.last_s = event.t_s
        elif isinstance(event, Connected):
            self.last_s = max(self.last_s, _reconnect(self.vehicles[event.vehicle], event))
        elif isinstance(event, BatterySwapped):
            self.vehicles[event.vehicle].swaps += 1


def _reconnect(count: Count, event: Connected) -> float:
    """End a sortie during an interruption, without its distance; return the time of its end."""
    count.position = None
    if event.airborne or count.lift_off_s is None:
        return 0.0
    last_seen_s = count.points[-1][0]
    count.land(last_seen_s)
    count.last_on_ground_s = event.t_s
    return last_seen_s


def _on_task(count: Count, vehicle: VehicleState, state: State, elapsed_s: float) -> None:
    """Add the time of a vehicle on the tree; a vehicle on a path counts at once."""
    if (
        state.tree is None
        or vehicle.phase is not Phase.AIRBORNE
        or vehicle.return_reason is not None
        or state.exploration_finished
    ):
        count.on_tree = False
        return
    if not count.on_tree and (vehicle.at_target or isinstance(vehicle.order, FlyPath)):
        count.on_tree = True
        count.stints += 1
    if count.on_tree:
        count.on_task_s += elapsed_s
