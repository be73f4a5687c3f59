"""What a strategy is: how vehicles find a region and map it.

The reducer asks `setting.strategy` wherever strategies differ. A strategy keeps nothing between
two calls: what it has to remember is `State.memory`. So a resume repeats what was flown.

To add one, inherit from `Strategy` or a strategy beside this file, and give it a name with
`missions.flight.strategies.register`, or by an entry point (docs/strategies.md).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from missions.events import FrameSeen
from missions.flight.setting import Setting, Shares
from missions.flight.state import Phase, State, VehicleState
from missions.geo.fence import Fence
from missions.geo.grid import Grid
from missions.mapping.belief import Verdicts
from missions.mapping.tree import Tree
from missions.mission.schema import Mission
from missions.planning.search.lanes import Lane, lanes, share_out
from missions.planning.search.search_order import Pace, soonest
from missions.planning.stepwise import Explorer
from missions.planning.sweep.strategies import About
from missions.units import Cell, GridPoint

if TYPE_CHECKING:
    from missions.planning.sweep.chart import Known
    from missions.planning.sweep.paths import Flyer
    from missions.planning.sweep.tours import Tour, Waypoints

Bits = NDArray[np.bool_]


class Area(NamedTuple):
    """Where lanes are laid."""

    mission: Mission
    grid: Grid
    box: Sequence[GridPoint]
    """The corners of the search box."""
    fence: Fence
    """Where each vehicle may fly."""
    pads: Sequence[GridPoint]
    """Where the vehicles start."""

    def lanes(self, rows: int, ahead: bool, spare: int = 0) -> Lanes:
        """Lay lanes of so many rows along grid east (`ahead`) or north, `spare` rows left out."""
        laid = lanes(self.box, self.grid.cell_m, self.fence, rows, ahead, spare)
        return Lanes(laid, ahead, rows)


class Lanes(NamedTuple):
    """Lanes over a search box."""

    lanes: tuple[Lane, ...]
    east_ahead: bool
    """Whether they lie along grid east, else along north."""
    rows: int
    """How many rows of cells a lane decides."""


@dataclass(frozen=True, slots=True)
class TourMemory:
    """The last decision on which vehicle is to see what."""

    laid_s: float = float("-inf")
    team: frozenset[int] = frozenset()
    """The vehicles that were planned for."""
    tours: Mapping[int, Tour] = field(default_factory=dict)
    """Of each vehicle, also of those who still fly lanes."""
    others: frozenset[Cell] = frozenset()
    """What those are to see who still fly lanes."""


class OpenWork(NamedTuple):
    """What is left to map, and the vehicles that can map it now."""

    known: Known
    flyers: Mapping[int, Flyer]
    memory: TourMemory
    decision: int
    """Seeds the search for tours."""


class Work(NamedTuple):
    """Which vehicle is to see what is left to map."""

    state: State
    memory: TourMemory
    waypoints: Waypoints = ()
    """What a plan begins with; none where the last one goes on."""
    others: Bits | None = None
    """The cells that other members of a fleet are to see, closed in the chart; None: none are."""


class Strategy(ABC):
    """How vehicles find a region and map it."""

    about: About | Explorer
    """Its name, and what users read about it."""
    stops: bool
    """Whether vehicles stop over cells to look."""
    patches: bool = False
    """Whether every patch of the region that begins in the box is looked for."""
    whole_box: bool = False
    """Whether every cell of the box is decided, whatever is seen."""
    flies_all_lanes: bool = False
    """Whether all lanes are flown, whatever is seen on the way."""
    lanes_drift: bool = False
    """Whether lanes drift with the cells; else they lie still over ground."""

    def in_force(self, state: State) -> Strategy:
        """Return the strategy that is followed now: this one, or what it falls back on."""
        return self

    # --- before the flight ----------------------------------------------------------------------
    @abstractmethod
    def lay(self, area: Area) -> Lanes:
        """Lay lanes over the box, inside of the fence."""

    def shares(self, setting: Setting) -> Shares:
        """Return the lanes of each vehicle; by a prior so that the region is seen soonest."""
        if setting.likely:
            blocks = soonest(setting.likely, setting.pads, self.pace(setting))
            return tuple(tuple(part.lane for part in block) for block in blocks)
        return share_out(setting.lanes, len(setting.pads))

    def begins_with(self, setting: Setting) -> Shares:
        """Return the lanes that each vehicle holds when the mission begins."""
        return setting.shares

    def rest_s(
        self, setting: Setting, state: State, lanes_m: float, cells: int, team: int
    ) -> float:
        """Return about how long a team takes for the rest of its lanes, or for cells, seconds."""
        if lanes_m:
            return lanes_m / setting.energy.speed_m_s / team
        return cells * self.cell_s(setting) / team

    @abstractmethod
    def pace(self, setting: Setting) -> Pace:
        """Return how fast lanes are flown, from the lowest layer."""

    @abstractmethod
    def search_s(self, setting: Setting) -> float:
        """Return about how long the longest share of the lanes takes in the air, seconds."""

    @abstractmethod
    def cell_s(self, setting: Setting) -> float:
        """Return about how long a cell of the region takes one vehicle, seconds."""

    def bound_s(self, setting: Setting, tree: Tree) -> float | None:
        """Return the bound of an exploration of this tree, seconds; None without one."""
        return None

    # --- what has to be decided -----------------------------------------------------------------
    def asked_for(self, setting: Setting, state: State) -> Iterable[Cell]:
        """Return the cells that have to be decided and are not, whatever lies beside them."""
        return ()

    def open_cells(self, setting: Setting, state: State) -> frozenset[Cell]:
        """Return all cells that have to be decided and are not, also those beside a patch."""
        return frozenset()

    def concluded(self, setting: Setting, state: State, left: tuple[Lane, ...]) -> State:
        """Return the state at the end by the map of a whole fleet; `left` are unseen lanes."""
        return replace(state, exhausted=state.tree is None and not left)

    # --- the search -----------------------------------------------------------------------------
    def searched(self, setting: Setting, state: State) -> State:
        """Note that the search is over once no vehicle has a lane or a suspicion."""
        done = all(v.idle_in_search for v in state.vehicles.values())
        return replace(state, exhausted=done)

    def still_searches(self, vehicle: VehicleState) -> bool:
        """Return whether a vehicle flies its lanes to their end before it maps."""
        return False

    def keeps_lanes(self, vehicle: VehicleState) -> bool:
        """Return whether a vehicle flies all its lanes on one path, and can spare none."""
        return False

    def least_lane_m(self, setting: Setting) -> float:
        """Return the least length of what is left of a lane to be flown as one, metres."""
        return 0.0

    def lane_done(self, setting: Setting, state: State) -> Callable[[Cell], bool]:
        """Return what says whether a lane has done its work at a cell: a frame has judged it."""
        return state.belief.open_tallies.as_dict().__contains__

    @abstractmethod
    def seen_in_passing(
        self, setting: Setting, state: State, event: FrameSeen, votes: Verdicts
    ) -> State:
        """Return the state in which a frame from anywhere counts for a search, beside its votes."""

    # --- orders ---------------------------------------------------------------------------------
    @abstractmethod
    def plan(self, setting: Setting, state: State) -> State:
        """Give orders that are planned for all vehicles at once, after an event."""

    @abstractmethod
    def next_order(self, setting: Setting, state: State, vehicle: VehicleState) -> State:
        """Give an order to an idle vehicle in the air that may work."""

    def may_take_off(self, state: State) -> bool:
        """Whether a vehicle that is ready may take off now."""
        return True

    def first_target(
        self, setting: Setting, state: State, vehicle: VehicleState
    ) -> GridPoint | None:
        """Return where a vehicle on the ground would fly first; None: nothing is left."""
        cell = vehicle.vertex or vehicle.candidate
        if cell is not None:
            return setting.where(cell, state.t_s)
        return setting.over_ground(vehicle.lanes[0][0], state.t_s) if vehicle.lanes else None

    def without_target(self, setting: Setting, state: State, vehicle: VehicleState) -> State:
        """Return the state in which nothing is left for a vehicle on the ground."""
        if setting.lanes or state.tree is not None:
            return state
        note = (
            "no part of the search box can be flown inside the geofence; move the one or the other"
        )
        return state.with_vehicle(vehicle.stood_down(Phase.FAILED, note))

    def give_up_far(self, setting: Setting, state: State, vehicle: VehicleState) -> State | None:
        """Give up what the last vehicle does not reach on a full battery; None: end its part."""
        return None

    def to_skip(self, state: State, vehicle: VehicleState) -> Cell | None:
        """Return the cell that a vehicle looks from, or is on its way to."""
        return None

    # --- work that is shared --------------------------------------------------------------------
    def replan_s(self, setting: Setting) -> float:
        """Return how long a plan is flown at least, seconds."""
        return 0.0

    def share_work(self, setting: Setting, state: State, work: OpenWork) -> Work:
        """Close in the chart what others are to see."""
        return Work(state, work.memory)

    def gathers(self, setting: Setting, state: State, vehicle: VehicleState) -> bool:
        """Return whether a member has to receive of others before it does anything."""
        return False

    def held_until_s(
        self, setting: Setting, state: State, vehicle: VehicleState, t_s: float
    ) -> float:
        """Return until when a member that is out of contact since `t_s` is left its work."""
        return t_s
