"""What an event changes in the state."""

from __future__ import annotations

from dataclasses import replace
from functools import singledispatch

from missions.events import (
    Airborne,
    Arrived,
    BatterySwapped,
    Connected,
    Event,
    FrameLost,
    FrameSeen,
    Landed,
    LinkLost,
    LookEnded,
    OrderFailed,
    Overridden,
    Recalled,
    Released,
    Resumed,
    Tracked,
)
from missions.flight.sightings import frame_seen, look_ended
from missions.orders import AwaitBattery, ReturnToLaunch, StandDown, TakeOff
from missions.state import BRAKING_S, Phase, ReturnReason, Setting, State, VehicleState

_DRAW_SMOOTHING_S = 15.0
LIFTED_M = 1.0
"""A vehicle that is higher above home has left the ground."""
REST_M_S = 0.5
"""A vehicle that is slower has come to rest."""


def apply(setting: Setting, state: State, event: Event) -> State:
    """The state after an event, before anybody is given a new order."""
    state = replace(state, t_s=max(state.t_s, event.t_s))
    if isinstance(event, Recalled):
        return replace(state, recalled=True)
    if isinstance(event, Resumed):
        return _resume(state)
    if isinstance(event, FrameSeen):
        return frame_seen(setting, state, event)
    vehicle = state.vehicles[event.vehicle]
    if isinstance(event, LookEnded):
        return look_ended(state, vehicle)
    return state.with_vehicle(_changed(event, vehicle))


def _resume(state: State) -> State:
    """Everybody takes part again; what they carried out died with the process."""
    root = state.tree.root if state.tree is not None else None
    vehicles = {
        number: replace(
            v,
            phase=Phase.OFFLINE,
            order=None,
            return_reason=None,
            over_home=False,
            at_target=False,
            vertex=v.vertex or root,
            cleared=True,
            note="",
        )
        for number, v in state.vehicles.items()
    }
    return replace(state, recalled=False, vehicles=vehicles)


@singledispatch
def _changed(event: Event, vehicle: VehicleState) -> VehicleState:
    """The vehicle after an event that concerns nothing else."""
    raise TypeError(f"no rule for {type(event).__name__}")


@_changed.register
def _(event: Connected, vehicle: VehicleState) -> VehicleState:
    phase = Phase.GROUNDED
    if event.airborne:
        phase = Phase.AIRBORNE if event.ours else Phase.YIELDED
    return replace(
        vehicle,
        phase=phase,
        tracked_s=event.t_s,
        home=event.home,
        position=event.position,
        height_m=event.height_m,
        remaining_wh=event.remaining_wh,
        drawn_w=0.0,
        landed=not event.airborne,
        order=StandDown() if phase is Phase.YIELDED else None,
        return_reason=None,
        over_home=False,
        on_lane=False,
        at_target=False,
        braking_until_s=event.t_s + BRAKING_S if phase is Phase.AIRBORNE else None,
        fruitless_sorties=0,
        note="",
    )


@_changed.register
def _(event: Airborne, vehicle: VehicleState) -> VehicleState:
    if vehicle.phase is not Phase.GROUNDED:  # somebody else has it by now
        return replace(vehicle, landed=False, cleared=False)
    return replace(
        vehicle,
        phase=Phase.AIRBORNE,
        height_m=vehicle.cruise_altitude_m,
        order=None,
        landed=False,
        cleared=False,
    )


@_changed.register
def _(event: Tracked, vehicle: VehicleState) -> VehicleState:
    elapsed_s = event.t_s - vehicle.tracked_s
    braking_until_s = vehicle.braking_until_s
    if braking_until_s is not None:
        slow = vehicle.position.distance_to(event.position) < REST_M_S * elapsed_s
        if slow or event.t_s >= braking_until_s:
            braking_until_s = None
    used_wh = vehicle.remaining_wh - event.remaining_wh
    drawn_w = vehicle.drawn_w
    if not vehicle.landed and elapsed_s > 0.0 and used_wh >= 0.0:
        weight = min(elapsed_s / _DRAW_SMOOTHING_S, 1.0)
        drawn_w += weight * (used_wh * 3600.0 / elapsed_s - drawn_w)
    # a take-off that is interrupted on its way leaves the vehicle in the air
    climbing = isinstance(vehicle.order, TakeOff) or vehicle.phase is Phase.YIELDED
    return replace(
        vehicle,
        landed=vehicle.landed and not (climbing and event.height_m > LIFTED_M),
        tracked_s=event.t_s,
        position=event.position,
        height_m=event.height_m,
        remaining_wh=event.remaining_wh,
        drawn_w=drawn_w,
        braking_until_s=braking_until_s,
    )


@_changed.register
def _(event: Arrived, vehicle: VehicleState) -> VehicleState:
    if vehicle.phase is not Phase.AIRBORNE:  # somebody else has it by now
        return replace(vehicle, position=event.position)
    arrived = replace(vehicle, position=event.position, order=None)
    if vehicle.return_reason is not None:
        return replace(arrived, over_home=True)
    if vehicle.candidate is not None or vehicle.vertex is not None:
        return replace(arrived, at_target=True)
    if vehicle.on_lane:
        return replace(arrived, lanes=vehicle.lanes[1:], on_lane=False, fruitless_sorties=0)
    return replace(arrived, on_lane=bool(vehicle.lanes))


@_changed.register
def _(event: FrameLost, vehicle: VehicleState) -> VehicleState:
    return replace(vehicle, note=event.reason)


@_changed.register
def _(event: Landed, vehicle: VehicleState) -> VehicleState:
    landed = replace(
        vehicle,
        landed=True,
        braking_until_s=None,
        height_m=0.0,
        remaining_wh=event.remaining_wh,
        over_home=False,
        at_target=False,
        on_lane=False,
    )
    if vehicle.phase is Phase.YIELDED:
        return landed
    if vehicle.return_reason is ReturnReason.BATTERY:
        return replace(landed, phase=Phase.GROUNDED, order=AwaitBattery())
    if vehicle.return_reason in (ReturnReason.DONE, ReturnReason.RECALLED):
        return replace(landed, phase=Phase.FINISHED, order=StandDown(), vertex=None)
    note = vehicle.note or "landed unexpectedly (no land command was sent)"
    return replace(landed, phase=Phase.FAILED, order=StandDown(), note=note)


@_changed.register
def _(event: BatterySwapped, vehicle: VehicleState) -> VehicleState:
    if vehicle.phase is not Phase.GROUNDED:  # it does not follow us: no reason to take off
        return replace(vehicle, remaining_wh=event.remaining_wh, drawn_w=0.0)
    return replace(
        vehicle,
        phase=Phase.GROUNDED,
        remaining_wh=event.remaining_wh,
        drawn_w=0.0,
        order=None,
        return_reason=None,
        cleared=True,
    )


@_changed.register
def _(event: Overridden, vehicle: VehicleState) -> VehicleState:
    return replace(
        vehicle,
        phase=Phase.YIELDED,
        order=StandDown(),
        return_reason=None,
        over_home=False,
        at_target=False,
        on_lane=False,
        note=f"yielded to {event.mode}",
    )


@_changed.register
def _(event: Released, vehicle: VehicleState) -> VehicleState:
    airborne = event.height_m > LIFTED_M
    return replace(
        vehicle,
        phase=Phase.AIRBORNE if airborne else Phase.GROUNDED,
        position=event.position,
        height_m=event.height_m,
        landed=not airborne,
        order=None,
        braking_until_s=event.t_s + BRAKING_S if airborne else None,
        fruitless_sorties=0,
        note="",
    )


@_changed.register
def _(event: LinkLost, vehicle: VehicleState) -> VehicleState:
    return replace(vehicle, phase=Phase.OFFLINE, order=StandDown(), note="link lost")


@_changed.register
def _(event: OrderFailed, vehicle: VehicleState) -> VehicleState:
    note = f"{event.order}: {event.reason}"
    if vehicle.phase is Phase.AIRBORNE and vehicle.return_reason is None:  # it cannot stay up there
        home = replace(vehicle.interrupted(event.t_s), return_reason=ReturnReason.FAULT, note=note)
        return replace(home, over_home=False, at_target=False, on_lane=False)
    if vehicle.phase is Phase.AIRBORNE and not isinstance(vehicle.order, ReturnToLaunch):
        # not even the way home can be flown: the last thing to try is the autopilot's own
        return replace(vehicle, return_reason=ReturnReason.FAULT, order=ReturnToLaunch(), note=note)
    return replace(vehicle, phase=Phase.FAILED, order=StandDown(), note=note)
