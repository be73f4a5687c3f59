"""Reports between members of a fleet: each member has a reducer that commands one vehicle.

Each member runs the same rules on its own events and on the reports that it has received. Another
member's vehicle is in the state as that member reports it (`MemberReport`). One of the members that
are in contact lays out parts of the map (`missions.flight.team.work_shares`). A member out of
contact (`MemberApart`) continues with its own share. It leaves the others theirs for as long as
that should take, and then takes over the rest. Decisions of others (`FactsShared`) count as votes.
The map of the results is made of all facts (`missions.mapping.joined_map`). Separation does not
depend on any of this: `missions.geo.columns`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Final

from missions import fleet_events as fleet
from missions.flight.sightings import frame_seen
from missions.flight.state import Setting, State
from missions.flight.strategy.lane_paths import still_open
from missions.flight.team.work_shares import back_from_lanes_s, held_until_s
from missions.flight.vehicle_state import Allotment, Column, Phase, ReturnReason
from missions.geo.trajectory import rounded_path
from missions.mapping.belief import Belief
from missions.mapping.joined_map import Facts
from missions.mapping.own_cells import as_frames
from missions.orders import FlyPath
from missions.planning.search.lanes import number_among

MIN_STEP_M: Final = 1.0
"""Minimum distance of two places of a path; nearer places are one, m."""
_PHASES: Final = {
    "stands": Phase.GROUNDED,
    "flies": Phase.AIRBORNE,
    "returns": Phase.AIRBORNE,
    "pilot": Phase.YIELDED,
    "guarded": Phase.GUARDED,
    "ended": Phase.FINISHED,
    "down": Phase.DOWN,
}
ON_GROUND: Final = ("stands", "ended", "down")
FLY_LANES: Final = ("stands", "flies", "returns")
"""Reported activities of members that will fly the lanes they hold; other lanes may be taken."""


def member_reported(state: State, event: fleet.MemberReport) -> State:
    """Return the state after another member's report on its vehicle."""
    before = state.vehicles[event.vehicle]
    flies = event.does not in ON_GROUND
    order = _path(state.setting, event) if event.does == "flies" else None
    layer_m = event.layer_m or state.setting.mission.altitude_m(event.vehicle - 1)
    vehicle = replace(
        before,
        phase=_PHASES[event.does],
        cruise_altitude_m=layer_m,
        tracked_s=event.t_s,
        home=event.home,
        position=event.position,
        height_m=event.height_m,
        remaining_wh=event.remaining_wh,
        order=order,
        landed=not flies,
        return_reason=ReturnReason.DONE if event.does == "returns" else None,
        returns_by_itself=event.does == "guarded",
        on_lane=order is not None and bool(event.lanes),
        candidate=None,
        back_s=event.t_s if before.phase is Phase.APART else before.back_s,
    )
    return _share_lanes(state.with_vehicle(vehicle), event)


def member_apart(state: State, event: fleet.MemberApart) -> State:
    """Return the state with a member out of contact; its work stays reserved for it for a time."""
    vehicle = state.vehicles[event.vehicle]
    if vehicle.phase in (Phase.FINISHED, Phase.DOWN) and vehicle.landed:
        return state
    until_s, due_s = event.t_s, float("-inf")
    if state.setting.strategy.shares_work and vehicle.phase in (Phase.AIRBORNE, Phase.GROUNDED):
        until_s = held_until_s(state, vehicle, event.t_s)
    if vehicle.lanes:
        due_s = round(back_from_lanes_s(state.setting, vehicle, event.t_s), 1)
    gone = replace(
        vehicle, phase=Phase.APART, order=None, on_lane=False,
        held_until_s=round(until_s, 1), due_s=due_s,
    )  # fmt: skip
    return state.with_vehicle(gone)


def parts_allotted(state: State, event: fleet.PartsAllotted) -> State:
    """Return the state after another member has assigned the parts of the map."""
    parts = {part.vehicle: part.places for part in event.parts}
    return replace(state, allotment=Allotment(event.vehicle, event.t_s, parts))


def air_requested(state: State, event: fleet.AirRequested) -> State:
    """Return the state with air that another member closes to ours, or opens again."""
    closed = {n: c for n, c in state.closed.items() if n != event.vehicle and c.until_s > event.t_s}
    if event.until_s > event.t_s:
        closed[event.vehicle] = Column(
            event.place, event.low_m, event.high_m, event.t_s, event.until_s
        )
    return replace(state, closed=closed)


def air_leased(state: State, event: fleet.AirLeased) -> State:
    """Return the state in which our vehicle has the air that it requested, for a time."""
    vehicle = state.vehicles[event.vehicle]
    if vehicle.asks is None or vehicle.asks.place != event.place:
        return state
    return state.with_vehicle(replace(vehicle, leased_until_s=event.until_s))


def facts_shared(state: State, event: fleet.FactsShared) -> State:
    """Return the state after the decisions of another member's frames."""
    votes = state.setting.mission.votes
    state = replace(state, shared_s=event.t_s)
    for fact in event.frames:
        if fact.doubt:
            continue  # of the map, not of what is flown
        if fact.seen:
            state = replace(state, shown=state.shown.union(cell for cell, _ in fact.votes))
            continue
        for seen in as_frames(event.vehicle, fact, votes.frames, votes.positive):
            state = frame_seen(state, seen)
    return state


def _path(setting: Setting, event: fleet.MemberReport) -> FlyPath | None:
    """Return another vehicle's path, as nearly as its reported places allow; None without one."""
    places = [event.position]
    for place in event.path:
        if place.distance_to(places[-1]) >= MIN_STEP_M:
            places.append(place)
    if len(places) < 2:
        return None
    mission = setting.mission
    path = rounded_path(places, event.t_s, speed_m_s=mission.flight.speed_m_s)
    return FlyPath(path, event.height_m, None, mission.camera.interval_s)


def _share_lanes(state: State, event: fleet.MemberReport) -> State:
    """Give another member the lanes that it holds, and those of ours that it reaches sooner.

    Of two members with the same lane, the one in whose order it stands earlier keeps it. At a tie
    the one that flies keeps it, then the one with the lower number. A vehicle keeps the lane that
    it is on. If their views differ for a moment, both fly the lane, or the one that is done first
    takes it over.
    """
    setting = state.setting
    if event.does not in FLY_LANES:
        own = [lane for vehicle in state.own_vehicles for lane in vehicle.lanes]
        taken = {number_among(setting.lanes, lane) for lane in own}
        left = tuple(number for number in event.lanes if number not in taken)
        event = replace(event, lanes=left)
    theirs = {number: place for place, number in enumerate(event.lanes)}
    known = {
        number_among(setting.lanes, lane): lane for lane in state.vehicles[event.vehicle].lanes
    }
    held = tuple(
        known.get(number, setting.lanes[number])
        for number in event.lanes
        if number < len(setting.lanes)
    )
    state = state.with_vehicle(replace(state.vehicles[event.vehicle], lanes=held))
    they_stand = event.does != "flies"
    for ours in state.own_vehicles:
        kept, stands = [], ours.landed or ours.return_reason is not None
        for place, lane in enumerate(ours.lanes):
            their_place = theirs.get(-1 if (n := number_among(setting.lanes, lane)) is None else n)
            mine = (-1 if ours.on_lane and place == 0 else place, stands, ours.vehicle)
            if their_place is None or mine < (their_place, they_stand, event.vehicle):
                kept.append(lane)
        if len(kept) < len(ours.lanes):
            # sightings belong to the first lane; the path leads to the others later
            same = kept[:1] == list(ours.lanes[:1])
            seen_m = ours.lane_seen_m if same else ()
            on_lane = ours.on_lane and bool(kept)
            ours = replace(ours, lanes=tuple(kept), on_lane=on_lane, lane_seen_m=seen_m)
            state = state.with_vehicle(ours)
    return state


def facts_of(setting: Setting) -> Facts:
    """Return an empty collection of facts, for the events of a journal."""
    votes, explored = setting.mission.votes, setting.mission.detector.explored
    return Facts(Belief(votes.frames, votes.positive), setting.in_box, explored)


def with_map(state: State, facts: Facts) -> State:
    """Return a state with the map that facts make, in any order."""
    belief, overview, shown = facts.joined()
    return replace(state, belief=belief, overview=overview, shown=shown)


def concluded(state: State) -> State:
    """Return the state at the end, with the progress of the mission by its map. It differs for a
    service that flies nothing, and for a member whose vehicle returned early: others may have done
    the rest."""
    strategy = state.setting.strategy
    early = state.is_over and strategy.flies_all_lanes and not state.exploration_finished
    if state.our_numbers and not early:
        return state
    if state.our_numbers and strategy.open_cells(state):
        return state
    left = () if state.tree is not None else still_open(state, state.setting.lanes)
    vehicles = {number: replace(v, lanes=()) for number, v in state.vehicles.items()}
    state = replace(state, vehicles=vehicles, unreachable_lanes=left)
    return strategy.concluded(state, left)


ON_EVENT: Final[Mapping[type, Callable[[State, Any], State]]] = {
    fleet.MemberReport: member_reported,
    fleet.FactsShared: facts_shared,
    fleet.MemberApart: member_apart,
    fleet.PartsAllotted: parts_allotted,
    fleet.AirRequested: air_requested,
    fleet.AirLeased: air_leased,
}
"""The transition of each event of a fleet."""
