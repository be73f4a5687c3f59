"""The model of an animation: the states of cells and the places of robots over time.

Places are in cells from the grid's origin, in the frame of the ROI; times in `unit`.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final, NamedTuple

from shapely.geometry.base import BaseGeometry

from missions.events import Connected, Event, FrameWeighed, Tracked
from missions.flight.state import Setting, State
from missions.flight.step import step
from missions.mission.schema import Mission
from missions.units import Cell
from uavmap.output.drawing.scene import bounds_of
from uavmap.output.facts.cell_states import CellStates
from uavmap.output.facts.flight_log import LIFT_OFF_M
from uavmap.output.facts.map_model import NOT_ROI
from uavmap.output.facts.map_model import State as CellState
from uavmap.output.facts.score import MISSED_SHARE, cells_near, shares_of

FPS: Final = 20
"""Frames a second: a GIF counts in hundredths of a second, so 20 is exact."""
LONGEST_S: Final = 20.0
HOLD_S: Final = 1.5
"""Time that the last frame stands, s."""
_FRAMES_A_STEP: Final = 5
_QUICKEST: Final = 30.0
"""Minimum ratio of a film's speed to that of the flight."""


class Unit(StrEnum):
    """The unit of the times of a film."""

    STEPS = "steps"
    SECONDS = "seconds"


class Place(NamedTuple):
    """A place in cells, east and north of the centre of cell (0, 0)."""

    east: float
    north: float


class Fix(NamedTuple):
    """The place of a robot at a time; `aloft` is true in the air."""

    t: float
    place: Place
    aloft: bool = True


class Change(NamedTuple):
    """A change of a cell's state at `t`; `parent` is its parent in the tree."""

    t: float
    cell: Cell
    state: CellState
    parent: Cell | None = None


_AT_REST: Final = Place(0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Film:
    """A film of an exploration.

    Attributes:
        roi: The true cells, shown faintly until they are known; empty if unknown.
        changes: Changes of cells, in the order of time.
        tracks: At least one fix of each robot, in the order of time.
        start: Start of all robots, which moves with `start_drift` cells per unit of time.
        radius: Radius of a robot's disc, in cells.
        footprint: View of a robot that flies without stopping, in cells east and north.
    """

    title: str
    unit: Unit
    end_t: float
    roi: frozenset[Cell]
    changes: tuple[Change, ...]
    tracks: Mapping[int, tuple[Fix, ...]]
    start: Place
    start_drift: Place = _AT_REST
    radius: float = 0.3
    footprint: Place | None = None

    def fix(self, robot: int, t: float) -> Fix:
        """Return the place of a robot at a time, on the straight line between two fixes."""
        track = self.tracks[robot]
        after = bisect_right(track, t, key=lambda fix: fix.t)
        if after == 0:
            return Fix(t, *track[0][1:])
        if after == len(track):
            return Fix(t, *track[-1][1:])
        (t0, p0, aloft), (t1, p1, _) = track[after - 1], track[after]
        part = (t - t0) / (t1 - t0)
        return Fix(
            t,
            Place(p0.east + part * (p1.east - p0.east), p0.north + part * (p1.north - p0.north)),
            aloft,
        )

    def trail(self, robot: int, since_t: float, t: float) -> list[Place]:
        """Return the path of a robot between two times, both ends included."""
        track = self.tracks[robot]
        first = bisect_right(track, since_t, key=lambda fix: fix.t)
        last = bisect_right(track, t, key=lambda fix: fix.t)
        between = [fix.place for fix in track[first:last]]
        return [self.fix(robot, since_t).place, *between, self.fix(robot, t).place]

    def start_at(self, t: float) -> Place:
        """Return the start at a time, in the frame of the ROI."""
        return Place(
            self.start.east + t * self.start_drift.east,
            self.start.north + t * self.start_drift.north,
        )

    def bounds(self) -> tuple[int, int, int, int]:
        """Return the cells to show: least east and north, greatest east and north."""
        places: list[tuple[float, float]] = [*self.roi, self.start, self.start_at(self.end_t)]
        places += [change.cell for change in self.changes]
        places += [fix.place for track in self.tracks.values() for fix in track]
        west, south, east, north = (math.floor(side + 0.5) for side in bounds_of(places))
        return west, south, east, north

    @property
    def cells(self) -> int:
        """Number of ROI cells at the end, known or not."""
        last = {change.cell: change.state for change in self.changes}
        return len(self.roi | {cell for cell, state in last.items() if state not in NOT_ROI})

    def times(self) -> list[float]:
        """Return the times of the frames, evenly spaced: with the hold at most `LONGEST_S`."""
        pace = _FRAMES_A_STEP if self.unit is Unit.STEPS else FPS / _QUICKEST
        most = round((LONGEST_S - HOLD_S) * FPS) - 1
        intervals = min(max(math.ceil(self.end_t * pace), 1), most)
        return [self.end_t * i / intervals for i in range(intervals + 1)]


class Reel:
    """The states of the cells over the time of a film.

    >>> film = Film("", Unit.STEPS, 2.0, frozenset(), (Change(1.0, Cell(0, 0), "explored"),), {},
    ...             Place(0.0, 0.0))
    >>> reel = Reel(film)
    >>> [len(list(reel.forward(t))) for t in (0.5, 1.0, 2.0)], reel.states
    ([0, 1, 0], {Cell(east=0, north=0): 'explored'})
    """

    def __init__(self, film: Film) -> None:
        self._left = list(reversed(film.changes))
        self.states: dict[Cell, CellState] = {}
        self.parents: dict[Cell, Cell] = {}

    def forward(self, t: float) -> Iterator[Change]:
        """Yield the changes up to `t`, and apply them."""
        while self._left and self._left[-1].t <= t:
            change = self._left.pop()
            self.states[change.cell] = change.state
            if change.parent is not None:
                self.parents[change.cell] = change.parent
            yield change

    def count(self, *states: CellState) -> int:
        """Return the number of cells in one of these states."""
        return sum(state in states for state in self.states.values())


# --- of a flown mission ---------------------------------------------------------------------------
def title_of(mission: Mission, *, recorded: bool = False) -> str:
    """Write the title of a film: the mission, its strategy and its vehicles, or photographs."""
    team = "1 vehicle" if len(mission.vehicles) == 1 else f"{len(mission.vehicles)} vehicles"
    what = "photographs" if recorded else f"{mission.strategy}, {team}"
    return f"{mission.name}   ·   {what}"


def film_of_flight(
    setting: Setting,
    events: Iterable[Event],
    title: str,
    *,
    truth: BaseGeometry | None = None,
    recorded: bool = False,
) -> tuple[Film, State]:
    """Fold a journal into a film; return also the state in which the mission ended.

    `truth`: the true ROI in ground metres of the moving frame; `recorded`: a journal of
    photographs.
    """
    grid = setting.grid
    events = list(events)
    weighed = any(isinstance(event, FrameWeighed) for event in events)
    cells = CellStates(setting, recorded=recorded, weighed=weighed)
    log = _Log(setting.initial_state(), cells)
    for event in events:
        log.apply(event)
    for cell in cells.weighed_cells():  # their states are known after the last picture
        log.note(cell)
    roi: frozenset[Cell] = frozenset()
    if truth is not None:
        shares = shares_of(cells_near(truth, grid), truth, grid)
        roi = frozenset(cell for cell, share in shares.items() if share >= MISSED_SHARE)
    film = Film(
        title=title,
        unit=Unit.SECONDS,
        end_t=log.t_s,
        roi=roi,
        changes=tuple(log.changes),
        tracks={number: tuple(track) for number, track in sorted(log.tracks.items())},
        start=Place(0.0, 0.0),
        start_drift=Place(-grid.drift_east_m_s / grid.cell_m, -grid.drift_north_m_s / grid.cell_m),
    )
    return film, log.state


@dataclass(slots=True)
class _Log:
    state: State
    states: CellStates
    t_s: float = 0.0
    changes: list[Change] = field(default_factory=list)
    tracks: dict[int, list[Fix]] = field(default_factory=dict)
    shown: dict[Cell, CellState] = field(default_factory=dict)

    def apply(self, event: Event) -> None:
        before, self.t_s = self.state, max(self.t_s, event.t_s)
        self.state, _ = step(before, event)
        if isinstance(event, Tracked | Connected):
            grid = self.state.setting.grid
            east_m, north_m = grid.to_moving(event.position, self.t_s)
            place = Place(east_m / grid.cell_m, north_m / grid.cell_m)
            fix = Fix(self.t_s, place, event.height_m >= LIFT_OFF_M)
            self.tracks.setdefault(event.vehicle, []).append(fix)
        cells = set(self.states.note(event))
        if self.state.tree is not None and self.state.tree is not before.tree:
            cells |= self.state.tree.vertices.keys()
        for cell in sorted(cells):
            self.note(cell)

    def note(self, cell: Cell) -> None:
        now, tree = self.states.state_of(cell, self.state), self.state.tree
        if self.shown.get(cell) != now:
            self.shown[cell] = now
            parent = tree.parent(cell) if tree is not None and cell in tree else None
            self.changes.append(Change(self.t_s, cell, now, parent))
