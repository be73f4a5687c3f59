"""A flight on a board, event by event. Pure, except for its clock.

It runs in the loop that commands aircraft. So `refresh` visits a limited number of cells, and
computes costly figures seldom.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Final

from missions import events as ev
from missions.fleet_events import FactsShared
from missions.flight.state import State
from missions.mapping.tree import Tree
from missions.units import Cell
from uavmap.base.printable import printable
from uavmap.output.facts.cell_states import CellStates
from uavmap.output.facts.detector_fit import DetectorFit, no_verdict
from uavmap.output.facts.figures import figures_of, finding
from uavmap.output.facts.flight_log import LIFT_OFF_M, Counter
from uavmap.output.facts.map_model import NOT_ROI
from uavmap.runner.operator.progress import map_progress, phase, remarkable
from uavmap.runner.operator.time_left import time_left
from uavmap.runner.operator.traffic_texts import traffic_marks, traffic_news
from uavmap.ui.page.board import Board
from uavmap.ui.page.page_scene import STATES
from uavmap.ui.page.paths_ahead import Ahead
from uavmap.ui.page.vehicle_figures import VehicleFigures

MAX_CELLS: Final = 100
"""Maximum number of cells of the tree that a refresh visits, besides those that frames changed."""
FIGURES_S: Final = 5.0
"""Minimum time between two computations of the certificate and of the time left, s of the clock."""
FIGURES_SHARE: Final = 0.005
"""Maximum share of the time for these computations."""
DEAR_S: Final = 0.02
"""Maximum computing time of a certificate that is computed again during the flight, s."""
STEP_M: Final = 0.5
"""Minimum distance of two points of a track, m."""
_LEVELS: Final = {0: "grave", 1: "grave", 2: "grave", 3: "grave", 4: "warning"}
_WARNINGS: Final = (ev.LinkLost, ev.GivenUp, ev.OrderFailed, ev.FrameLost)
_CODES: Final = {state: code for code, state in enumerate(STATES)}


class Watcher:
    """The writer of a flight's board; `state` is the state before the first event.

    Args:
        recorded: True for recorded pictures, without a flight.
        weighed: True if recorded pictures are weighed.
        real: False if the simulator in the flight's process has painted the ground.
        words: True to log the vehicles' messages here.
        dear_s: Maximum computing time of a certificate that is computed again, s of the clock.
        now_s: A clock, s.
    """

    def __init__(
        self,
        state: State,
        *,
        recorded: bool = False,
        weighed: bool = False,
        real: bool = False,
        words: bool = True,
        dear_s: float = DEAR_S,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self.board, self.state, self.setting = Board(), state, state.setting
        self._recorded, self._fit = recorded, DetectorFit()
        self._cells = CellStates(state.setting, recorded=recorded, weighed=weighed)
        self._words = words
        self._dear_s = dear_s
        self._now_s = now_s
        self._counter = Counter(state.vehicles)
        self._ahead = Ahead(state.setting)
        self._marked: dict[Cell, None] = {}
        explored = state.setting.mission.detector.explored
        self._class_codes = {number: len(STATES) + k for k, number in enumerate(explored)}
        self._classes: dict[Cell, int] = {}
        """Class of each cell, from frames of this service or of other members."""
        self._counts = dict.fromkeys([*self._class_codes.values(), _CODES["unsure"]], 0)
        """Number of cells on the board that are unsure or of each class, by their code."""
        self._waiting: deque[Cell] = deque()
        """Cells of the tree that wait for a visit."""
        self._tree: Tree | None = None
        self._why_none = partial(no_verdict, real=real)
        self._judged = self._lost = 0
        self._last: dict[int, tuple[float, float]] = {}
        self.figures = VehicleFigures(state.setting, self._counter.vehicles)
        self._due_s = self._certificate_due_s = float("-inf")

    # --- events ----------------------------------------------------------------------------
    def apply(self, event: ev.Event, state: State) -> None:
        """Note the changes by an event; `state` is the state after it."""
        self._counter.before(event, self.state)
        self._counter.after(event)
        self.log(traffic_news(self.state, state), "warning")
        self.state = state
        self.figures.note(event)
        judged = self._cells.note(event)
        if isinstance(event, ev.FrameSeen):
            self._judged += 1
            if (news := self._fit.note(event)) and not self._recorded:
                self.log(news.text, "warning" if news.warns else "event")
            self._mark(judged)
        elif isinstance(event, ev.FrameWeighed):
            self._marked.update(dict.fromkeys(judged))
        elif isinstance(event, ev.FrameLost):
            self._lost += 1
        elif isinstance(event, ev.Tracked | ev.Connected):
            self._track(event)
        elif isinstance(event, FactsShared):
            self._mark(judged)
            doubts = (fact for fact in event.frames if fact.doubt)
            self._marked.update((cell, None) for fact in doubts for cell, _ in fact.votes)
        self._log_event(event, state)

    def _mark(self, voted: Iterable[Cell]) -> None:
        if not self.setting.strategy.flies_all_lanes:
            self._marked.update(dict.fromkeys(voted))
            return
        # without a tree a cell is explored when its neighbours are decided, and a verdict from
        # high up depends on all neighbours
        steps, judged = (-1, 0, 1), self.state.belief.open_ballots
        near = {Cell(c.east + e, c.north + n) for c in voted for e in steps for n in steps}
        self._marked.update(dict.fromkeys(cell for cell in sorted(near) if cell in judged))

    def log(self, text: str, level: str = "said") -> None:
        """Add lines for the operator to the log."""
        for line in text.splitlines():
            self.board.add_line(round(self.state.t_s, 1), level, printable(line))

    def _track(self, event: ev.Tracked | ev.Connected) -> None:
        if event.height_m < LIFT_OFF_M:
            return
        place = self.setting.grid.to_moving(event.position, event.t_s)
        last = self._last.get(event.vehicle)
        if last is None or max(abs(place.east_m - last[0]), abs(place.north_m - last[1])) >= STEP_M:
            self._last[event.vehicle] = (place.east_m, place.north_m)
            self.board.add_point(event.vehicle, round(place.east_m, 2), round(place.north_m, 2))

    def _log_event(self, event: ev.Event, state: State) -> None:
        if isinstance(event, ev.AutopilotText):
            if self._words:
                again = f" ({event.times} times)" if event.times > 1 else ""
                self.log(
                    f"vehicle {event.vehicle} reports: {event.text}{again}",
                    _LEVELS.get(event.severity, "said"),
                )
            if event.cause is None:
                return
        ordered = _ORDERED.get(type(event), "").format(getattr(event, "vehicle", 0))
        if text := remarkable(event, state) or ordered:
            self.log(text, "warning" if isinstance(event, _WARNINGS) else "event")

    # --- the board -------------------------------------------------------------------------
    def refresh(self, *, whole: bool = False) -> bool:
        """Update the board; return whether anything changed. `whole`: visit every cell."""
        tree = self.state.tree
        cells = self._cells.weighed_cells() if whole else ()
        self._classes.update(self._cells.classes_of([*self._marked, *cells]))
        for cell in self._marked:
            at: Cell | None = cell
            while at is not None and self._show(at):  # a change may change the parents
                at = tree.parent(at) if tree is not None and at in tree else None
        self._marked.clear()
        if tree is not None and tree is not self._tree and not self._waiting:
            self._tree = tree
            self._waiting.extend(tree.vertices)
        if whole and tree is not None:
            self._tree, self._waiting = tree, deque(tree.vertices)
        if cells:
            self._waiting = deque(cells)
        for _ in range(len(self._waiting) if whole else min(MAX_CELLS, len(self._waiting))):
            self._show(self._waiting.popleft())
        for number, vehicle in self.state.vehicles.items():
            if not self._recorded:
                record = self.figures.record(vehicle, self.state.t_s)
                self.board.set_vehicle(number, record)
                if (path := self._ahead.news(vehicle, self.state.t_s)) is not None:
                    self.board.set_field(f"path {number}", path)
        self._show_fields()
        if whole or self._now_s() >= self._due_s:
            self._due_s = self._paced(self._show_left)
        if whole or self._now_s() >= self._certificate_due_s:
            self._certificate_due_s = self._paced(self._show_certificate, self._dear_s)
        return self.board.commit()

    def _show(self, cell: Cell) -> bool:
        """Put a cell on the board; return whether its state changed."""
        place, code = (cell.east, cell.north), self._code(cell)
        before = self.board.cell(place)
        self.board.set_cell(place, code)
        for one, change in ((before, -1), (code, 1)):
            if one in self._counts:
                self._counts[one] += change
        return before != code

    def _code(self, cell: Cell) -> int:
        """Return the code of a cell: of its class, if it is region and has one; else its state."""
        state = self._cells.state_of(cell, self.state)
        found = self._class_codes.get(self._classes.get(cell, 0), _CODES[state])
        return _CODES[state] if state in NOT_ROI else found

    def _show_fields(self) -> None:
        state, board = self.state, self.board
        board.set_field("t_s", round(state.t_s, 1))
        words = "replay of pictures" if self._recorded else phase(state)
        if state.is_over and not self._recorded:
            sure = not self._cells.sums.beyond(state.belief.roi)
            done = "complete" if state.completed and sure else "not complete"
            words = f"over, {'no verdict' if self._why_none(state, self._fit) else done}"
        board.set_field("phase", words)
        board.set_field("roi", len(state.belief.roi))
        if self._class_codes:
            cell_m2 = self.setting.grid.cell_m**2
            counts = [self._counts[code] for code in self._class_codes.values()]
            board.set_field("class_areas_m2", [round(count * cell_m2, 1) for count in counts])
        if not self._recorded:
            unsure = bool(self._counts[_CODES["unsure"]])
            board.set_field("alarms", self.figures.alarms(state, unsure=unsure))
        if state.tree is not None and state.belief.open_ballots:  # agrees with the count of cells
            board.set_field("known", map_progress(state))
        board.set_field("frames", [self._judged, self._lost])
        if state.traffic.tracks or board.field("traffic"):
            board.set_field("traffic", traffic_marks(state))
        board.set_field("paused", state.paused)
        board.set_field("held", state.is_held)
        board.set_field("recalled", state.recalled)
        board.set_field("over", state.is_over or self._recorded)

    def _paced(self, show: Callable[[], None], dear_s: float = math.inf) -> float:
        """Compute a costly figure; return the earliest time of the next computation."""
        begin_s = self._now_s()
        show()
        cost_s = self._now_s() - begin_s
        if cost_s > dear_s:
            return math.inf
        return begin_s + max(FIGURES_S, cost_s / FIGURES_SHARE)

    def _show_left(self) -> None:
        state, board = self.state, self.board
        found = finding(state)
        if not self._recorded and (reason := self._why_none(state, self._fit)):
            found = f"no verdict: {reason}; {found}"
        board.set_field("finding", found)
        if not self._recorded:
            left = time_left(state)
            about_s = None if left.about_s is None else round(left.about_s)
            words = {"what": left.what, "of": left.whole, "share": left.share, "about_s": about_s}
            board.set_field("left", words)
            board.set_field("known", map_progress(state))

    def _show_certificate(self) -> None:
        if self._recorded or self.state.tree is None:
            return
        found = figures_of(self.state, self._counter)
        self.board.set_field(
            "certificate",
            {
                "exploration_s": found.exploration_s,
                "lower_bound_s": found.lower_bound_s if found.is_compared else None,
                "ratio": found.ratio,
                "bound_s": found.bound_makespan_s,
                "t_s": round(self.state.t_s, 1),
            },
        )


_ORDERED: Final[Mapping[type[ev.Event], str]] = {
    ev.Paused: "paused: all vehicles hold",
    ev.Continued: "the mission continues",
    ev.Recalled: "all vehicles return",
    ev.VehicleRecalled: "vehicle {} returns",
    ev.Resumed: "the mission is resumed after an interruption",
    ev.LiftedOff: "vehicle {} has taken off",
    ev.Landed: "vehicle {} has landed",
}
"""Lines about actions of the operator or a vehicle; the terminal shows these in other ways."""
