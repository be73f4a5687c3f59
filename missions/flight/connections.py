"""Who has a vehicle, and whether it can be told anything: links, pilots, a resumed mission."""

from __future__ import annotations

from dataclasses import replace

from missions.events import Connected, GivenUp, LinkLost, Overridden, Released
from missions.flight.lane_progress import lane_left, set_free
from missions.flight.return_home import BESIDE_M
from missions.flight.setting import Setting
from missions.flight.state import BRAKING_S, Phase, ReturnReason, State, VehicleState
from missions.guardian import PAD_M
from missions.mission.energy import FRESH
from missions.orders import Land, StandDown, TakeOff

RETURN_MODES = ("RTL", "SMART_RTL", "RETURN")
LIFTED_M = 1.0
"""A vehicle that is higher above home has left the ground."""
GAINED = 0.05
"""A battery that was swapped holds so much more of its capacity than the one before."""


def resume(setting: Setting, state: State) -> State:
    """Everybody takes part again; what they carried out died with the process."""
    root = state.tree.root if state.tree is not None else None
    vehicles = {
        number: replace(v, phase=Phase.APART, order=None, on_lane=False)
        if number not in state.our_numbers
        else replace(
            set_free(v, setting.grid.cell_m),
            phase=Phase.OFFLINE,
            order=None,
            last_order=None,
            spare_pad=None,
            vertex=v.vertex or root,
            cleared=v.phase is not Phase.DOWN and not v.was_down,
            was_down=_lies_somewhere(v),  # perhaps nobody has fetched it
            wind_m_s=0.0,
            frames_lost=0,
            empty_passes=0,
            called_home=False,
            note=v.note if v.was_down or v.phase is Phase.DOWN else "",
        )
        for number, v in state.vehicles.items()
    }
    return replace(state, recalled=False, paused=False, vehicles=vehicles)


def _lies_somewhere(vehicle: VehicleState) -> bool:
    """Whether it fell, or was set down away from its pad."""
    return vehicle.was_down or vehicle.phase is Phase.DOWN or bool(vehicle.landed_away_m)


def connected(event: Connected, vehicle: VehicleState, setting: Setting) -> VehicleState:
    """A vehicle has answered, for the first time or again."""
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
    return _on_its_way_home(taken_up, event, vehicle)


def _has_new_battery(found: VehicleState, before: VehicleState, setting: Setting) -> bool:
    """Whether people have put a fresh battery in."""
    capacity_wh = setting.energy.capacity_wh
    gained_wh = found.remaining_wh - before.remaining_wh
    return found.remaining_wh >= FRESH * capacity_wh and gained_wh >= GAINED * capacity_wh


def _found_on_the_ground(
    connected: VehicleState, before: VehicleState, setting: Setting
) -> VehicleState:
    """A vehicle that has flown, and stands away from its pad now, is down there; so is one that
    fell onto its pad, until somebody has given it a fresh battery."""
    away_m = connected.position.distance_to(connected.home)
    has_flown = before.was_down or not (before.landed and before.cleared)
    # one that people put elsewhere starts with a new home; one beside a blocked pad is close
    beside_m = BESIDE_M if before.landed and not before.was_down else PAD_M
    if not connected.landed or not has_flown:
        return connected
    fell = before.was_down and not before.landed_away_m
    lies_there = fell and connected.position.distance_to(before.position) <= PAD_M
    if away_m > beside_m:
        note = f"it came down {away_m:.0f} m from its pad, and lies there still"
    elif lies_there and not _has_new_battery(connected, before, setting):
        note = "it fell on its pad, and nobody has given it a fresh battery since"
    else:
        # an autopilot takes the place where it lies for its home
        moved = connected.position.distance_to(before.home) > beside_m
        return replace(connected, cleared=connected.cleared and not moved)
    return connected.stood_down(Phase.DOWN, note)


def _on_its_way_home(
    connected: VehicleState, event: Connected, before: VehicleState
) -> VehicleState:
    """A vehicle that was coming home when it fell silent goes on doing so."""
    reason = before.return_reason
    if before.phase is Phase.LOST:  # nobody knows what it has been through
        reason = reason or ReturnReason.BATTERY
    if event.mode == "rtl":
        resumed = reason or (None if before.note else ReturnReason.BATTERY)
        guarded = connected.stood_down(Phase.GUARDED, before.note)
        return replace(guarded, return_reason=resumed)
    if event.mode == "land":
        # a resume forgets why; whoever lands at its pad waits there for a battery and the crew
        reason = reason or ReturnReason.BATTERY
        landing = replace(connected, return_reason=reason, over_home=True, order=Land())
        return replace(landing, braking_until_s=None, note=before.note)
    return replace(connected, return_reason=reason)


def link_lost(event: LinkLost, vehicle: VehicleState, setting: Setting) -> VehicleState:
    """It is silent: what it carries out is remembered, for its air stays reserved.

    From the order to take off it counts as in the air, until it is heard on the ground.
    """
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


def given_up(event: GivenUp, vehicle: VehicleState, setting: Setting) -> VehicleState:
    """It has been silent for too long."""
    return vehicle.stood_down(Phase.LOST, event.reason)


def overridden(event: Overridden, vehicle: VehicleState, setting: Setting) -> VehicleState:
    """A pilot or a failsafe has it: nothing more is sent to it."""
    returns = event.mode.startswith(RETURN_MODES) or "failsafe" in event.mode
    note = f"yielded to {event.mode}" + (f": {event.cause}" if event.cause else "")
    return taken_away(vehicle, setting, Phase.YIELDED, note, returns=returns)


def taken_away(
    vehicle: VehicleState, setting: Setting, phase: Phase, note: str, *, returns: bool
) -> VehicleState:
    """Somebody else flies it, who may have its autopilot return (`returns`)."""
    return replace(
        set_free(vehicle, setting.grid.cell_m),
        phase=phase,
        order=StandDown(),
        returns_by_itself=returns,
        note=note,
    )


def released(event: Released, vehicle: VehicleState, setting: Setting) -> VehicleState:
    """It was given back; one that lies where it fell still lies there."""
    if vehicle.phase is Phase.DOWN:
        return vehicle
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
