"""Vehicles that can be commanded: links, pilots, failsafes, a resumed mission."""

from __future__ import annotations

from dataclasses import replace

from missions.events import Connected, LinkLost, Overridden, Released
from missions.flight.lane_progress import lane_left, set_free
from missions.flight.return_home import LANDING_BESIDE_M
from missions.flight.state import Setting, State
from missions.flight.vehicle_state import BRAKING_S, Phase, ReturnReason, VehicleState
from missions.guardian import PAD_M
from missions.mission.energy import FRESH
from missions.orders import Land, StandDown, TakeOff

RETURN_MODES = ("RTL", "SMART_RTL", "RETURN")
LIFT_OFF_M = 1.0
"""Height above home beyond which a vehicle has left the ground, m."""
MIN_CHARGE_GAIN = 0.05
"""Minimum gain of charge that counts as a battery swap, share of the capacity."""


def resume(state: State) -> State:
    """Return the state in which all vehicles take part again, without the old process's orders."""
    root = state.tree.root if state.tree is not None else None
    vehicles = {
        number: replace(v, phase=Phase.APART, order=None, on_lane=False)
        if number not in state.our_numbers
        else replace(
            set_free(v, state.setting.grid.cell_m),
            phase=Phase.OFFLINE,
            order=None,
            last_order=None,
            spare_pad=None,
            vertex=v.vertex or root,
            cleared=v.phase is not Phase.DOWN and not v.was_down,
            was_down=_lies_somewhere(v),  # it may still lie there
            wind_m_s=0.0,
            frames_lost=0,
            empty_lanes=0,
            called_home=False,
            note=v.note if v.was_down or v.phase is Phase.DOWN else "",
        )
        for number, v in state.vehicles.items()
    }
    return replace(state, recalled=False, paused=False, vehicles=vehicles)


def _lies_somewhere(vehicle: VehicleState) -> bool:
    """Return whether it fell, or landed away from its pad."""
    return vehicle.was_down or vehicle.phase is Phase.DOWN or bool(vehicle.landed_away_m)


def connected(event: Connected, vehicle: VehicleState, setting: Setting) -> VehicleState:
    """Return a vehicle that is connected or reconnected."""
    phase = Phase.GROUNDED
    if event.airborne:
        phase = Phase.AIRBORNE if event.ours else Phase.YIELDED
    taken_up = replace(
        set_free(vehicle, setting.grid.cell_m),
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
        braking_until_s=event.t_s + BRAKING_S if phase is Phase.AIRBORNE else None,
        fruitless_sorties=0,
        frames_lost=0,
        was_down=False,
        returns_by_itself=event.mode == "rtl",
        note="",
    )
    if phase is not Phase.AIRBORNE:
        return _found_on_the_ground(taken_up, vehicle, setting)
    return _continue_return(taken_up, event, vehicle)


def _found_on_the_ground(
    connected: VehicleState, before: VehicleState, setting: Setting
) -> VehicleState:
    """Return a vehicle found on the ground: it is down if it has flown and is away from its pad. A
    vehicle that fell onto its pad is down until it has a fresh battery."""
    away_m = connected.position.distance_to(connected.home)
    has_flown = before.was_down or not (before.landed and before.cleared)
    # a vehicle that people have moved starts with a new home; one beside a blocked pad is close
    beside_m = LANDING_BESIDE_M if before.landed and not before.was_down else PAD_M
    if not connected.landed or not has_flown:
        return connected
    fell = before.was_down and not before.landed_away_m
    lies_there = fell and connected.position.distance_to(before.position) <= PAD_M
    capacity_wh, charge_wh = setting.energy.capacity_wh, connected.remaining_wh
    gained = charge_wh - before.remaining_wh >= MIN_CHARGE_GAIN * capacity_wh
    if away_m > beside_m:
        note = f"it came down {away_m:.0f} m from its pad, and is still there"
    elif lies_there and not (gained and charge_wh >= FRESH * capacity_wh):
        note = "it fell on its pad, and its battery has not been replaced since"
    else:
        # an autopilot takes the place where the vehicle lies for its home
        moved = connected.position.distance_to(before.home) > beside_m
        return replace(connected, cleared=connected.cleared and not moved)
    return connected.stood_down(Phase.DOWN, note)


def _continue_return(
    connected: VehicleState, event: Connected, before: VehicleState
) -> VehicleState:
    """Return a vehicle that continues the return that it had begun when its link was lost."""
    reason = before.return_reason
    if before.phase is Phase.LOST:
        reason = reason or ReturnReason.BATTERY
    if event.mode == "rtl":
        resumed = reason or (None if before.note else ReturnReason.BATTERY)
        guarded = connected.stood_down(Phase.GUARDED, before.note)
        return replace(guarded, return_reason=resumed)
    if event.mode == "land":
        # a resume forgets the reason; a vehicle that lands at its pad waits there for a battery
        reason = reason or ReturnReason.BATTERY
        landing = replace(connected, return_reason=reason, over_home=True, order=Land())
        return replace(landing, braking_until_s=None, note=before.note)
    return replace(connected, return_reason=reason)


def link_lost(event: LinkLost, vehicle: VehicleState, setting: Setting) -> VehicleState:
    """Return the vehicle without a link; it keeps its last order, whose air stays reserved. From
    its take-off order on it counts as airborne, until it reports from the ground."""
    if vehicle.phase is Phase.OFFLINE:
        return vehicle
    return replace(
        lane_left(vehicle, setting.grid.cell_m),
        phase=Phase.OFFLINE,
        order=StandDown(),
        last_order=vehicle.order,
        landed=vehicle.landed and not isinstance(vehicle.order, TakeOff),
        was_down=_lies_somewhere(vehicle),
        note="link lost",
    )


def overridden(event: Overridden, vehicle: VehicleState, setting: Setting) -> VehicleState:
    """Return the vehicle that a pilot or a failsafe flies; no command is sent to it."""
    returns = event.mode.startswith(RETURN_MODES) or "failsafe" in event.mode
    note = f"yielded to {event.mode}" + (f": {event.cause}" if event.cause else "")
    return control_lost(vehicle, setting, Phase.YIELDED, note, returns=returns)


def control_lost(
    vehicle: VehicleState, setting: Setting, phase: Phase, note: str, *, returns: bool
) -> VehicleState:
    """Return the vehicle that a pilot, a failsafe or its guardian flies. `returns` means that its
    autopilot flies it home. A change of mode does not clear "down"."""
    was_down = vehicle.was_down or vehicle.phase is Phase.DOWN
    return replace(
        set_free(vehicle, setting.grid.cell_m),
        phase=phase,
        order=StandDown(),
        returns_by_itself=returns,
        was_down=was_down,
        note=f"it is down, and {note}" if was_down else note,
    )


def released(event: Released, vehicle: VehicleState, setting: Setting) -> VehicleState:
    """Return the vehicle that is back under our control; one that fell is still down."""
    if vehicle.phase is Phase.DOWN:
        return vehicle
    if vehicle.was_down:
        return vehicle.stood_down(Phase.DOWN, vehicle.note)
    airborne = event.height_m > LIFT_OFF_M or not vehicle.landed
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
