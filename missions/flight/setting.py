"""What a mission is given and does not change, with the objects that decide where missions differ.

The reducer asks `setting.strategy`, `setting.team` and `setting.heights`. They keep nothing between
two calls: what a strategy has to remember is `State.memory`. So a resume repeats what was flown.

To add a strategy, inherit from `Strategy` or a strategy in `missions.flight.strategy`, and give it
a name with `missions.flight.strategies.register`, or by an entry point (docs/strategies.md).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

from missions.events import FrameSeen
from missions.flight.layout import Fences, Layout
from missions.flight.state import Phase, State, VehicleState
from missions.flight.strategy.work import Area, Lanes, OpenWork, Work
from missions.geo.fence import Fence
from missions.geo.trajectory import LANE_CUTS_M
from missions.mapping.belief import Belief, Verdicts
from missions.mapping.tree import Tree
from missions.mission.energy import CLIMB_OVERHEAD_S
from missions.mission.schema import Mission
from missions.planning.search.lanes import Lane, share_out
from missions.planning.search.search_order import Pace, expected_s, plain_blocks, soonest
from missions.planning.search.strip import Strip
from missions.planning.stepwise import Explorer
from missions.planning.sweep.strategies import About
from missions.units import Cell, GridPoint

if TYPE_CHECKING:
    from missions.planning.sweep.chart import Known

Shares = tuple[tuple[Lane, ...], ...]
"""The lanes of each vehicle, in the order of flight."""


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


class Team(ABC):
    """The vehicles that a service commands, and what it agrees with other services."""

    number: int | None = None
    """The one vehicle that is commanded, 0 for none of a fleet; None: all are."""
    knows_orders: bool = True
    """Whether it knows what vehicles are ordered."""
    shares_facts: bool = False
    """Whether other services receive what its frames decide, and make the same map of it."""
    climbs_on_path: bool = True
    """Whether a vehicle may change its layer while it flies to somewhere else."""

    def controls(self, number: int) -> bool:
        """Return whether a vehicle is commanded."""
        return True

    def fences(self, mission: Mission, whole: Fence, pads: Sequence[GridPoint]) -> Fences:
        """Return where vehicles may fly that start from their pads."""
        return Fences(whole, whole, None)

    def refusal(self, setting: Setting, vehicle: VehicleState) -> str:
        """Return why a vehicle may not take off from where it stands; empty if it may."""
        return ""

    def urgent_order(self, setting: Setting, state: State, vehicle: VehicleState) -> State | None:
        """Return the state in which a vehicle does what comes before all else; None: nothing."""
        return None

    def change_layer(self, setting: Setting, state: State, vehicle: VehicleState) -> State | None:
        """Return the state in which a vehicle changes its layer as others allow it; None: it may
        change it wherever the air is clear."""
        return None

    def way_out(self, setting: Setting, state: State, vehicle: VehicleState) -> State:
        """Return the state in which a waiting vehicle leaves its pad past those of others."""
        return state

    def free_lane(self, setting: Setting, state: State) -> Lane | None:
        """Return the first lane with something left to judge that no vehicle holds."""
        return None

    def gathers(self, setting: Setting, state: State, vehicle: VehicleState) -> bool:
        """Return whether a vehicle without lanes has to hear of others before it does anything."""
        return False

    @abstractmethod
    def share_work(self, setting: Setting, state: State, work: OpenWork) -> Work:
        """Close in the chart what others are to see."""

    def mark_unreported(self, setting: Setting, state: State, known: Known) -> bool:
        """Mark undecided cells that others may take for observed; return whether there are any."""
        return False


class OneHeight:
    """Lanes are flown in the layers from which the map is made."""

    def searched(self, state: State) -> Callable[[Cell], bool]:
        """Return what says whether any frame has judged a cell."""
        return state.belief.open_tallies.as_dict().__contains__

    def layer_m(self, setting: Setting, vehicle: VehicleState) -> float:
        """The altitude that a vehicle works in."""
        return setting.mission.altitude_m(vehicle.vehicle - 1)

    def in_layer(self, setting: Setting, state: State, vehicle: VehicleState) -> bool:
        """Return whether a vehicle is where it works, or will be in time."""
        return True

    def take_off_height_m(self, setting: Setting, state: State, vehicle: VehicleState) -> float:
        """How high a vehicle climbs over its pad, above it."""
        return vehicle.cruise_height_m

    def as_mapping(self, setting: Setting, vehicle: VehicleState) -> VehicleState:
        """A vehicle as it will be once it maps."""
        return vehicle

    def maps_meanwhile(self, state: State, vehicle: VehicleState) -> bool:
        """Whether one that stands without lanes takes off to map while others fly theirs."""
        return False

    def cuts_m(self, setting: Setting) -> tuple[float, ...]:
        """By how much corners between lanes are cut, the most first."""
        return LANE_CUTS_M

    def shortened(self, setting: Setting, vehicle: VehicleState, lane: Lane) -> Lane:
        """A lane without its ends, as far as pictures show them from before them."""
        return lane


@dataclass(frozen=True, kw_only=True)
class Setting(Layout):
    """What a mission is given and does not change."""

    team: Team
    """The vehicles that are commanded, and what is agreed with other services."""
    strategy: Strategy
    """How vehicles find the region and map it."""
    heights: OneHeight
    """The heights at which vehicles search and map."""

    @property
    def member(self) -> int | None:
        """The one vehicle that is commanded, 0 for none of a fleet; None: all are."""
        return self.team.number

    @cached_property
    def shares(self) -> Shares:
        """The lanes of each vehicle before take-off."""
        return self.strategy.shares(self) if self.lanes else ((),) * len(self.pads)

    @property
    def first_sighting_s(self) -> tuple[float, float] | None:
        """The expected time from lift-off to the first sighting, with and without the prior, s.

        None without a prior. Other vehicles, batteries and obstacles cost no time in it.
        """
        if not self.likely:
            return None
        parts = [*self.likely, *(part.turned for part in self.likely)]
        of_lane = {part.lane: part for part in parts}
        blocks = [tuple(of_lane[lane] for lane in block) for block in self.shares]
        plain = plain_blocks(self.likely, len(blocks))
        pace = self.strategy.pace(self)
        climb_s = self.mission.top_altitude_m(0) / self.energy.climb_m_s + CLIMB_OVERHEAD_S
        soon_s, late_s = (expected_s(b, self.pads, pace) for b in (blocks, plain))
        return climb_s + soon_s, climb_s + late_s

    def lane_time_s(self, t_s: float) -> float:
        """Return the time at which lanes lie as laid, in the frame of the cells."""
        return 0.0 if self.strategy.lanes_drift else t_s

    def to_lanes(self, place: GridPoint, t_s: float) -> GridPoint:
        """Return a place over ground at a time in the frame of the lanes."""
        return self.grid.to_moving(place, t_s - self.lane_time_s(t_s))

    def over_ground(self, place: GridPoint, t_s: float) -> GridPoint:
        """Return a place in the frame of the lanes over ground: the inverse of `to_lanes`."""
        return self.grid.to_fixed(place, t_s - self.lane_time_s(t_s))

    def strip(self, lane: Lane, t_s: float) -> Strip:
        """Return the cells that a lane decides, as they lie at a time."""
        return Strip.of(self.grid, lane, self.lane_rows, self.lane_time_s(t_s))

    def initial_state(self) -> State:
        """Return the state in which every vehicle is offline and has its share of the lanes."""
        mission = self.mission
        blocks = self.strategy.begins_with(self)
        vehicles = {
            number: VehicleState(
                number,
                mission.search_altitude_m(number - 1) or mission.altitude_m(number - 1),
                home_level_m=self.home_level_m(number),
                lanes=blocks[number - 1],
            )
            for number in range(1, len(mission.vehicles) + 1)
        }
        none_seen = Belief(mission.votes.frames, mission.votes.positive)
        ours = tuple(filter(self.team.controls, vehicles))
        return State(none_seen, vehicles, ours, overview=none_seen)
