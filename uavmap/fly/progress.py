"""What the operator sees while a mission is flown: phase, cells, batteries, places, time.

On a terminal a table that is redrawn in place; elsewhere a line every few seconds of real time.
All of it goes to standard error, so that standard output holds only the result.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Final, Protocol, TextIO

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from missions.events import (
    BatterySwapped,
    CellSkipped,
    Connected,
    Crashed,
    Event,
    FrameLost,
    GivenUp,
    Landed,
    LinkLost,
    OrderFailed,
    Overridden,
    Released,
    Told,
)
from missions.orders import AwaitBattery, FlyPath, FlyTo, Hold, Land, Look, Sweep, TakeOff
from missions.state import Phase, Setting, State, VehicleState
from uavmap.fly.time_left import time_left
from uavmap.printable import printable

REDRAW_S: Final = 0.25
LINE_S: Final = 3.0
LEFT_S: Final = 1.0
"""What is left is reckoned no more often, real seconds."""
_NOTED: Final = (
    Phase.YIELDED,
    Phase.FAILED,
    Phase.OFFLINE,
    Phase.GUARDED,
    Phase.DOWN,
    Phase.LOST,
)
LINE_LIMIT: Final = 4000
_OURS: Final = "GUIDED (a PX4: HOLD)"

_DOING: Final = {
    TakeOff: "taking off",
    Sweep: "searching",
    FlyTo: "flying",
    FlyPath: "flying on",
    Look: "looking",
    Hold: "holding",
    Land: "landing",
    AwaitBattery: "battery swap",
}


class Progress(Protocol):
    """Where a flight reports to."""

    def say(self, text: str) -> None:
        """A line that stays."""
        ...

    def begin(self, setting: Setting, *, again: bool) -> None:
        """The flight starts; `again`: a recorded one is repeated first."""
        ...

    def update(self, event: Event, state: State, again: int) -> None:
        """An event was taken in; `again` recorded ones are still to come."""
        ...

    def end(self) -> None:
        """The flight is over."""
        ...


class Silent:
    """No progress at all."""

    def say(self, text: str) -> None:
        """Nothing."""

    def begin(self, setting: Setting, *, again: bool) -> None:
        """Nothing."""

    def update(self, event: Event, state: State, again: int) -> None:
        """Nothing."""

    def end(self) -> None:
        """Nothing."""


class PipeConsole(Console):
    """A console whose reader may go away: `BrokenPipeError`, where rich would end the program."""

    def on_broken_pipe(self) -> None:
        """Nobody reads any more."""
        raise BrokenPipeError


class Terminal:
    """Progress on standard error.

    A terminal that is gone (a closed window, a broken pipe) is written to no more: nothing of a
    flight depends on being read.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        file = stream or sys.stderr
        # by the stream alone: a notebook, and FORCE_COLOR, make no terminal that can redraw a table
        self._console = PipeConsole(
            file=file, highlight=False, force_jupyter=False, force_terminal=_is_terminal(file)
        )
        self._live: Live | None = None
        self._setting: Setting | None = None
        self._drawn_s = self._reckoned_s = float("-inf")
        self._left = ""
        self._gone = False

    def say(self, text: str) -> None:
        """A line that stays."""
        lines = "\n".join(printable(line, LINE_LIMIT) for line in text.split("\n"))
        self._write(lambda: self._console.print(lines, soft_wrap=True, markup=False))

    def _write(self, act: Callable[[], None]) -> None:
        """Do what writes; once the terminal is gone, nothing."""
        if self._gone:
            return
        try:
            act()
        except (OSError, ValueError):  # a stream that was closed on our side is a ValueError
            self._gone = True

    def begin(self, setting: Setting, *, again: bool) -> None:
        """The flight starts."""
        self._setting = setting
        if again:
            self.say("repeating the recorded part of the simulated flight, event by event")
        if self._console.is_terminal:
            self._live = Live(console=self._console, auto_refresh=False, transient=True)
            self._write(self._live.start)

    def update(self, event: Event, state: State, again: int) -> None:
        """An event was taken in."""
        if text := remarkable(event, state):
            self.say(f"{state.t_s:7.0f} s  {text}")
        now_s = time.monotonic()
        if now_s - self._drawn_s < (REDRAW_S if self._live else LINE_S):
            return
        self._drawn_s = now_s
        if self._setting is not None and now_s - self._reckoned_s >= LEFT_S:
            self._reckoned_s, self._left = now_s, time_left(self._setting, state).told
        live = self._live
        if live is not None:
            self._write(lambda: live.update(self._table(state, again), refresh=True))
        else:
            self.say(self._line(state, again))

    def end(self) -> None:
        """The flight is over."""
        if self._live is not None:
            self._write(self._live.stop)
            self._live = None

    def _line(self, state: State, again: int) -> str:
        vehicles = "; ".join(
            f"{v.vehicle}: {doing(v)} at {round(v.position.east_m)} m E"
            f" {round(v.position.north_m)} m N"
            f" {round(v.height_m)} m up, battery {self._battery(v):.0f} %"
            for v in state.vehicles.values()
        )
        left = f"; {self._left}" if self._left else ""
        return f"{state.t_s:7.0f} s  {phase(state)}, {cells_known(state)}{left}  [{vehicles}]" + (
            f"  ({again} recorded events to repeat)" if again else ""
        )

    def _table(self, state: State, again: int) -> Group:
        table = Table(box=None, pad_edge=False)
        for heading in ("vehicle", "doing", "east m", "north m", "up m", "battery"):
            table.add_column(heading, justify="left" if heading == "doing" else "right")
        for v in state.vehicles.values():
            table.add_row(
                str(v.vehicle),
                Text(doing(v)),  # as it is: a note may hold what looks like markup
                f"{v.position.east_m:.1f}",
                f"{v.position.north_m:.1f}",
                f"{v.height_m:.1f}",
                f"{self._battery(v):.0f} %",
            )
        head = f"{phase(state)}  {cells_known(state)}  mission time {state.t_s:.0f} s"
        if again:
            head += f"  ({again} recorded events to repeat)"
        lines = [Text(head, style="bold"), *([Text(self._left)] if self._left else [])]
        return Group(*lines, table)

    def _battery(self, vehicle: VehicleState) -> float:
        if self._setting is None:
            return 0.0
        return 100.0 * vehicle.remaining_wh / self._setting.energy.capacity_wh


def _is_terminal(stream: TextIO) -> bool:
    """Whether what is written can be redrawn."""
    try:
        return stream.isatty()
    except ValueError:  # closed on our side
        return False


def phase(state: State) -> str:
    """What the mission as a whole is doing.

    >>> from missions.mapping.belief import Belief
    >>> phase(State(Belief(5, 3), {}, recalled=True))
    'recalled'
    """
    if state.recalled:
        return "recalled"
    if state.paused:
        return "paused"
    if state.exploration_finished:
        return "coming home"
    return "searching" if state.tree is None and state.unsearched else "exploring"


def doing(vehicle: VehicleState) -> str:
    """What a vehicle does just now, in words."""
    if vehicle.phase in _NOTED:
        return printable(vehicle.note) or vehicle.phase.value
    if vehicle.phase is Phase.FINISHED:
        return "done"
    if vehicle.return_reason is not None and isinstance(vehicle.order, FlyTo):
        return "flying home"
    return _DOING.get(type(vehicle.order), "waiting")


def cells_known(state: State) -> str:
    """How far the map is, in words."""
    if state.tree is None:
        return f"{state.belief.cells_searched} cells searched"
    if state.belief.open_ballots:
        return f"{len(state.belief.roi)} ROI cells decided"
    looked = sum(vertex.looked for vertex in state.tree.vertices.values())
    return f"{looked} of {len(state.tree)} known ROI cells explored"


def _of_other_hands(event: Overridden | Landed, vehicle: VehicleState, state: State) -> str:
    """That somebody else keeps a vehicle on the ground, and how it goes on."""
    if isinstance(event, Landed):
        text = f"vehicle {event.vehicle} has landed, not by us"
    else:
        text = f"vehicle {event.vehicle} was put into {event.mode} on the ground, not by us"
    if state.over:
        return f"{text}; nobody else flies: the flight ends"
    then = "takes off at once" if vehicle.cleared else "waits for its crew"
    return f"{text}: it stays there; once it is put into {_OURS}, it {then}"


def remarkable(event: Event, state: State) -> str:
    """What the operator has to know at once."""
    if isinstance(event, Overridden | Landed):
        vehicle = state.vehicles[event.vehicle]
        if vehicle.phase is Phase.YIELDED and vehicle.landed:
            return _of_other_hands(event, vehicle, state)
    match event:
        case Overridden(vehicle=number, mode="GUIDED" | "HOLD" as mode):
            return f"vehicle {number} was put into {mode}, not by us: it is the pilot's now"
        case Overridden(vehicle=number, mode=mode, cause=cause):
            by = f" ({cause})" if cause else ""
            return f"vehicle {number} is in {mode}, not by us{by}: hands off until it is in {_OURS}"
        case Told(vehicle=number, cause=str(cause)):
            return f"vehicle {number} flies by itself: {cause}"
        case CellSkipped(vehicle=number, cell=cell):
            return f"cell {cell.east}, {cell.north} is skipped: nobody looks from it"
        case Released(vehicle=number):
            return f"vehicle {number} is ours again"
        case LinkLost(vehicle=number):
            return f"vehicle {number}: link lost"
        case OrderFailed(vehicle=number, reason=reason, behind=True):
            return f"vehicle {number}: {reason}; it stops, and goes on from where it is"
        case OrderFailed(vehicle=number, order=order, reason=reason):
            return f"vehicle {number}: {order} failed: {reason}"
        case Crashed(vehicle=number, reason=reason):
            return f"vehicle {number} is down: {reason}; its cells go to the others"
        case GivenUp(vehicle=number, reason=reason):
            return f"vehicle {number} is given up: {reason}; it is taken up again when it speaks"
        case Connected(vehicle=number, airborne=True, ours=True):
            return f"vehicle {number} answers, in the air and ours"
        case FrameLost(vehicle=number, reason=reason):
            return f"vehicle {number}: a picture was lost: {reason}"
        case BatterySwapped(vehicle=number):
            return f"vehicle {number} has a fresh battery"
    return ""
