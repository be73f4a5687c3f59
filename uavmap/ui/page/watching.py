"""A flight as its events come, on a board. Pure but for the clock that it is given.

It runs in the loop that steers aircraft: `refresh` visits a limited number of cells, and computes
costly figures seldom.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any, Final

from shapely.geometry import LineString, Point

from missions import events as ev
from missions.fleet_events import Shared
from missions.flight.state import Setting, State
from missions.flight.vehicle_state import Phase, VehicleState
from missions.geo.trajectory import Piece, Trajectory
from missions.mapping.tree import Tree
from missions.orders import FlyPath, FlyTo, Order, ReturnToLaunch, Sweep
from missions.units import Cell, GridPoint
from uavmap.base.printable import printable
from uavmap.output.facts.cell_states import CellStates
from uavmap.output.facts.detector_fit import DetectorFit, no_verdict
from uavmap.output.facts.figures import figures_of, finding
from uavmap.output.facts.flight_log import LIFT_OFF_M, Counter
from uavmap.output.facts.map_model import NOT_ROI
from uavmap.runner.operator.progress import cells_known, doing, phase, remarkable
from uavmap.runner.operator.time_left import time_left
from uavmap.ui.page.board import Board
from uavmap.ui.page.page_scene import STATES

MOST_CELLS: Final = 100
"""Maximum number of cells of the tree that a refresh visits, beside those that pictures changed."""
FIGURES_S: Final = 5.0
"""Minimum time between two computations of the certificate and of the time left, s of the clock."""
FIGURES_SHARE: Final = 0.005
"""Maximum share of the time that they take."""
DEAR_S: Final = 0.02
"""Maximum time of a certificate that is computed again before the flight is over, s."""
STEP_M: Final = 0.5
"""Minimum distance of two points of a track, m."""
_LEVELS: Final = {0: "grave", 1: "grave", 2: "grave", 3: "grave", 4: "warning"}
_WARNINGS: Final = (ev.LinkLost, ev.GivenUp, ev.OrderFailed, ev.FrameLost)
_CODES: Final = {state: code for code, state in enumerate(STATES)}


class Watcher:
    """Puts a flight on a board; `state` is that before the first event.

    Args:
        recorded: Whether the pictures were recorded, and nothing flies.
        weighed: Whether recorded pictures are weighed.
        real: Whether the ground was not painted by the simulator in the flight's process.
        words: Whether vehicles' messages go into the log here.
        dear_s: Maximum time of a certificate that is computed again, seconds of the clock.
        now_s: A clock, seconds.
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
        """The class of each cell that frames of its own, or of other members, show."""
        self._counts = dict.fromkeys(self._class_codes.values(), 0)
        """How many cells on the board are of each class, by its code."""
        self._waiting: deque[Cell] = deque()
        """Cells of the tree that are still to be visited."""
        self._tree: Tree | None = None
        self._why_none = partial(no_verdict, real=real)
        self._judged = self._lost = 0
        self._last: dict[int, tuple[float, float]] = {}
        self._homes_amsl_m: dict[int, float] = {}
        self._due_s = self._certificate_due_s = float("-inf")

    # --- events ----------------------------------------------------------------------------
    def take_in(self, event: ev.Event, state: State) -> None:
        """Note what an event changes; `state` is that after it."""
        self._counter.before(event, self.state)
        self._counter.after(event)
        self.state = state
        judged = self._cells.note(event)
        if isinstance(event, ev.FrameSeen):
            self._judged += 1
            if (news := self._fit.note(event)) and not self._recorded:
                self.say(news.text, "warning" if news.warns else "event")
            self._mark(judged)
        elif isinstance(event, ev.Weighed):
            self._marked.update(dict.fromkeys(judged))
        elif isinstance(event, ev.FrameLost):
            self._lost += 1
        elif isinstance(event, ev.Tracked | ev.Connected):
            self._track(event)
            if isinstance(event, ev.Connected) and event.home_amsl_m is not None:
                self._homes_amsl_m[event.vehicle] = event.home_amsl_m
        elif isinstance(event, Shared):
            self._mark(judged)
        self._tell(event, state)

    def _mark(self, voted: Iterable[Cell]) -> None:
        if not self.setting.strategy.flies_all_lanes:
            self._marked.update(dict.fromkeys(voted))
            return
        # without a tree a cell is explored once those beside it are decided, and what is plain
        # from high up depends on all around it
        steps, judged = (-1, 0, 1), self.state.belief.open_ballots
        near = {Cell(c.east + e, c.north + n) for c in voted for e in steps for n in steps}
        self._marked.update(dict.fromkeys(cell for cell in sorted(near) if cell in judged))

    def say(self, text: str, level: str = "said") -> None:
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

    def _tell(self, event: ev.Event, state: State) -> None:
        if isinstance(event, ev.Told):
            if self._words:
                again = f" ({event.times} times)" if event.times > 1 else ""
                self.say(
                    f"vehicle {event.vehicle} says: {event.text}{again}",
                    _LEVELS.get(event.severity, "said"),
                )
            if event.cause is None:
                return
        ordered = _ORDERED.get(type(event), "").format(getattr(event, "vehicle", 0))
        if text := remarkable(event, state) or ordered:
            self.say(text, "warning" if isinstance(event, _WARNINGS) else "event")

    # --- the board -------------------------------------------------------------------------
    def refresh(self, *, whole: bool = False) -> bool:
        """Update the board; return whether anything changed. `whole`: visit every cell."""
        tree = self.state.tree
        cells = self._cells.weighed_cells() if whole else ()
        self._classes.update(self._cells.classes_of([*self._marked, *cells]))
        for cell in self._marked:
            at: Cell | None = cell
            while at is not None and self._show(at):  # what is found below changes those above
                at = tree.parent(at) if tree is not None and at in tree else None
        self._marked.clear()
        if tree is not None and tree is not self._tree and not self._waiting:
            self._tree = tree
            self._waiting.extend(tree.vertices)
        if whole and tree is not None:
            self._tree, self._waiting = tree, deque(tree.vertices)
        if cells:
            self._waiting = deque(cells)
        for _ in range(len(self._waiting) if whole else min(MOST_CELLS, len(self._waiting))):
            self._show(self._waiting.popleft())
        for number, vehicle in self.state.vehicles.items():
            if not self._recorded:
                self.board.set_vehicle(number, self._record(vehicle))
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
        """Return the code of a cell: in the region that of its class, if any; else its state's."""
        state = self._cells.state_of(cell, self.state)
        found = self._class_codes.get(self._classes.get(cell, 0), _CODES[state])
        return _CODES[state] if state in NOT_ROI else found

    def _record(self, vehicle: VehicleState) -> dict[str, Any]:
        energy = self.setting.energy
        place = self.setting.grid.to_moving(vehicle.position, self.state.t_s)
        count = self._counter.vehicles[vehicle.vehicle]
        left_wh = vehicle.remaining_wh - energy.reserve_wh
        left_s = 3600.0 * left_wh / energy.power_w(vehicle.drawn_w)
        home_amsl_m = self._homes_amsl_m.get(vehicle.vehicle)
        return {
            "at_s": round(vehicle.tracked_s, 2),
            "e": round(place.east_m, 2),
            "n": round(place.north_m, 2),
            "up": round(vehicle.height_m, 1),
            "amsl_m": None if home_amsl_m is None else round(home_amsl_m + vehicle.height_m, 1),
            "battery": round(100.0 * vehicle.remaining_wh / energy.capacity_wh, 1),
            "left_s": 0 if vehicle.landed else max(round(left_s), 0),
            "phase": vehicle.phase.value,
            "doing": doing(vehicle),
            "landed": vehicle.landed,
            "called": vehicle.called_home,
            "sorties": count.sorties,
            "swaps": count.swaps,
        }

    def _show_fields(self) -> None:
        state, board = self.state, self.board
        board.set_field("t_s", round(state.t_s, 1))
        words = "replay of pictures" if self._recorded else phase(state)
        if state.over and not self._recorded:
            sure = not self._cells.sums.beyond(state.belief.roi)
            done = "complete" if state.completed and sure else "not complete"
            words = f"over, {'no verdict' if self._why_none(state, self._fit) else done}"
        board.set_field("phase", words)
        board.set_field("roi", len(state.belief.roi))
        if self._counts:
            cell_m2 = self.setting.grid.cell_m**2
            areas_m2 = [round(count * cell_m2, 1) for count in self._counts.values()]
            board.set_field("class_areas_m2", areas_m2)
        if state.tree is not None and state.belief.open_ballots:  # the same count in words
            board.set_field("known", cells_known(state))
        board.set_field("frames", [self._judged, self._lost])
        board.set_field("paused", state.paused)
        board.set_field("recalled", state.recalled)
        board.set_field("over", state.over or self._recorded)

    def _paced(self, show: Callable[[], None], dear_s: float = math.inf) -> float:
        """Compute a costly figure; return when it may be computed again, by what it cost."""
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
            words = {"what": left.what, "of": left.of, "share": left.share, "about_s": about_s}
            board.set_field("left", words)
            board.set_field("known", cells_known(state))

    def _show_certificate(self) -> None:
        if self._recorded or self.state.tree is None:
            return
        found = figures_of(self.state, self._counter)
        self.board.set_field(
            "certificate",
            {
                "exploration_s": found.exploration_s,
                "lower_bound_s": found.lower_bound_s,
                "ratio": found.ratio,
                "bound_s": found.bound_makespan_s,
                "t_s": round(self.state.t_s, 1),
            },
        )


_ORDERED: Final[Mapping[type[ev.Event], str]] = {
    ev.Paused: "paused: everybody holds",
    ev.Continued: "the mission goes on",
    ev.Recalled: "everybody is called home",
    ev.VehicleRecalled: "vehicle {} is called home",
    ev.Resumed: "the mission was interrupted, and is resumed",
    ev.LiftedOff: "vehicle {} has taken off",
    ev.Landed: "vehicle {} has landed",
}
"""What the operator, or a vehicle, did that the terminal shows elsewhere."""


UNTIMED_S: Final = 1e9
"""Time of a point whose time of passage is unknown, s."""
MOST_POINTS: Final = 100
_CHORD_M: Final = 0.3
"""Maximum distance of an arc from its chords, m."""
_NEAR_M: Final = 4.0
"""Distance within which a vehicle is on a later leg of its route, m."""


class Ahead:
    """The paths ahead of the vehicles: a path stays as long as its order."""

    def __init__(self, setting: Setting) -> None:
        self._setting = setting
        self._orders: dict[int, tuple[Order | None, int]] = {}

    def news(self, vehicle: VehicleState, t_s: float) -> list[float] | None:
        """Return the path of a vehicle at mission time `t_s`, if it has changed; else None.

        Flat: time (mission seconds), east and north (m) of each point. Empty for a vehicle that is
        not under way by our orders.
        """
        order = vehicle.order if vehicle.phase is Phase.AIRBORNE and not vehicle.landed else None
        route = _route(vehicle, order, self._setting, t_s)
        begin = _begun(route, vehicle.position)
        before = self._orders.get(vehicle.vehicle)
        if before is not None and before[0] is order and before[1] == begin:
            return None
        self._orders[vehicle.vehicle] = (order, begin)
        if isinstance(order, FlyPath):
            return self._of_path(order.trajectory, t_s)
        flat = self._of_route(route[begin:], vehicle.position, t_s)
        if isinstance(order, FlyTo) and order.cell is not None:  # which drifts with the region
            flat[-2:] = self._setting.grid.centre_of(order.cell)
        return flat

    def _of_path(self, path: Trajectory, t_s: float) -> list[float]:
        times = [t for t in _times(path.pieces) if t > t_s]
        flat: list[float] = []
        for time_s in [*times, path.end_s][:MOST_POINTS]:
            place = self._setting.grid.to_moving(path.place_at(time_s), time_s)
            flat += (round(time_s, 1), round(place.east_m, 1), round(place.north_m, 1))
        return flat

    def _of_route(self, route: Sequence[GridPoint], here: GridPoint, t_s: float) -> list[float]:
        """A region that drifts is met where it is by then."""
        flat: list[float] = []
        for point in route[:MOST_POINTS]:
            t_s += here.distance_to(point) / self._setting.energy.speed_m_s
            here = point
            place = self._setting.grid.to_moving(point, t_s)
            flat += (UNTIMED_S, round(place.east_m, 1), round(place.north_m, 1))
        return flat


def _route(
    vehicle: VehicleState, order: Order | None, setting: Setting, t_s: float
) -> Sequence[GridPoint]:
    """Return the points of an order that is flown in legs, in the fixed frame."""
    if isinstance(order, Sweep):
        return (order.end,)
    if isinstance(order, ReturnToLaunch):
        return (vehicle.pad,)
    if not isinstance(order, FlyTo):
        return ()
    if order.cell is None:
        return order.route
    grid = setting.grid
    return (*order.route, grid.to_fixed(grid.centre_of(order.cell), t_s))


def _begun(route: Sequence[GridPoint], here: GridPoint) -> int:
    """Return the number of the point that is flown to: the end of the vehicle's last leg."""
    for end in range(len(route) - 1, 0, -1):
        if LineString(route[end - 1 : end + 1]).distance(Point(here)) < _NEAR_M:
            return end
    return 0


def _times(pieces: Sequence[Piece]) -> list[float]:
    """Return when lines, arcs and their chords begin."""
    times = []
    for piece in pieces:
        bend = abs(piece.curvature_1_m)
        most_rad = 2.0 * math.acos(max(1.0 - _CHORD_M * bend, 0.0))
        chords = max(1, math.ceil(bend * piece.length_m / most_rad)) if bend else 1
        times += [piece.begin_s + piece.duration_s * k / chords for k in range(chords)]
    return times
