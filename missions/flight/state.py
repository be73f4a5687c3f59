"""The state of a mission at an instant, with its setting and the objects that decide.

The reducer asks `setting.strategy`, `setting.team` and `setting.heights`. They keep nothing between
two calls: a strategy remembers only what is in `State.memory`. So a resume repeats the flight.

To add a strategy, inherit from `Strategy` or one in `missions.flight.strategy`. Name it with
`missions.flight.strategies.register` or an entry point (docs/how-to/add-strategy.md).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

from missions.events import FrameSeen
from missions.flight.strategy.work import Area, Lanes
from missions.flight.vehicle_state import Allotment, Column, Phase, VehicleState
from missions.geo.fence import Fence
from missions.geo.trajectory import LANE_CUTS_M
from missions.mapping.belief import Belief, Verdicts
from missions.mapping.tree import Tree
from missions.mission.layout import Layout
from missions.mission.schema import Mission
from missions.orders import Hold
from missions.planning.search.lanes import Blocks, Lane, share_out
from missions.planning.search.search_order import Pace, soonest
from missions.planning.stepwise import Explorer, Memory
from missions.planning.sweep.chart import KnownMap
from missions.planning.sweep.open_work import OpenWork, Work
from missions.planning.sweep.plan_memo import PlanMemo
from missions.planning.sweep.strategies import StrategyInfo
from missions.traffic import NO_TRAFFIC, Answer, Traffic
from missions.units import Cell, GridPoint


class Fences(NamedTuple):
    """Fences of the vehicles of a mission."""

    ours: Fence
    """Fence of the vehicles that are commanded."""
    shared: Fence
    """Fence of each vehicle of a fleet."""
    whole: Fence | None
    """A member's fence without the columns over others' pads, which are holes of `ours`."""


class Strategy(ABC):
    """A way to find a region and map it."""

    about: StrategyInfo | Explorer
    """The name of the strategy, and its texts for users."""
    stops: bool
    """True if vehicles stop over cells to observe them."""
    patches: bool = False
    """True if every patch of the region that begins in the box is mapped."""
    whole_box: bool = False
    """True if every cell of the box is decided, whatever frames show."""
    flies_all_lanes: bool = False
    """True if vehicles fly all their lanes, on one path, before they map."""
    least_lane_cells: float = 0.0
    """Minimum length of the rest of a lane that is flown as a lane, cells."""
    replan_frames: float = 0.0
    """Minimum number of frames between two plans."""
    shares_work: bool = False
    """True if the team shares out the rest of the map."""
    lanes_drift: bool = False
    """True if lanes drift with the cells; else they are fixed over ground."""

    def in_force(self, state: State) -> Strategy:
        """Return the strategy in force: this one, or its fallback."""
        return self

    # --- before the flight ----------------------------------------------------------------------
    @abstractmethod
    def lay(self, area: Area) -> Lanes:
        """Lay lanes over the box, inside the fence."""

    def shares(self, setting: Setting) -> Blocks:
        """Return the lanes of each vehicle; by a prior so that the region is seen soonest."""
        if setting.likely:
            blocks = soonest(setting.likely, setting.pads, self.pace(setting))
            return tuple(tuple(part.lane for part in block) for block in blocks)
        return share_out(setting.lanes, len(setting.pads))

    def begins_with(self, setting: Setting) -> Blocks:
        """Return the lanes that each vehicle holds when the mission begins."""
        return setting.shares

    def rest_s(self, state: State, lanes_m: float, cells: int, team: int) -> float:
        """Return the time that a team takes for the rest of its lanes, or for cells, about, s."""
        if lanes_m:
            return lanes_m / state.setting.energy.speed_m_s / team
        return cells * self.cell_s(state.setting) / team

    @abstractmethod
    def pace(self, setting: Setting) -> Pace:
        """Return the speed along lanes, flown from the lowest layer."""

    @abstractmethod
    def search_s(self, setting: Setting) -> float:
        """Return the time in the air for the longest share of the lanes, about, s."""

    @abstractmethod
    def cell_s(self, setting: Setting) -> float:
        """Return the time that a cell of the region takes one vehicle, about, s."""

    def bound_s(self, setting: Setting, tree: Tree) -> float | None:
        """Return the bound of an exploration of this tree, s; None without one."""
        return None

    # --- what has to be decided -----------------------------------------------------------------
    def required_cells(self, state: State) -> Iterable[Cell]:
        """Return the undecided cells that have to be decided, whatever lies beside them."""
        return ()

    def open_cells(self, state: State) -> frozenset[Cell]:
        """Return all undecided cells that have to be decided, also those beside a patch."""
        return frozenset(self.required_cells(state))

    def concluded(self, state: State, left: tuple[Lane, ...]) -> State:
        """Return the state at the end by the map of a whole fleet; `left` are unseen lanes."""
        return replace(state, exhausted=state.tree is None and not left)

    # --- the search -----------------------------------------------------------------------------
    def lane_done(self, state: State) -> Callable[[Cell], bool]:
        """Return the predicate that a lane has done its work at a cell: a frame judged it."""
        return state.setting.heights.searched(state)

    def seen_in_passing(self, state: State, event: FrameSeen, votes: Verdicts) -> State:
        """Return the state in which a frame from anywhere counts for a search."""
        return state

    # --- orders ---------------------------------------------------------------------------------
    @abstractmethod
    def plan(self, state: State) -> State:
        """Give orders that are planned for all vehicles at once, after an event."""

    @abstractmethod
    def next_order(self, state: State, vehicle: VehicleState) -> State:
        """Give an order to an idle vehicle in the air that may work."""

    def may_take_off(self, state: State) -> bool:
        """Return whether a vehicle that is ready may take off now."""
        return True

    def first_target(self, state: State, vehicle: VehicleState) -> GridPoint | None:
        """Return the first target of a vehicle on the ground; None if nothing is left."""
        cell = vehicle.vertex or vehicle.candidate
        if cell is not None:
            return state.setting.where(cell, state.t_s)
        return state.setting.over_ground(vehicle.lanes[0][0], state.t_s) if vehicle.lanes else None

    def without_target(self, state: State, vehicle: VehicleState) -> State:
        """Return the state in which a vehicle on the ground has no target left."""
        if state.setting.lanes or state.tree is not None:
            return state
        note = "no part of the search box can be flown inside the geofence; move one of them"
        return state.with_vehicle(vehicle.stood_down(Phase.FAILED, note))

    def give_up_far(self, state: State, vehicle: VehicleState) -> State | None:
        """Give up what the last vehicle cannot reach on a full battery; None ends its part."""
        return None

    def to_skip(self, state: State, vehicle: VehicleState) -> Cell | None:
        """Return the cell that a vehicle observes, or flies to."""
        return None


class Team(ABC):
    """The vehicles that a service commands, and its agreements with other services."""

    knows_orders: bool = True
    """True if the orders of vehicles are known."""
    shares_facts: bool = False
    """True if other services receive the facts of our frames and make the same map from them."""
    climbs_on_path: bool = True
    """True if a vehicle may change its layer on its way."""

    def controls(self, number: int) -> bool:
        """Return whether a vehicle is commanded."""
        return True

    def fences(self, mission: Mission, whole: Fence, pads: Sequence[GridPoint]) -> Fences:
        """Return the fences of vehicles that start from their pads."""
        return Fences(whole, whole, None)

    def refusal(self, setting: Setting, vehicle: VehicleState) -> str:
        """Return the reason that forbids a take-off from here; empty if none does."""
        return ""

    def urgent_order(self, state: State, vehicle: VehicleState) -> State | None:
        """Return the state in which a vehicle carries out its most urgent order; None without."""
        return None

    def change_layer(self, state: State, vehicle: VehicleState) -> State | None:
        """Return the state in which a vehicle changes its layer as others allow it. None: it may
        change its layer wherever the air is clear."""
        return None

    def leave_column(self, state: State, vehicle: VehicleState) -> State:
        """Return the state in which a waiting vehicle leaves its pad past those of others."""
        return state

    def free_lane(self, state: State) -> Lane | None:
        """Return the first lane with something left to judge that no vehicle holds."""
        return None

    def gathers(self, state: State, vehicle: VehicleState) -> bool:
        """Return whether a vehicle without lanes must wait for reports of others first."""
        return False

    @abstractmethod
    def share_work(self, state: State, work: OpenWork) -> tuple[State, Work]:
        """Close the cells of the chart that others are to observe."""

    def mark_unreported(self, state: State, known: KnownMap) -> bool:
        """Mark undecided cells that others may take for observed; return whether there are any."""
        return False


class OneHeight:
    """Flight of lanes in the layers in which the map is made."""

    def searched(self, state: State) -> Callable[[Cell], bool]:
        """Return the predicate that any frame has judged a cell."""
        return state.belief.open_tallies.as_dict().__contains__

    def layer_m(self, setting: Setting, vehicle: VehicleState) -> float:
        """Return the working altitude of a vehicle; with lanes, the search altitude, m."""
        high_m = setting.mission.search_altitude_m(vehicle.vehicle - 1) if vehicle.lanes else None
        return setting.mission.altitude_m(vehicle.vehicle - 1) if high_m is None else high_m

    def in_layer(self, state: State, vehicle: VehicleState) -> bool:
        """Return whether a vehicle is in its layer, or will be in time."""
        return True

    def take_off_height_m(self, state: State, vehicle: VehicleState) -> float:
        """Return the height of a take-off above the pad, m."""
        return vehicle.cruise_height_m

    def maps_meanwhile(self, state: State, vehicle: VehicleState) -> bool:
        """Return whether a waiting vehicle without lanes maps while others fly theirs."""
        return False

    def cuts_m(self, setting: Setting) -> tuple[float, ...]:
        """Return the cuts of corners between lanes, largest first, m."""
        return LANE_CUTS_M

    def shortened(self, setting: Setting, vehicle: VehicleState, lane: Lane) -> Lane:
        """Return a lane without those ends that pictures show before they are reached."""
        return lane


@dataclass(frozen=True, kw_only=True)
class Setting(Layout):
    """The fixed data of a mission: layout, team, strategy, heights."""

    team: Team
    """The commanded vehicles, and the agreements with other services."""
    strategy: Strategy
    """The strategy that finds the region and maps it."""
    heights: OneHeight
    """The heights at which vehicles search and map."""
    plans: PlanMemo = field(default_factory=PlanMemo, compare=False, repr=False)
    """Earlier plans of this flight."""

    @cached_property
    def shares(self) -> Blocks:
        """The lanes of each vehicle before take-off."""
        return self.strategy.shares(self) if self.lanes else ((),) * len(self.pads)

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
        return State(self, none_seen, none_seen, vehicles, ours)


@dataclass(frozen=True, slots=True)
class State:
    """The state of the mission at an instant: the fold of the journal."""

    setting: Setting = field(compare=False, repr=False)
    belief: Belief
    overview: Belief
    """The votes of frames from the height of a search."""
    vehicles: Mapping[int, VehicleState]
    our_numbers: tuple[int, ...]
    """The commanded vehicles, in order."""
    t_s: float = 0.0
    tree: Tree | None = None
    exhausted: bool = False
    """True if the search ended without a region."""
    falls_back: bool = False
    """True if the time for paths is over: the rest is explored with stops."""
    surveyed: bool = False
    """True if every cell that can be decided is, in a survey of the box."""
    unreachable_lanes: tuple[Lane, ...] = ()
    """Lanes that no path inside the fence leads to."""
    recalled: bool = False
    paused: bool = False
    """True if the operator has all vehicles hold."""
    traffic: Traffic = NO_TRAFFIC
    """Aircraft of others near the team."""
    skipped: frozenset[Cell] = frozenset()
    """Cells that the operator has skipped."""
    abandoned: frozenset[Cell] = frozenset()
    """Cells of the region beyond the fence or out of reach."""
    memory: Memory | None = None
    """Memory of the strategy for its next decision."""
    last_wait: tuple[Tree, Mapping[int, Cell], frozenset[int], float] | None = None
    """Tree, positions, robots that an explorer has wait until these change, and time, s."""
    undecided: frozenset[Cell] = frozenset()
    """Visited cells that lack votes on themselves or on a neighbour."""
    found_s: float | None = None
    """Time of the first confirmed ROI cell, s."""
    closed: Mapping[int, Column] = field(default_factory=dict)
    """Air that other members have requested; our vehicles stay out of it."""
    shown: frozenset[Cell] = frozenset()
    """Cells that other members' frames showed as no region, without a decision."""
    allotment: Allotment | None = None
    """Parts of the map, by member of a fleet."""
    shared_s: float = float("-inf")
    """Time of the last report of another member, s."""

    def with_vehicle(self, vehicle: VehicleState) -> State:
        """Return this state with one vehicle changed."""
        return replace(self, vehicles={**self.vehicles, vehicle.vehicle: vehicle})

    def with_all(self, change: Callable[[VehicleState], VehicleState]) -> State:
        """Return this state with each vehicle changed."""
        return replace(self, vehicles={n: change(v) for n, v in self.vehicles.items()})

    def holding(self, vehicle: VehicleState) -> State:
        """Return this state with a vehicle that hovers and reserves only the air for that."""
        order = vehicle.order if isinstance(vehicle.order, Hold) else Hold()
        return self.with_vehicle(replace(vehicle, order=order))

    @property
    def own_vehicles(self) -> tuple[VehicleState, ...]:
        """The commanded vehicles, in the order of their numbers."""
        return tuple(self.vehicles[number] for number in self.our_numbers)

    @property
    def is_held(self) -> bool:
        """True if vehicles hold, for the operator or for traffic."""
        return self.paused or self.traffic.answer is not Answer.GO_ON

    @property
    def is_over(self) -> bool:
        """True if no vehicle will act any more, and none is in the air."""
        return all(v.ended for v in self.own_vehicles or self.vehicles.values())

    @property
    def unsearched(self) -> tuple[Lane, ...]:
        """Parts of lanes that no judged frame shows, while there is no region."""
        if self.tree is not None:
            return ()
        return (*self.unreachable_lanes, *(a for v in self.vehicles.values() for a in v.lanes))

    @property
    def exploration_finished(self) -> bool:
        """True if the region is explored, or the search ended without one."""
        tree = self.tree
        return self.exhausted if tree is None else tree.is_explored(tree.root)

    @property
    def unreported(self) -> tuple[int, ...]:
        """Other members of the fleet whose landing is not known."""
        others = (v for n, v in self.vehicles.items() if n not in self.our_numbers)
        return tuple(v.vehicle for v in others if v.phase in (Phase.APART, Phase.OFFLINE))

    @property
    def completed(self) -> bool:
        """True if the map has no gap, no vehicle is down or lost, and all of ours are at home."""
        everybody = self.vehicles.values()
        return (
            self.exploration_finished
            and not self.abandoned
            and not self.undecided
            and not self.skipped
            and not self.unsearched
            and all(v.landed for v in self.own_vehicles or everybody)
            and not any(v.was_down or v.phase in (Phase.DOWN, Phase.LOST) for v in everybody)
            and not self.unreported
        )
