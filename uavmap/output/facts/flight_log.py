"""The course of a flight from its journal: places, frames, sorties, faults.

It is noted event by event: a replay of thousands of pictures need not keep their votes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple, TypeVar

from missions import events as ev
from missions.events import Event
from missions.units import GridPoint
from uavmap.base.printable import printable
from uavmap.output.facts.counting import LIFT_OFF_M

E = TypeVar("E", bound=Event)
Kind = Literal["fault", "refusal", "link", "pilot", "operator", "frame", "words"]

WARNING: Final = 4
"""MAV_SEVERITY from which on a text of a vehicle is a fault."""


_GNSS: Final = {
    "good": "satellite navigation is back",
    "lost": "satellite navigation is lost",
    "wrong": "satellite navigation tells a wrong place",
}


class Fix(NamedTuple):
    """A vehicle's place in the fixed frame, its height above home and its charge."""

    t_s: float
    place: GridPoint
    height_m: float
    remaining_wh: float


class FrameRow(NamedTuple):
    """A judged frame: number of cells it voted on, and of votes for region."""

    vehicle: int
    t_s: float
    cells: int
    positive: int


class Trouble(NamedTuple):
    """Something that did not go as planned; `vehicle` 0 is the whole mission."""

    t_s: float
    vehicle: int
    kind: Kind
    text: str


class Sortie(NamedTuple):
    """A flight of a vehicle from lift-off to touch-down, or to its last known place."""

    vehicle: int
    number: int
    start_s: float
    end_s: float
    ended: bool
    """Whether it has landed."""


@dataclass(slots=True)
class FlightLog:
    """The course of a flight; times are mission seconds.

    Attributes:
        frames: In the order in which they were judged.
        swaps: Vehicle and time of each fresh battery.
        homes: By vehicle, as last reported.
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
    def of(cls, events: Iterable[Event]) -> FlightLog:
        """Note the events of a journal."""
        log = cls()
        for event in events:
            log.note(event)
        return log

    def noting(self, events: Iterable[E]) -> Iterator[E]:
        """Yield the same events, each noted on its way."""
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
        """Return the places of a sortie."""
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
                        # after an interruption nobody knows when it came down
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
    """Return the fault in an event, or what a person did; None for all else."""
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
            kind, text = "pilot", f"taken by a pilot or a failsafe: {mode}{why}"
        case ev.Released():
            kind, text = "pilot", "given back"
        case ev.Told(severity=severity, text=said, times=times) if severity <= WARNING:
            kind, text = "words", f"{said} ({times} times)" if times > 1 else said
        case ev.CellSkipped(cell=cell):
            kind, text = "operator", f"cell {cell.east}, {cell.north} skipped"
        case ev.VehicleRecalled():
            kind, text = "operator", "called home"
        case ev.Recalled():
            kind, text = "operator", "everybody called home"
        case ev.Paused():
            kind, text = "operator", "paused"
        case ev.Continued():
            kind, text = "operator", "gone on"
        case ev.Resumed():
            kind, text = "operator", "resumed after an interruption"
        case _:
            return None
    return Trouble(event.t_s, getattr(event, "vehicle", 0), kind, printable(text))
