"""What an event changes in the state."""

from __future__ import annotations

from dataclasses import replace
from functools import singledispatch

from missions.events import (
    Airborne,
    Arrived,
    BatterySwapped,
    Connected,
    Crashed,
    Event,
    FrameLost,
    FrameSeen,
    GivenUp,
    Guarded,
    Landed,
    LiftedOff,
    LinkLost,
    LookEnded,
    OrderFailed,
    Overridden,
    Recalled,
    Released,
    Resumed,
    Tracked,
)
from missions.flight.lane_progress import lane_flown, lane_left
from missions.flight.return_home import BESIDE_M
from missions.flight.sightings import frame_seen, look_ended
from missions.guardian import PAD_M
from missions.orders import AwaitBattery, FlyTo, Land, ReturnToLaunch, StandDown, TakeOff
from missions.state import BRAKING_S, Phase, ReturnReason, Setting, State, VehicleState

_DRAW_SMOOTHING_S = 15.0
LIFTED_M = 1.0
"""A vehicle that is higher above home has left the ground."""
REST_M_S = 0.5
"""A vehicle that is slower has come to rest."""
LEVEL_M = 1.0
"""Homes that differ less in height count as level: satellite navigation is no better."""
MOST_FRAMES_LOST = 5
"""After so many lost pictures in a row the vehicle comes home."""
RETURN_MODES = ("RTL", "SMART_RTL", "RETURN")
MOST_EMPTY_PASSES = 2
"""After so many lanes in a row without a judged frame the vehicle comes home."""


def apply(setting: Setting, state: State, event: Event) -> State:
    """The state after an event, before anybody is given a new order."""
    state = replace(state, t_s=max(state.t_s, event.t_s))
    if isinstance(event, Recalled):
        return replace(state, recalled=True)
    if isinstance(event, Resumed):
        return _resume(setting, state)
    if isinstance(event, FrameSeen):
        return frame_seen(setting, state, event)
    vehicle = state.vehicles[event.vehicle]
    if isinstance(event, LookEnded):
        return look_ended(state, vehicle)
    if isinstance(event, Connected) and state.reference_amsl_m is None:
        state = replace(state, reference_amsl_m=event.home_amsl_m)
    changed = _changed(event, vehicle, setting)
    if isinstance(event, Connected | Airborne):
        changed = _levelled(changed, event, state.reference_amsl_m, setting)
    return state.with_vehicle(changed)


def _levelled(
    vehicle: VehicleState,
    event: Connected | Airborne,
    reference_amsl_m: float | None,
    setting: Setting,
) -> VehicleState:
    """The vehicle with the height of its home above the first home that was told.

    A home that is told in the air keeps its level: what it flies at is above the old one.
    """
    in_air = isinstance(event, Connected) and event.airborne
    if event.home_amsl_m is None or reference_amsl_m is None or (in_air and vehicle.home_level_m):
        return vehicle
    level_m = event.home_amsl_m - reference_amsl_m
    team = setting.mission.team
    # two that are both taken to be level must still keep their distance
    level_enough_m = min(LEVEL_M, 0.5 * (team.layer_m - team.separation_m))
    level = abs(level_m) < level_enough_m
    return replace(vehicle, home_level_m=0.0 if level else round(level_m, 2))


def _resume(setting: Setting, state: State) -> State:
    """Everybody takes part again; what they carried out died with the process."""
    root = state.tree.root if state.tree is not None else None
    vehicles = {
        number: replace(
            lane_left(v, setting.grid.cell_m),
            phase=Phase.OFFLINE,
            order=None,
            last_order=None,
            return_reason=None,
            over_home=False,
            spare_pad=None,
            at_target=False,
            vertex=v.vertex or root,
            cleared=v.phase is not Phase.DOWN,  # perhaps nobody has fetched it
            wind_m_s=0.0,
            frames_lost=0,
            empty_passes=0,
            note="",
        )
        for number, v in state.vehicles.items()
    }
    return replace(state, recalled=False, vehicles=vehicles)


@singledispatch
def _changed(event: Event, vehicle: VehicleState, setting: Setting) -> VehicleState:
    """The vehicle after an event that concerns nothing else."""
    raise TypeError(f"no rule for {type(event).__name__}")


@_changed.register
def _(event: Connected, vehicle: VehicleState, setting: Setting) -> VehicleState:
    phase = Phase.GROUNDED
    if event.airborne:
        phase = Phase.AIRBORNE if event.ours else Phase.YIELDED
    connected = replace(
        lane_left(vehicle, setting.grid.cell_m),
        phase=phase,
        tracked_s=event.t_s,
        home=event.home,
        position=event.position,
        height_m=event.height_m,
        remaining_wh=event.remaining_wh,
        drawn_w=0.0,
        landed=not event.airborne,
        landed_away_m=0.0,
        order=StandDown() if phase is Phase.YIELDED else None,
        last_order=None,
        return_reason=None,
        over_home=False,
        at_target=False,
        braking_until_s=event.t_s + BRAKING_S if phase is Phase.AIRBORNE else None,
        fruitless_sorties=0,
        frames_lost=0,
        returns_by_itself=event.mode == "rtl",
        note="",
    )
    if phase is not Phase.AIRBORNE:
        return _found_on_the_ground(connected, vehicle)
    return _on_its_way_home(connected, event, vehicle)


def _found_on_the_ground(connected: VehicleState, before: VehicleState) -> VehicleState:
    """A vehicle that has flown, and stands away from its pad now, is down there."""
    away_m = connected.position.distance_to(connected.home)
    has_flown = not (before.landed and before.cleared)
    # one that people put elsewhere starts with a new home; one beside a blocked pad is close
    near = away_m <= (BESIDE_M if before.landed else PAD_M)
    if not connected.landed or not has_flown or near:
        return connected
    note = f"it came down {away_m:.0f} m from its pad, and lies there still"
    return replace(connected, phase=Phase.DOWN, order=StandDown(), note=note)


def _on_its_way_home(
    connected: VehicleState, event: Connected, before: VehicleState
) -> VehicleState:
    """A vehicle that was coming home when it fell silent goes on doing so."""
    reason = before.return_reason
    if before.phase is Phase.LOST:  # nobody knows what it has been through
        reason = reason or ReturnReason.BATTERY
    if event.mode == "rtl":
        resumed = reason or (None if before.note else ReturnReason.BATTERY)
        return replace(
            connected,
            phase=Phase.GUARDED,
            order=StandDown(),
            return_reason=resumed,
            note=before.note,
        )
    if event.mode == "land":
        # a resume forgets why; whoever lands at its pad waits there for a battery and the crew
        reason = reason or ReturnReason.BATTERY
        landing = replace(connected, return_reason=reason, over_home=True, order=Land())
        return replace(landing, braking_until_s=None, note=before.note)
    return replace(connected, return_reason=reason)


@_changed.register
def _(event: LiftedOff, vehicle: VehicleState, setting: Setting) -> VehicleState:
    up = replace(vehicle, landed=False, landed_away_m=0.0)
    if vehicle.phase in (Phase.FAILED, Phase.FINISHED, Phase.DOWN):
        # a take-off that nobody acknowledged, and that was given up: it cannot stay up there
        note = vehicle.note or "it left the ground without an order"
        return replace(
            up, phase=Phase.AIRBORNE, order=None, return_reason=ReturnReason.FAULT, note=note
        )
    return up


@_changed.register
def _(event: Airborne, vehicle: VehicleState, setting: Setting) -> VehicleState:
    home = vehicle.home if event.home is None else event.home
    if vehicle.phase is not Phase.GROUNDED:  # somebody else has it by now
        return replace(vehicle, landed=False, cleared=False, home=home)
    return replace(
        vehicle,
        phase=Phase.AIRBORNE,
        home=home,
        height_m=vehicle.cruise_height_m,
        order=None,
        landed=False,
        cleared=False,
    )


@_changed.register
def _(event: Tracked, vehicle: VehicleState, setting: Setting) -> VehicleState:
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
    # (one that was set down elsewhere may stand higher than its home)
    yielded = vehicle.phase is Phase.YIELDED and not vehicle.landed_away_m
    climbing = isinstance(vehicle.order, TakeOff) or yielded
    return replace(
        vehicle,
        landed=vehicle.landed and not (climbing and event.height_m > LIFTED_M),
        tracked_s=event.t_s,
        position=event.position,
        height_m=event.height_m,
        remaining_wh=event.remaining_wh,
        drawn_w=drawn_w,
        wind_m_s=vehicle.wind_m_s if event.wind_m_s is None else event.wind_m_s,
        braking_until_s=braking_until_s,
    )


@_changed.register
def _(event: Arrived, vehicle: VehicleState, setting: Setting) -> VehicleState:
    if vehicle.phase is not Phase.AIRBORNE:  # somebody else has it by now
        return replace(vehicle, position=event.position)
    stopped = isinstance(vehicle.order, FlyTo) and vehicle.order.stop
    passed_s = None if stopped else event.t_s
    arrived = replace(vehicle, position=event.position, order=None, passed_s=passed_s)
    if vehicle.return_reason is not None:
        return replace(arrived, over_home=True)
    near_m = setting.grid.cell_m  # else it got out of somebody's way, and has yet to go there
    cell = vehicle.vertex if vehicle.candidate is None else vehicle.candidate
    if cell is not None:
        target = setting.grid.to_fixed(setting.grid.centre_of(cell), event.t_s)
        return replace(arrived, at_target=event.position.distance_to(target) <= near_m)
    if not vehicle.on_lane:
        lanes = vehicle.lanes
        begun = bool(lanes) and event.position.distance_to(lanes[0][0]) <= near_m
        return replace(arrived, on_lane=begun)
    flown = lane_flown(arrived, setting.grid.cell_m)
    if flown.empty_passes < MOST_EMPTY_PASSES:
        return flown
    note = "the camera is silent: no frame of its lanes was judged"
    return replace(flown, return_reason=ReturnReason.FAULT, note=note)


@_changed.register
def _(event: FrameLost, vehicle: VehicleState, setting: Setting) -> VehicleState:
    lost = replace(vehicle, frames_lost=vehicle.frames_lost + 1, note=event.reason)
    exploring = vehicle.phase is Phase.AIRBORNE and vehicle.return_reason is None
    if lost.frames_lost < MOST_FRAMES_LOST or not exploring:
        return lost
    note = f"{lost.frames_lost} pictures in a row were lost: {event.reason}"
    left = lane_left(lost.interrupted(event.t_s), setting.grid.cell_m)
    return replace(left, return_reason=ReturnReason.FAULT, over_home=False, at_target=False,
                   note=note)  # fmt: skip


@_changed.register
def _(event: Landed, vehicle: VehicleState, setting: Setting) -> VehicleState:
    position = vehicle.position if event.position is None else event.position
    landed = replace(
        lane_left(vehicle, setting.grid.cell_m),
        landed=True,
        braking_until_s=None,
        position=position,
        height_m=0.0,
        remaining_wh=event.remaining_wh,
        over_home=False,
        at_target=False,
        spare_pad=None,
    )
    away_m = position.distance_to(vehicle.pad)
    if vehicle.phase is Phase.YIELDED:
        if away_m <= PAD_M:
            return landed
        # it stays whose it is; but somebody has to know, also where all is explored without it
        note = f"{vehicle.note}; it landed {away_m:.0f} m from its pad"
        return replace(landed, landed_away_m=away_m, note=note)
    if away_m > PAD_M or vehicle.phase is Phase.DOWN:
        away = f"it landed {away_m:.0f} m from its pad"
        note = f"{vehicle.note}; {away}" if vehicle.note else away
        return replace(landed, phase=Phase.DOWN, order=StandDown(), note=note)
    if vehicle.return_reason is ReturnReason.BATTERY:
        return replace(landed, phase=Phase.GROUNDED, order=AwaitBattery())
    if vehicle.return_reason in (ReturnReason.DONE, ReturnReason.RECALLED):
        return replace(landed, phase=Phase.FINISHED, order=StandDown(), vertex=None)
    if vehicle.phase is Phase.GUARDED:
        return replace(landed, phase=Phase.FAILED, order=StandDown())
    note = vehicle.note or "landed unexpectedly (no land command was sent)"
    return replace(landed, phase=Phase.FAILED, order=StandDown(), note=note)


@_changed.register
def _(event: Crashed, vehicle: VehicleState, setting: Setting) -> VehicleState:
    return replace(
        lane_left(vehicle, setting.grid.cell_m),
        phase=Phase.DOWN,
        order=StandDown(),
        position=event.position,
        landed=True,
        return_reason=None,
        over_home=False,
        at_target=False,
        braking_until_s=None,
        note=f"it is down: {event.reason}",
    )


@_changed.register
def _(event: Guarded, vehicle: VehicleState, setting: Setting) -> VehicleState:
    return replace(
        lane_left(vehicle, setting.grid.cell_m),
        phase=Phase.GUARDED,
        order=StandDown(),
        return_reason=None,
        over_home=False,
        at_target=False,
        returns_by_itself=event.action == "rtl",
        note=f"{'landing' if event.action == 'land' else 'returning'} by its guardian: "
        f"{event.reason}",
    )


@_changed.register
def _(event: BatterySwapped, vehicle: VehicleState, setting: Setting) -> VehicleState:
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
def _(event: Overridden, vehicle: VehicleState, setting: Setting) -> VehicleState:
    return replace(
        lane_left(vehicle, setting.grid.cell_m),
        phase=Phase.YIELDED,
        order=StandDown(),
        return_reason=None,
        over_home=False,
        at_target=False,
        returns_by_itself=event.mode.startswith(RETURN_MODES) or "failsafe" in event.mode,
        note=f"yielded to {event.mode}",
    )


@_changed.register
def _(event: Released, vehicle: VehicleState, setting: Setting) -> VehicleState:
    airborne = event.height_m > LIFTED_M or not vehicle.landed
    return replace(
        vehicle,
        phase=Phase.AIRBORNE if airborne else Phase.GROUNDED,
        position=event.position,
        height_m=event.height_m,
        landed=not airborne,
        landed_away_m=0.0,
        order=None,
        braking_until_s=event.t_s + BRAKING_S if airborne else None,
        fruitless_sorties=0,
        frames_lost=0,
        note="",
    )


@_changed.register
def _(event: LinkLost, vehicle: VehicleState, setting: Setting) -> VehicleState:
    if vehicle.phase is Phase.OFFLINE:
        return vehicle
    return replace(
        lane_left(vehicle, setting.grid.cell_m),
        phase=Phase.OFFLINE,
        order=StandDown(),
        last_order=vehicle.order,
        note="link lost",
    )


@_changed.register
def _(event: GivenUp, vehicle: VehicleState, setting: Setting) -> VehicleState:
    return replace(vehicle, phase=Phase.LOST, order=StandDown(), note=event.reason)


@_changed.register
def _(event: OrderFailed, vehicle: VehicleState, setting: Setting) -> VehicleState:
    note = f"{event.order}: {event.reason}"
    if vehicle.phase is Phase.GROUNDED and not vehicle.landed:  # a take-off that failed half-way
        vehicle = replace(vehicle, phase=Phase.AIRBORNE)
    if vehicle.phase is Phase.AIRBORNE and vehicle.return_reason is None:  # it cannot stay there
        home = lane_left(vehicle.interrupted(event.t_s), setting.grid.cell_m)
        return replace(
            home, return_reason=ReturnReason.FAULT, over_home=False, at_target=False, note=note
        )
    if vehicle.phase is Phase.AIRBORNE:
        # not even the way home can be flown: its guardian has the autopilot try, and stays with it
        return replace(
            vehicle,
            phase=Phase.GUARDED,
            order=ReturnToLaunch(),
            return_reason=None,
            returns_by_itself=True,
            note=note,
        )
    if not vehicle.landed:  # somebody else is responsible for it already
        return replace(vehicle, note=note)
    return replace(vehicle, phase=Phase.FAILED, order=StandDown(), note=note)
