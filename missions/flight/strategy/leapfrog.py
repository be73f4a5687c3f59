"""Leapfrog in flight: the first vehicle maps a box while the second one tracks it, by turns.

The mapper flies a piece of the lanes while the tracker hovers above and sees the marker on its top.
Then the mapper hovers, and the tracker moves (`missions.planning.leapfrog_geometry`). So both know
their positions without satellites (`uavmap.aircraft.leapfrog_sight`).

A round leads along all lanes that have an undecided cell of the box, the last one back over the
mapper's pad. Neither flies alone: they take off when both can. When one returns or is not under our
control, the other returns as well.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final

from missions.flight.airspace.airspace import Airspace
from missions.flight.path_orders import PLAN_LEAD_S, give_path, through
from missions.flight.return_home import send_home
from missions.flight.state import Setting, State
from missions.flight.strategy.every_patch import Survey
from missions.flight.strategy.lane_paths import flown_along
from missions.flight.strategy.sweep_paths import give_up_rest
from missions.flight.vehicle_state import Phase, ReturnReason, VehicleState
from missions.geo.path_in_fence import is_outside
from missions.geo.trajectory import ACCELERATION_M_S2, least_s
from missions.mission.fleet_checks import tracker_view
from missions.planning.leapfrog_geometry import MIN_PATH_M, Role, Step, steps_along
from missions.planning.search.lanes import Blocks, Lane, turned
from missions.planning.sweep.strategies import LEAPFROG
from missions.units import Cell, GridPoint

MAPPER: Final = 1
"""The vehicle in the lowest layer."""
TRACKER: Final = 2
NEAR_M: Final = 0.7
"""Distance to the end of its way within which a vehicle has flown it, m."""
REST_S: Final = 1.5
"""Time at rest between two moves, s; pictures of a moving vehicle are less exact."""
STALLED_S: Final = 60.0
"""Time without a move after which the rest is given up, s."""
STEP_OVERHEAD_S: Final = 4.0
"""Time of a step besides its flight, about, s."""


@dataclass(frozen=True, slots=True)
class LeapfrogMemory:
    """The position of the two vehicles in their round."""

    steps: tuple[Step, ...] = ()
    index: int = 0
    begun: bool = False
    """True if the mover has its order."""
    open: int | None = None
    """Number of undecided cells at the beginning of the round."""
    homeward: bool = False
    """True on the way back over the mapper's pad."""
    waits_since_s: float | None = None
    rests_until_s: float = float("-inf")


def _together(state: State) -> State:
    """Send a vehicle home with its partner; end the round when one takes no more part."""
    vehicles = state.vehicles.values()
    if any(v.ended for v in vehicles) and all(v.landed or v.ended for v in vehicles):
        return give_up_rest(state)
    for number, other in ((MAPPER, TRACKER), (TRACKER, MAPPER)):
        vehicle, partner = state.vehicles[number], state.vehicles[other]
        if vehicle.works and _is_leaving(partner):
            note = vehicle.note or f"vehicle {other} does not continue, and leapfrog needs two"
            alone = replace(vehicle, note=note)
            state = send_home(state, alone, ReturnReason.BATTERY)
    return state


def _is_leaving(vehicle: VehicleState) -> bool:
    """Return whether it returns, was taken away, or is silent in the air."""
    if vehicle.phase is Phase.OFFLINE:
        return not vehicle.landed
    here = (Phase.AIRBORNE, Phase.GROUNDED)
    return vehicle.return_reason is not None or vehicle.phase not in here


def _passed(memory: LeapfrogMemory, state: State) -> LeapfrogMemory:
    """Return the memory after the steps whose mover has reached their end."""
    while memory.index < len(memory.steps):
        step = memory.steps[memory.index]
        at = state.vehicles[MAPPER if step.mover is Role.MAPPER else TRACKER].position
        is_there = at.distance_to(GridPoint(*step.end)) <= NEAR_M
        # a way may lead back to near its start: only a step that has begun counts
        if not (is_there and (memory.begun or step.length_m <= NEAR_M)):
            break
        rests_s = state.t_s + (REST_S if memory.begun else 0.0)
        memory = replace(
            memory, index=memory.index + 1, begun=False, waits_since_s=None, rests_until_s=rests_s
        )
    return memory


def _next_round(state: State, memory: LeapfrogMemory) -> LeapfrogMemory:
    """Return a round along the rest of the lanes; the return path if no more can be decided."""
    setting = state.setting
    mapper = state.vehicles[MAPPER]
    left = len(setting.strategy.open_cells(state))
    lanes = () if memory.open == left else lanes_left(state)
    view = tracker_view(setting.mission)
    steps = steps_along(setting.fence, view, _along(state, mapper, lanes)) if lanes else ()
    if steps:
        return LeapfrogMemory(steps, open=left)
    home = setting.fence.route(mapper.position, mapper.pad) or ()
    steps = steps_along(setting.fence, view, [mapper.position, *home])
    return LeapfrogMemory(steps, open=left, homeward=True)


def _move(state: State, memory: LeapfrogMemory) -> State:
    step = memory.steps[memory.index]
    waits_s = state.t_s if memory.waits_since_s is None else memory.waits_since_s
    if state.t_s - waits_s >= STALLED_S:
        return give_up_rest(replace(state, memory=memory))
    state = replace(state, memory=replace(memory, waits_since_s=waits_s))
    places = [GridPoint(*place) for place in step.path[1:]]
    if step.mover is Role.TRACKER:
        mover = state.vehicles[TRACKER]
        state = Airspace(state).reserve_or_wait(mover, mover.leg(places))
    else:
        mover = state.vehicles[MAPPER]
        if mover.position.distance_to(places[0]) < MIN_PATH_M and len(places) > 1:
            places = places[1:]
        begin_s = round(state.t_s + PLAN_LEAD_S, 3)
        path = through(state.setting, mover, places, [False] * len(places), begin_s)
        state = give_path(state, mover, path)
    if state.vehicles[mover.vehicle].idle:  # its air is not clear, or the fence does not allow it
        return state
    return replace(state, memory=replace(memory, begun=True, waits_since_s=None))


# --- the way ------------------------------------------------------------------------------------
def lanes_left(state: State) -> tuple[Lane, ...]:
    """Return the parts of lanes with a column in which a cell of the box is not decided."""
    setting = state.setting
    box, belief = setting.in_box, state.belief

    def done(cell: Cell) -> bool:
        return cell not in box or belief.verdict(cell) is not None

    strips = ((lane, setting.strip(lane, state.t_s)) for lane in setting.lanes)
    return tuple(part for lane, strip in strips for part in strip.parts_left(lane, done))


def _along(state: State, mapper: VehicleState, lanes: Iterable[Lane]) -> list[GridPoint]:
    """Return the path from the mapper along lanes, inside the fence; others are left out."""
    places, fence = [mapper.position], state.setting.fence
    for lane in turned(mapper.position, lanes, keep=state.setting.aimed_lanes):
        start, end = flown_along(state, mapper, lane)
        there, along = fence.route(places[-1], start), fence.route(start, end)
        if there is not None and along is not None:
            places.extend((*there, *along))
    return places


def steps_left_s(state: State) -> float:
    """Return the time that the rest of this round, or the first one, takes, about, s."""
    setting = state.setting
    memory = state.memory if isinstance(state.memory, LeapfrogMemory) else LeapfrogMemory()
    steps = memory.steps[memory.index :]
    if not memory.steps:
        mapper = state.vehicles[MAPPER]
        way = _along(state, mapper, lanes_left(state))
        way.extend(setting.fence.route(way[-1], mapper.pad) or ())
        steps = steps_along(setting.fence, tracker_view(setting.mission), way)
    speed_m_s = setting.path_speed_m_s(setting.mission.altitude_m(0), 0.0)
    return sum(least_s(s.length_m, speed_m_s, ACCELERATION_M_S2) + STEP_OVERHEAD_S for s in steps)


class Leapfrog(Survey):
    """Decide every cell of the box with two vehicles that move by turns."""

    about = LEAPFROG
    lanes_drift = False

    def shares(self, setting: Setting) -> Blocks:
        """Return all lanes for the mapper."""
        return (setting.lanes, *((),) * (len(setting.pads) - 1))

    def begins_with(self, setting: Setting) -> Blocks:
        """Return no lanes: the two fly rounds along the rest of the lanes."""
        return ((),) * len(setting.pads)

    def search_s(self, setting: Setting) -> float:
        """Return the time of the steps of the first round."""
        return steps_left_s(setting.initial_state())

    def rest_s(self, state: State, lanes_m: float, cells: int, team: int) -> float:
        """Return the time of the remaining steps of this round."""
        return steps_left_s(state)

    def may_take_off(self, state: State) -> bool:
        """Return whether both are in the air, or able to take off."""
        return all(
            v.works or (v.phase is Phase.GROUNDED and v.cleared and v.return_reason is None)
            for v in state.vehicles.values()
        )

    def plan_paths(self, state: State) -> State:
        """Have the vehicle move whose turn it is, once both are at rest."""
        if state.exhausted or state.recalled:
            return state
        state = _together(state)
        mapper, tracker = state.vehicles[MAPPER], state.vehicles[TRACKER]
        memory = state.memory if isinstance(state.memory, LeapfrogMemory) else LeapfrogMemory()
        if state.exhausted:
            return state
        if not (mapper.works and tracker.works):
            # the next sortie begins anew, along the rest by then
            fresh = LeapfrogMemory(open=memory.open)
            return state if memory == fresh else replace(state, memory=fresh)
        rest = all(v.idle and v.braking_until_s is None for v in (mapper, tracker))
        if not rest or any(is_outside(state.setting.fence, v.position) for v in (mapper, tracker)):
            return state
        before, memory = memory.index, _passed(memory, state)
        if memory.index > before:  # a sortie with a step counts as progress
            state = state.with_all(lambda vehicle: replace(vehicle, fruitless_sorties=0))
        if state.t_s < memory.rests_until_s:
            return replace(state, memory=memory)
        if memory.index >= len(memory.steps) and not memory.homeward:
            memory = _passed(_next_round(state, memory), state)
        if memory.index >= len(memory.steps):  # it is over its pad
            return give_up_rest(replace(state, memory=memory))
        return _move(state, memory)


PAIR: Final = Leapfrog()
