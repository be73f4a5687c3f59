"""The operator's view of a mission in flight: phase, cells, batteries, places, time.

On a terminal it is a table that is redrawn in place; elsewhere a line every few seconds of real
time. It goes to standard error: standard output holds only the result.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from rich.console import Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from missions.events import (
    CAUSE_NOT_REPORTED,
    AutopilotText,
    BatterySwapped,
    CellSkipped,
    Connected,
    Crashed,
    Event,
    FrameLost,
    FrameSeen,
    GivenUp,
    Landed,
    LinkLost,
    OrderFailed,
    Overridden,
    Released,
)
from missions.flight.state import Setting, State
from missions.flight.vehicle_state import Phase, VehicleState
from missions.orders import AwaitBattery, FlyPath, FlyTo, Hold, Land, Look, Sweep, TakeOff
from uavmap.aircraft.autopilot_texts import may_be_a_failsafe
from uavmap.base.printable import printable
from uavmap.base.terminal import Terminal
from uavmap.output.facts.detector_fit import DetectorFit
from uavmap.runner.operator.company import Onlooker
from uavmap.runner.operator.time_left import TimeLeft, time_left
from uavmap.runner.operator.traffic_texts import DOING, traffic_news

REDRAW_S: Final = 0.25
LINE_S: Final = 3.0
CAUSE_S: Final = 0.5
"""Time that a change of mode waits for its cause, s; measured: 0.1 to 0.4 s."""
LEFT_S: Final = 1.0
"""Minimum time between two estimates of the rest, real seconds."""
_NOTED: Final = (Phase.YIELDED, Phase.FAILED, Phase.OFFLINE, Phase.GUARDED, Phase.DOWN, Phase.LOST)
_FOLLOWING_MODES: Final = "GUIDED (a PX4: HOLD)"
_ANSWERED: Final = (Overridden, Landed, FrameSeen)
"""Events whose lines wait for the mission's answer, which gives the next action.

A verdict on a frame takes time to count.
"""

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


class ProgressTable(Onlooker):
    """Shows the flight as a table or, without a terminal, as lines; urgent events as lines."""

    def __init__(self, terminal: Terminal) -> None:
        self._terminal = terminal
        self._live: Live | None = None
        self._setting: Setting | None = None
        self._drawn_s = self._reckoned_s = float("-inf")
        self._left = TimeLeft()
        self._state: State | None = None
        self._t_s = float("-inf")
        """Mission time of the latest event that has arrived, s."""
        self._held: deque[Event] = deque()
        """Events that wait for the answer to the first of them: lines keep the events' order."""
        self._detector = DetectorFit()
        self._unexplained: dict[int, Overridden] = {}
        """Changes of mode by vehicle; the cause may follow in the autopilot's next text."""

    def begin(self, setting: Setting, *, again: bool) -> None:
        """Draw the table from now on."""
        self._setting = setting
        terminal = self._terminal
        if again:
            terminal.show("repeating the recorded part of the simulated flight, event by event")
        if terminal.console.is_terminal:
            self._live = Live(console=terminal.console, auto_refresh=False, transient=True)
            terminal.write(self._live.start)

    def notice(self, event: Event) -> None:
        """Show the line of an event that does not wait for another."""
        if not isinstance(event, AutopilotText):  # texts do not move the mission's time
            self._t_s = max(self._t_s, event.t_s)
        if self._held or self._unexplained or isinstance(event, _ANSWERED):
            self._held.append(event)
        else:
            self._show(remarkable(event, None), self._t_s)

    def update(self, event: Event, state: State, again: int) -> None:
        """Show the line of an event that has waited for its answer, and the changes."""
        if self._state is not None:
            self._show(traffic_news(self._state, state), state.t_s)
        self._state = state
        if event in self._held:
            while self._held.popleft() != event:
                pass  # the journal has refused it
            for news in self._in_order(event, state):
                self._show_news(news, state)
        now_s = time.monotonic()
        if now_s - self._drawn_s < (REDRAW_S if self._live else LINE_S):
            return
        self._drawn_s = now_s
        if self._setting is not None and now_s - self._reckoned_s >= LEFT_S:
            self._reckoned_s, self._left = now_s, time_left(state)
        live = self._live
        if live is not None:
            self._terminal.write(lambda: live.update(self._table(state, again), refresh=True))
        else:
            self._terminal.show(self._line(state, again))

    def _in_order(self, event: Event, state: State) -> Iterator[Event]:
        """Yield the events to show now: a change of mode waits a moment for its cause."""
        waiting = self._unexplained
        for number, change in list(waiting.items()):
            its_own = getattr(event, "vehicle", None) == number
            if its_own and isinstance(event, AutopilotText) and event.cause:
                del waiting[number]
                yield replace(change, cause=event.cause)
                return
            again = its_own and isinstance(event, Overridden | Released)
            if again or state.is_over or state.t_s - change.t_s > CAUSE_S:
                del waiting[number]
                yield change
        if isinstance(event, Overridden) and _may_be_explained(event) and not state.is_over:
            waiting[event.vehicle] = event
        else:
            yield event

    def _show_news(self, event: Event, state: State) -> None:
        news = self._detector.note(event) if isinstance(event, FrameSeen) else None
        self._show(remarkable(event, state) if news is None else news.text, state.t_s)

    def _show(self, text: str, t_s: float) -> None:
        if text:
            self._terminal.show(f"{t_s:7.0f} s  {text}")

    def end(self) -> None:
        """Remove the table."""
        if self._state is not None:
            for change in self._unexplained.values():
                self._show_news(change, self._state)
        self._unexplained.clear()
        if self._live is not None:
            self._terminal.write(self._live.stop)
            self._live = None

    def _line(self, state: State, again: int) -> str:
        vehicles = "; ".join(
            f"{v.vehicle}: {doing(v)} {round(v.position.east_m)} E {round(v.position.north_m)} N"
            f" {round(v.height_m)} m up, {self._battery(v):.0f} %"
            for v in state.vehicles.values()
        )
        known = ", ".join(filter(None, (phase(state), self._left.brief)))
        return f"{state.t_s:7.0f} s  {known}  [{vehicles}]" + (
            f"  ({again} recorded events to repeat)" if again else ""
        )

    def _table(self, state: State, again: int) -> Group:
        table = Table(box=None, pad_edge=False)
        for heading in ("vehicle", "doing", "east m", "north m", "up m", "battery"):
            table.add_column(heading, justify="left" if heading == "doing" else "right")
        for v in state.vehicles.values():
            table.add_row(
                str(v.vehicle),
                Text(doing(v)),  # without markup: a note may contain brackets
                f"{v.position.east_m:.1f}",
                f"{v.position.north_m:.1f}",
                f"{v.height_m:.1f}",
                f"{self._battery(v):.0f} %",
            )
        head = f"{phase(state)}  {map_progress(state)}  mission time {state.t_s:.0f} s"
        if again:
            head += f"  ({again} recorded events to repeat)"
        lines = [Text(head, style="bold"), *([Text(self._left.text)] if self._left.text else [])]
        return Group(*lines, table)

    def _battery(self, vehicle: VehicleState) -> float:
        if self._setting is None:
            return 0.0
        return 100.0 * vehicle.remaining_wh / self._setting.energy.capacity_wh


def phase(state: State) -> str:
    """Return the phase of the mission."""
    if state.recalled:
        return "recalled"
    if state.paused:
        return "paused"
    if (answer := state.traffic.answer) and not state.exploration_finished:
        return DOING[answer]
    if state.exploration_finished:
        return "coming home"
    return "searching" if state.tree is None and state.unsearched else "exploring"


def doing(vehicle: VehicleState) -> str:
    """Return the present activity of a vehicle."""
    if vehicle.phase in _NOTED:
        return printable(vehicle.note) or vehicle.phase.value
    if vehicle.phase is Phase.FINISHED:
        return "done"
    if vehicle.return_reason is not None and isinstance(vehicle.order, FlyTo):
        return "flying home"
    return _DOING.get(type(vehicle.order), "waiting")


def map_progress(state: State) -> str:
    """Return the progress of the map."""
    if state.tree is None:
        return f"{state.belief.cells_searched} cells searched"
    if state.belief.open_ballots:
        return f"{len(state.belief.roi)} ROI cells decided"
    looked = sum(vertex.observed for vertex in state.tree.vertices.values())
    return f"{looked} of {len(state.tree)} known ROI cells explored"


def _may_be_explained(event: Overridden) -> bool:
    return event.cause in (None, CAUSE_NOT_REPORTED) and may_be_a_failsafe(event.mode)


def _outside_control_text(event: Overridden | Landed, vehicle: VehicleState, state: State) -> str:
    if isinstance(event, Landed):
        text = f"vehicle {event.vehicle} has landed, not under our control"
    else:
        text = f"vehicle {event.vehicle} is in {event.mode} on the ground, not under our control"
    if state.is_over:
        return f"{text}; no other vehicle flies: the flight ends"
    if vehicle.was_down:
        return f"{text}: it is down"
    then = "takes off at once" if vehicle.cleared else "waits for its crew"
    return f"{text}: it stays there; once it is put into {_FOLLOWING_MODES}, it {then}"


def remarkable(event: Event, state: State | None) -> str:
    """Return a line that the operator must see at once; empty without one.

    `state` is the state after the event; None before there is one, for events whose line does not
    need it.
    """
    if state is not None and isinstance(event, Overridden | Landed):
        vehicle = state.vehicles[event.vehicle]
        if vehicle.phase is Phase.YIELDED and vehicle.landed:
            return _outside_control_text(event, vehicle, state)
    match event:
        case Overridden(vehicle=number, mode="GUIDED" | "HOLD" as mode):
            by = "its pilot or its autopilot selected it"
            return f"vehicle {number} is in {mode}, not under our control: {by}"
        case Overridden(vehicle=number, mode=mode, cause=cause):
            by = f" ({cause})" if cause else ""
            text = f"vehicle {number} is in {mode}, not under our control{by}"
            return f"{text}: hands off until it is in {_FOLLOWING_MODES}"
        case AutopilotText(vehicle=number, cause=str(cause)):
            return f"vehicle {number} flies by itself: {cause}"
        case CellSkipped(vehicle=number, cell=cell):
            return f"cell {cell.east}, {cell.north} is skipped: no vehicle observes it"
        case Released(vehicle=number):
            return f"vehicle {number} is under our control again"
        case LinkLost(vehicle=number):
            return f"vehicle {number}: link lost"
        case OrderFailed(vehicle=number, reason=reason, behind=True):
            return f"vehicle {number}: {reason}; it stops, and continues from its place"
        case OrderFailed(vehicle=number, order=order, reason=reason):
            return f"vehicle {number}: {order} failed: {reason}"
        case Crashed(vehicle=number, reason=reason):
            return f"vehicle {number} is down: {reason}; its cells go to the others"
        case GivenUp(vehicle=number, reason=reason):
            return (
                f"vehicle {number} is given up: {reason}; it takes part again when its link is back"
            )
        case Connected(vehicle=number, airborne=True, ours=True):
            return f"vehicle {number} answers, in the air and under our control"
        case FrameLost(vehicle=number, reason=reason):
            return f"vehicle {number}: a picture was lost: {reason}"
        case BatterySwapped(vehicle=number):
            return f"vehicle {number} has a fresh battery"
    return ""
