"""A service that commands all vehicles, a member of a fleet, and a station that only listens.

A member keeps to its own layer and to the column over its pad. It asks the others before it leaves
them (`missions.flight.airspace.airspace`).

Where a radio does not reach across the box, each member knows after the search only what it has
seen itself. Members that began to map would be out of contact again before the next one returns.
Several would then map the same outline. So a member that has flown its lanes waits over its pad, in
radio range of all. It waits for members that still fly lanes and are due, for their reports, and
for its part of the map. It does not wait for a member that is late, and not while it maps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from missions.flight.airspace.airspace import Airspace
from missions.flight.lane_progress import lanes_held
from missions.flight.path_orders import fly_route
from missions.flight.state import Fences, Setting, State, Team
from missions.flight.strategy.charting import gate_of
from missions.flight.strategy.lane_paths import cells_drift_out, still_open
from missions.flight.team.work_shares import mark_unreported, own_part, share_parts, shared_out
from missions.flight.vehicle_state import OFF_LAYER_M, Phase, VehicleState
from missions.geo.columns import PAD_M, columns_over, fence_without
from missions.geo.fence import Fence
from missions.mission.schema import Mission
from missions.planning.search.lanes import Lane
from missions.planning.sweep.chart import KnownMap
from missions.planning.sweep.open_work import OpenWork, Work
from missions.units import GridPoint

MAX_DELAY_S: Final = 45.0
"""Maximum wait for a member beyond its estimated return, s; estimates ignore turns and wind."""
SILENT_S: Final = 5.0
"""Time without news after which a member that is back in contact has reported all, s."""
REPORT_MAX_S: Final = 30.0
"""Maximum time that such a member takes to report all, s."""
PART_WAIT_S: Final = 15.0
"""Additional wait of a vehicle for its part of the map, s."""
GATE_M: Final = 1.0
"""Distance from the gate of its pad within which a vehicle is out of its column, m."""


@dataclass(frozen=True)
class Alone(Team):
    """A service that commands all vehicles."""

    def share_work(self, state: State, work: OpenWork) -> tuple[State, Work]:
        """Lay tours for all, also for those which still fly lanes."""
        return state, Work(*shared_out(state, work))


@dataclass(frozen=True)
class Member(Team):
    """A service that commands one vehicle of a fleet."""

    number: int = field()
    shares_facts = True
    climbs_on_path = False  # other members are asked for a column, not for a path

    def controls(self, number: int) -> bool:
        """Return whether it is this member's vehicle."""
        return number == self.number

    def fences(self, mission: Mission, whole: Fence, pads: Sequence[GridPoint]) -> Fences:
        """Return fences in which the columns over the pads of others are holes."""
        columns = columns_over(pads, mission.team.separation_m)
        others = [column for k, column in enumerate(columns, start=1) if k != self.number]
        ours, everyones = (
            fence_without(whole, holes, mission.fence.margin_m) for holes in (others, columns)
        )
        return Fences(ours, everyones, whole)

    def refusal(self, setting: Setting, vehicle: VehicleState) -> str:
        """Return a refusal if the vehicle is not at the place that its fleet keeps clear."""
        off_m = setting.pad_of(vehicle.vehicle).distance_to(vehicle.position)
        if off_m <= PAD_M:
            return ""
        return (
            f"it stands {off_m:.1f} m from the place that its fleet keeps clear for it; move it, "
            "or its home in every member's mission file"
        )

    def urgent_order(self, state: State, vehicle: VehicleState) -> State | None:
        """Have a vehicle climb or descend in place if its layer may belong to another.

        It was stopped between two layers. While it has the air of its way it continues. Else it
        asks for the way to the nearer of its two layers. If the others cannot be asked it goes
        without an answer, as it is in another's layer already.
        """
        layer_m = vehicle.cruise_altitude_m
        if abs(vehicle.level_m - layer_m) <= OFF_LAYER_M or vehicle.is_over_pad:
            return None
        air = Airspace(state)
        if not air.has_column(vehicle, layer_m):
            mission, index = state.setting.mission, vehicle.vehicle - 1
            high_m = mission.search_altitude_m(index)
            own_m = [layer_m, mission.altitude_m(index), *([high_m] if high_m else [])]
            layer_m = min(own_m, key=lambda own: abs(own - vehicle.level_m))
            vehicle, granted = air.ask_for_column(vehicle, layer_m)
            if granted is None:
                return state.holding(vehicle)
        return air.leave(replace(vehicle, cruise_altitude_m=layer_m), (vehicle.position,))

    def change_layer(self, state: State, vehicle: VehicleState) -> State | None:
        """Ask for a column that crosses others' layers, unless the vehicle is over its own pad. The
        vehicle has the air once all have agreed to stay out of it. If a member is out of contact,
        the vehicle changes its layer over its own pad, where it needs no agreement."""
        if vehicle.is_over_pad:
            return None
        air, layer_m = Airspace(state), state.setting.heights.layer_m(state.setting, vehicle)
        vehicle, granted = air.ask_for_column(vehicle, layer_m)
        if granted is None:
            return state.holding(vehicle)
        if not granted or vehicle.asks is None:
            return air.over_own_pad(replace(vehicle, asks=None))
        moved = replace(vehicle, cruise_altitude_m=layer_m, at_target=False)
        given = air.reserve(moved, moved.leg((vehicle.asks.place,)))
        return state.holding(vehicle) if given is None else given

    def leave_column(self, state: State, vehicle: VehicleState) -> State:
        """Have a vehicle leave its column straight where its way leads past those of others."""
        gate = gate_of(state.setting, vehicle)
        if not vehicle.is_over_pad or vehicle.position.distance_to(gate) < GATE_M:
            return state
        return fly_route(state, vehicle, [gate])

    def free_lane(self, state: State) -> Lane | None:
        """Return a lane of a member that dropped out, which no other has taken over."""
        if cells_drift_out(state.setting):
            return None  # fixed lanes are flown whole, seen or not
        held = {
            n for vehicle in state.vehicles.values() for n in lanes_held(state.setting, vehicle)
        }
        free = (lane for number, lane in enumerate(state.setting.lanes) if number not in held)
        return next((part for lane in free for part in still_open(state, (lane,))), None)

    def gathers(self, state: State, vehicle: VehicleState) -> bool:
        """Return whether to wait: without lanes, for the reports of all members that are due."""
        if vehicle.lanes:
            return False
        if state.setting.heights.in_layer(state, vehicle) and not vehicle.is_over_pad:
            return False  # it maps
        others = [other for number, other in state.vehicles.items() if number != vehicle.vehicle]
        # a third member may relay its sightings, long before it is in contact over its pad
        apart = (other for other in others if other.phase is Phase.APART)
        if any(state.t_s < other.due_s + MAX_DELAY_S for other in apart):
            return True
        if any(_reports(state, other) for other in others):
            return True
        return _part_to_come(state, vehicle, others)

    def share_work(self, state: State, work: OpenWork) -> tuple[State, Work]:
        """Keep to the member's own part, and lay out all parts if that is its duty."""
        state = share_parts(self.number, state, work)
        others, memory, tours = own_part(self.number, state, work.known.chart, work.memory)
        return state, Work(memory, tours, others)

    def mark_unreported(self, state: State, known: KnownMap) -> bool:
        """Mark cells whose votes decide nothing: such votes are not reported to others."""
        return mark_unreported(self.number, state, known)


@dataclass(frozen=True)
class Listener(Member):
    """A station that commands no vehicle of a fleet, and knows what all of them report."""

    number: int = field(default=0, init=False)
    knows_orders = False

    def fences(self, mission: Mission, whole: Fence, pads: Sequence[GridPoint]) -> Fences:
        """Return the whole fence: the station flies nothing."""
        return Fences(whole, whole, None)


def _reports(state: State, other: VehicleState) -> bool:
    """Return whether a member that is back in contact is still reporting."""
    if state.t_s >= other.back_s + REPORT_MAX_S or other.phase is Phase.APART:
        return False
    return state.t_s < max(other.back_s, state.shared_s) + SILENT_S


def _part_to_come(state: State, vehicle: VehicleState, others: Sequence[VehicleState]) -> bool:
    """Return whether another vehicle lays out parts, and has not since all were back."""
    back_s = max(other.back_s for other in others) if others else -math.inf
    if not back_s <= state.t_s < back_s + REPORT_MAX_S + PART_WAIT_S:
        return False
    leads = any(o.vehicle < vehicle.vehicle and o.works and not o.lanes for o in others)
    found = state.allotment
    told = found is not None and found.made_s >= back_s and vehicle.vehicle in found.parts
    return leads and not told
