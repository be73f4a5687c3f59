"""The air that vehicles reserve: an order is given only if the air that it needs is clear.

    air = Airspace(state)
    air.is_clear(vehicle, order)        whether the air that an order needs is clear
    air.reserve(vehicle, order)         the state with the order; None if its air is not clear
    state.holding(vehicle)              releases all but the air that the vehicle waits in

A reservation is the order that a vehicle carries out; no other record is kept. A vehicle that
cannot be commanded reserves all the air that it may be in. When that air changes,
`stop_conflicting` checks the orders under way again. A member of a fleet that leaves its own layer
or column asks the other members for a column of air. It has the column once all have agreed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Final

from missions.flight.airspace import needs
from missions.flight.lane_progress import lane_left
from missions.flight.state import State
from missions.flight.vehicle_state import OFF_LAYER_M, OVER_PAD_M, Column, Phase, VehicleState
from missions.geo.columns import ring
from missions.geo.fence import route_length_m
from missions.geo.volumes import Volume
from missions.mission.energy import CLIMB_SPEED_M_S
from missions.orders import FlyPath, FlyTo, Land, Look, Order, Sweep, TakeOff
from missions.units import GridPoint

SEPARATION_BUFFER_M: Final = 2.0
"""Distance by which two vehicles may stray towards each other and still keep apart, m."""
RING_TIMES: Final = (1.5, 2.5, 4.0)
"""Distances that a vehicle flies to make way, as multiples of the separation; nearest first."""
CLOCK_MARGIN_S: Final = 3.0
"""Time that air stays closed beyond the request, s, because members' clocks differ a little."""
MAX_LEASE_WAIT_S: Final = 12.0
"""Maximum time that a member waits for the air that it has requested, s."""
MIN_LEASE_FACTOR: Final = 2.0
"""Minimum duration of such a reservation, as a multiple of the time of the change of layer."""
_UNCONTROLLED_PHASES: Final = (Phase.APART, Phase.OFFLINE, Phase.YIELDED, Phase.GUARDED)
"""Phases of a vehicle that its member does not control, or of which no report arrives."""


@dataclass(frozen=True, slots=True)
class Airspace:
    """The air that each vehicle may use at an instant of a mission."""

    state: State
    ahead_s: float = needs.RESERVED_AHEAD_S
    """Reserved part of a path, s."""

    # --- reservations ---------------------------------------------------------------------------
    def is_clear(self, vehicle: VehicleState, order: Order) -> bool:
        """Return whether no reservation that binds the vehicle meets the air of an order."""
        others = self._reserved_by_others(vehicle, order)
        return not others or not self._is_in(self._needed(vehicle, order), others)

    def reserve(self, vehicle: VehicleState, order: Order) -> State | None:
        """Return the state in which the vehicle has the order; None if its air is not clear."""
        # the next report would stop a path that leads into uncontrolled air
        blocked = isinstance(order, FlyPath) and self._leads_into_uncontrolled(vehicle, order)
        if blocked or not self.is_clear(vehicle, order):
            return None
        return self.state.with_vehicle(replace(vehicle, order=order))

    def reserve_or_wait(self, vehicle: VehicleState, order: Order) -> State:
        """Reserve the air for an order, or a detour of the return path; else the vehicle waits."""
        if (given := self.reserve(vehicle, order)) is not None:
            return given
        if isinstance(order, FlyTo) and vehicle.return_reason is not None:
            for detour in self._detours(vehicle, order):
                if (given := self.reserve(vehicle, detour)) is not None:
                    return given
        return self.state if vehicle.landed else self.state.holding(vehicle)

    def leave(self, vehicle: VehicleState, route: tuple[GridPoint, ...]) -> State:
        """Return the state in which a member leaves air that may be another's, clear or not."""
        return self.state.with_vehicle(replace(vehicle, order=vehicle.leg(route), at_target=False))

    def over_own_pad(self, vehicle: VehicleState) -> State:
        """Return the state in which a member flies to its own column, in its layer."""
        route = self.state.setting.fence.route(vehicle.position, vehicle.pad) or (vehicle.pad,)
        return self.leave(vehicle, route)

    # --- vehicles that cannot be commanded ------------------------------------------------------
    def uncontrolled_but(self, vehicle: VehicleState) -> list[VehicleState]:
        """Return the other vehicles in the air that cannot be commanded to make way."""
        others = (v for v in self.state.vehicles.values() if v.vehicle != vehicle.vehicle)
        return [other for other in others if other.uncontrolled]

    def stop_conflicting(self) -> State:
        """Return the state in which vehicles that fly towards uncontrolled or closed air stop."""
        state = self.state
        for vehicle in state.own_vehicles:
            flying = vehicle.phase is Phase.AIRBORNE and not vehicle.landed
            if not flying or not isinstance(vehicle.order, FlyTo | Sweep | Look | FlyPath):
                continue
            if Airspace(state)._leads_into_uncontrolled(vehicle, vehicle.order):
                state = state.with_vehicle(replace(vehicle.interrupted(state.t_s), at_target=False))
        return state

    def make_way(self, vehicle: VehicleState) -> State | None:
        """Return the state in which a vehicle leaves uncontrolled or closed air. None if it is in
        no such air, or if no place beside it is clear."""
        others = self._uncontrolled(vehicle) + self._closed()
        if not self._is_in(needs.hover_air(vehicle), others):
            return None
        for place in self._ring(vehicle.position, RING_TIMES):
            route = self.state.setting.fence.route(vehicle.position, place)
            if route is None or self._is_in(needs.hover_air(vehicle, place), others):
                continue
            order = vehicle.leg(route)
            if self.is_clear(vehicle, order):
                off_lane = lane_left(vehicle, self.state.setting.grid.cell_m)
                return self.state.with_vehicle(replace(off_lane, order=order, at_target=False))
        return None

    def _leads_into_uncontrolled(self, vehicle: VehicleState, order: Order) -> bool:
        """Return whether an order leads into uncontrolled or closed air; leaving it is allowed."""
        others, closed = self.uncontrolled_but(vehicle), self._closed()
        if not others and not closed:
            return False
        here, needed = needs.hover_air(vehicle), self._needed(vehicle, order)
        # a vehicle in closed air leaves it: that air was not agreed yet
        if any(not self._meet(here, air) and self._meet(needed, air) for air in closed):
            return True
        returns = vehicle.return_reason is not None  # it leaves whatever air it is in
        end = replace(needed, path=needed.path[-1:])
        for air in self._uncontrolled(vehicle):
            leaves = self._meet(here, air) and (returns or not self._meet(end, air))
            if not leaves and self._meet(needed, air):
                return True
        return False

    # --- places ---------------------------------------------------------------------------------
    def places_beside_pad(self, vehicle: VehicleState) -> list[GridPoint]:
        """Return places inside the fence for a landing beside the pad, nearest first; those in the
        columns of other pads come last."""
        around = list(filter(self.state.setting.fence.allows, self._ring(vehicle.home, (1.5, 2.5))))
        around.sort(key=lambda place: (vehicle.position.distance_to(place), place))
        pads = [v.home for v in self.state.vehicles.values() if v.vehicle != vehicle.vehicle]
        near = {at for at in around if any(at.distance_to(pad) < self._distance_m for pad in pads)}
        return sorted(around, key=near.__contains__)

    def places_around(self, vehicle: VehicleState) -> list[GridPoint]:
        """Return places inside the fence just outside the vehicle's air, and farther away."""
        around = self._ring(vehicle.position, (1.5, 4.0))
        return list(filter(self.state.setting.fence.allows, around))

    def _ring(self, centre: GridPoint, times: Iterable[float]) -> Iterator[GridPoint]:
        """Return eight places around a centre, north first, for each multiple of the separation."""
        return chain.from_iterable(ring(centre, each * self._distance_m, 8) for each in times)

    def _detours(self, vehicle: VehicleState, order: FlyTo) -> list[FlyTo]:
        """Return paths home around others' columns, shortest first. A landing takes half a minute.
        A vehicle with a low battery cannot always wait for it."""
        fence, ways = self.state.setting.fence, []
        others = self._reserved_by_others(vehicle, order)
        for centre in {air.path[0] for air in others if len(set(air.path)) == 1}:
            for via in self._ring(centre, (2.0,)):
                there, back = fence.route(vehicle.position, via), fence.route(via, vehicle.pad)
                if there is not None and back is not None:
                    ways.append((*there, *back))
        ways.sort(key=lambda way: (route_length_m(vehicle.position, way), way))
        return [replace(order, route=way) for way in ways]

    # --- what others reserve --------------------------------------------------------------------
    @property
    def _distance_m(self) -> float:
        """Horizontal distance between two reservations, m."""
        return self.state.setting.mission.team.separation_m + SEPARATION_BUFFER_M

    def _meet(self, one: Volume, other: Volume) -> bool:
        """Return whether two volumes are closer than the separation; layers never meet."""
        return one.meets(other, self._distance_m, self.state.setting.mission.team.layer_m)

    def _is_in(self, one: Volume, others: Iterable[Volume]) -> bool:
        return any(self._meet(one, other) for other in others)

    def _needed(self, vehicle: VehicleState, order: Order | None) -> Volume:
        return needs.needed_air(self.state, vehicle, order, self.ahead_s)

    def _uncontrolled(self, vehicle: VehicleState) -> list[Volume]:
        """Return the air in which the other uncontrolled vehicles may be."""
        return [
            air
            for other in self.uncontrolled_but(vehicle)
            for air in needs.uncontrolled_air(self.state, other)
        ]

    def _closed(self) -> list[Volume]:
        """Return the columns that are closed now because other members have requested them."""
        return [
            needs.column_air(column)
            for _, column in sorted(self.state.closed.items())
            if column.until_s + CLOCK_MARGIN_S > self.state.t_s
        ]

    def _reserved_by_others(self, asking: VehicleState, order: Order) -> list[Volume]:
        found = [
            air
            for other in self.state.vehicles.values()
            if other.vehicle != asking.vehicle
            for air in self._reserved_by(other, asking, order)
        ]
        closed = [] if asking.landed or isinstance(order, Land) else self._closed()
        return found + [air for air in closed if not self._meet(needs.hover_air(asking), air)]

    def _reserved_by(
        self, other: VehicleState, asking: VehicleState, order: Order
    ) -> Sequence[Volume]:
        """Return the air that another vehicle reserves, as far as it binds the one that asks."""
        climbing = isinstance(other.order, TakeOff)
        if other.phase is Phase.LOST or (other.landed and not climbing):
            return ()
        here = needs.hover_air(asking)
        if other.uncontrolled:
            airs = needs.uncontrolled_air(self.state, other)
            if asking.landed or isinstance(order, Land):
                return airs
            # it cannot make way; a vehicle near it must be able to leave
            return [air for air in airs if not self._meet(here, air)]
        if other.vehicle not in self.state.our_numbers:
            return ()  # each member stays in air that no other may enter (`missions.geo.columns`)
        airs = [self._needed(other, other.order)]
        if (other.idle or climbing) and self._leads_out(asking, order, airs[0]):
            # two that are too close would otherwise wait, for each other or for a whole climb
            airs = []
        if other.spare_pad is not None or (other.over_home and other.idle):
            # it waits to land; a vehicle that is already in its column must be able to leave
            column = self._needed(other, Land())
            if asking.landed or not self._meet(here, column):
                airs.append(column)
        return airs

    def _leads_out(self, asking: VehicleState, order: Order, air: Volume) -> bool:
        """Return whether an order leads out of another's air, level or not through its height."""
        level_m = asking.level_m
        if asking.landed or not self._meet(Volume((asking.position,), level_m, level_m), air):
            return False
        needed = self._needed(asking, order)
        end = replace(needed, path=needed.path[-1:])
        past = needed.low_m < min(needed.high_m, air.high_m) and needed.high_m > air.low_m
        return not past and not self._meet(end, air) and needed.parts_from(air)

    # --- columns that members of a fleet ask each other for -------------------------------------
    def has_column(self, vehicle: VehicleState, layer_m: float) -> bool:
        """Return whether all members have agreed to the air from here to a layer, long enough."""
        asks, change_s = vehicle.asks, abs(vehicle.level_m - layer_m) / CLIMB_SPEED_M_S
        if asks is None or asks.place.distance_to(vehicle.position) > OVER_PAD_M:
            return False
        holds = asks.low_m - OFF_LAYER_M <= layer_m <= asks.high_m + OFF_LAYER_M
        return holds and vehicle.leased_until_s >= self.state.t_s + MIN_LEASE_FACTOR * change_s

    def ask_for_column(
        self, vehicle: VehicleState, layer_m: float
    ) -> tuple[VehicleState, bool | None]:
        """Request the air from here to a layer; return the vehicle with its request, and an answer.

        It is True if granted, None while it waits, False if a member cannot be asked or does not
        answer within `MAX_LEASE_WAIT_S`.
        """
        if self.has_column(vehicle, layer_m):
            return vehicle, True
        t_s, asks = self.state.t_s, vehicle.asks
        if asks is not None and (
            asks.place.distance_to(vehicle.position) > OVER_PAD_M
            or vehicle.leased_until_s > -math.inf
            or t_s >= asks.until_s
        ):
            # the wind has moved it, or it was interrupted: that request was for other air, or is
            # too short
            asks = None
        others = (
            v for v in self.state.vehicles.values() if v.vehicle not in self.state.our_numbers
        )
        waited_s = 0.0 if asks is None else t_s - asks.asked_s
        if waited_s > MAX_LEASE_WAIT_S or any(v.phase in _UNCONTROLLED_PHASES for v in others):
            return vehicle, False
        if asks is None:
            low_m, high_m = sorted((vehicle.level_m, layer_m))
            change_s = (high_m - low_m) / CLIMB_SPEED_M_S
            until_s = round(t_s + MAX_LEASE_WAIT_S + 2.0 * MIN_LEASE_FACTOR * change_s, 1)
            asks = Column(vehicle.position, low_m, high_m, t_s, until_s)
            vehicle = replace(vehicle, leased_until_s=-math.inf)  # the old lease was for other air
        return replace(vehicle, asks=asks), None

    def can_promise(self, column: Column) -> bool:
        """Return whether our vehicles can stay out of a column until it is open again. Each either
        stays on the ground, or is under our control and outside the column, with an order that does
        not lead into it."""
        air = needs.column_air(column)
        for ours in self.state.own_vehicles:
            if ours.landed and not isinstance(ours.order, TakeOff):
                continue
            here = replace(needs.hover_air(ours), stray_m=needs.stopping_m(self.state.setting))
            needed = self._needed(ours, ours.order)
            if ours.uncontrolled or self._meet(here, air) or self._meet(needed, air):
                return False
        return True

    def columns_meet(self, one: Column, other: Column) -> bool:
        """Return whether two columns are closer than the separation."""
        return self._meet(needs.column_air(one), needs.column_air(other))
