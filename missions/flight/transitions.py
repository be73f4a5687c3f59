"""The change of the state by each event."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Final

from missions import events as ev
from missions.fleet_events import OfVehicle
from missions.flight import connections
from missions.flight.connections import LIFT_OFF_M, control_lost
from missions.flight.lane_progress import lane_flown, lane_left, set_free
from missions.flight.operator_orders import finish_skipped_cells, skip, stop_all, vehicle_recalled
from missions.flight.sightings import follow_no_farther, frame_seen, look_ended
from missions.flight.state import Setting, State
from missions.flight.team import members
from missions.flight.vehicle_state import OFF_LAYER_M, Phase, ReturnReason, VehicleState
from missions.guardian import PAD_M, corners_home
from missions.orders import AwaitBattery, FlyTo, StandDown, TakeOff


def landed(event: ev.Landed, vehicle: VehicleState, setting: Setting) -> VehicleState:
    """Return a vehicle after a landing; away from its pad, the crew has to fetch it."""
    position = vehicle.position if event.position is None else event.position
    down = replace(
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
            return down
        # the crew has to know, also if all is explored without it
        note = f"{vehicle.note}; it landed {away_m:.0f} m from its pad"
        return replace(down, landed_away_m=away_m, note=note)
    if away_m > PAD_M or vehicle.phase is Phase.DOWN:
        away = f"it landed {away_m:.0f} m from its pad"
        note = f"{vehicle.note}; {away}" if vehicle.note else away
        return down.stood_down(Phase.DOWN, note)
    if vehicle.return_reason in (ReturnReason.BATTERY, ReturnReason.TRAFFIC):
        return replace(down, phase=Phase.GROUNDED, order=AwaitBattery())
    if vehicle.return_reason in (ReturnReason.DONE, ReturnReason.RECALLED):
        return replace(down, phase=Phase.FINISHED, order=StandDown(), vertex=None)
    if vehicle.phase is Phase.GUARDED:
        return down.stood_down(Phase.FAILED, vehicle.note)
    if not setting.team.knows_orders:
        return replace(down, phase=Phase.GROUNDED)
    unexpected = "landed unexpectedly (no land command was sent)"
    return down.stood_down(Phase.FAILED, vehicle.note or unexpected)


def crashed(event: ev.Crashed, vehicle: VehicleState, setting: Setting) -> VehicleState:
    """Return a vehicle after a crash: it is down, wherever it is."""
    return replace(
        set_free(vehicle, setting.grid.cell_m),
        phase=Phase.DOWN,
        order=StandDown(),
        position=event.position,
        landed=True,
        braking_until_s=None,
        note=f"it is down: {event.reason}",
    )


_DRAW_SMOOTHING_S = 15.0
REST_M_S = 0.5
"""Speed below which a vehicle is at rest, m/s."""
MAX_FRAMES_LOST = 5
"""Number of lost pictures in a row after which a vehicle returns."""
MIN_PICTURE_GAP_S = 10.0
"""Minimum time without a picture on a path before that return, s."""
MAX_REPORT_GAP_S = 25.0
"""Time without any report on pictures before that return, besides two camera intervals, s."""
MAX_RETURN_ATTEMPTS = 2
"""Number of attempts at the return path before the autopilot returns by itself."""
MAX_RETURN_ATTEMPTS_AROUND_HOLE = 10
"""The same if the straight return leads over a hole of the fence: about 15 s."""
MAX_CONTINUATIONS_BEHIND = 3
"""Number of times in a row that a vehicle behind its path continues from its place."""
BEHIND_S = 30.0
"""Maximum time between two such events, s."""
BESIDE_PAD_M = 5.0
"""Distance to its pad beyond which a vehicle has flown only a part of its return, m."""
MAX_EMPTY_LANES = 2
"""Number of lanes in a row without a judged frame after which a vehicle returns."""


def _lifted_off(event: ev.LiftedOff, vehicle: VehicleState, setting: Setting) -> VehicleState:
    up = replace(vehicle, landed=False, landed_away_m=0.0, was_down=False)
    waits = vehicle.phase is Phase.GROUNDED and not isinstance(vehicle.order, TakeOff)
    if waits or vehicle.phase in (Phase.FAILED, Phase.FINISHED, Phase.DOWN):
        # by a process that was killed, or given up without an acknowledgement: it lands again
        up = replace(up, phase=Phase.AIRBORNE, order=None, return_reason=ReturnReason.FAULT)
        return replace(up, note=vehicle.note or "it left the ground without an order")
    return up


def _airborne(event: ev.Airborne, vehicle: VehicleState, setting: Setting) -> VehicleState:
    home = vehicle.home if event.home is None else event.home
    if vehicle.phase is not Phase.GROUNDED:  # it is no longer under our control
        return replace(vehicle, landed=False, cleared=False, home=home)
    return replace(
        vehicle,
        phase=Phase.AIRBORNE,
        home=home,
        height_m=vehicle.cruise_height_m,
        order=None,
        landed=False,
        cleared=False,
        home_refused=0,
    )


def _tracked(event: ev.Tracked, vehicle: VehicleState, setting: Setting) -> VehicleState:
    elapsed_s = event.t_s - vehicle.tracked_s
    if vehicle.braking_until_s is not None:
        slow = vehicle.position.distance_to(event.position) < REST_M_S * elapsed_s
        if slow or event.t_s >= vehicle.braking_until_s:
            vehicle = replace(vehicle, braking_until_s=None)
    used_wh = vehicle.remaining_wh - event.remaining_wh
    drawn_w = vehicle.drawn_w
    known = vehicle.remaining_wh > 0.0 and event.remaining_wh > 0.0
    # rises count as well: falls of a noisy estimate alone are no consumption
    if not vehicle.landed and elapsed_s > 0.0 and known:
        weight = min(elapsed_s / _DRAW_SMOOTHING_S, 1.0)
        drawn_w += weight * (used_wh * 3600.0 / elapsed_s - drawn_w)
    # An interrupted take-off leaves the vehicle in the air. Of another member's take-off only its
    # report counts: a PX4 on its pad may report 1 m and more.
    climbing = isinstance(vehicle.order, TakeOff)
    silent_s = event.t_s - vehicle.judged_s
    if vehicle.path is not None and vehicle.works and silent_s >= _nothing_s(setting):
        note = "the camera is silent: no picture of its path was judged"
        vehicle = _comes_home(vehicle, event.t_s, setting, note)
    return replace(
        vehicle,
        landed=vehicle.landed and not (climbing and event.height_m > LIFT_OFF_M),
        tracked_s=event.t_s,
        position=event.position,
        height_m=event.height_m,
        remaining_wh=event.remaining_wh,
        drawn_w=drawn_w,
        wind_m_s=vehicle.wind_m_s if event.wind_m_s is None else event.wind_m_s,
    )


def _arrived(event: ev.Arrived, vehicle: VehicleState, setting: Setting) -> VehicleState:
    if vehicle.phase is not Phase.AIRBORNE:  # it is no longer under our control
        return replace(vehicle, position=event.position)
    on_path = vehicle.path is not None
    leg = vehicle.order if isinstance(vehicle.order, FlyTo) else None
    stopped = on_path or (leg is not None and leg.stop)
    passed_s = None if stopped else event.t_s
    arrived = replace(vehicle, position=event.position, order=None, passed_s=passed_s)
    if leg is not None and leg.stop and abs(vehicle.height_m - leg.height_m) > OFF_LAYER_M:
        # the report of that height may come later
        arrived = replace(arrived, height_m=leg.height_m)
    if vehicle.return_reason is not None:
        # the rest of the return path may have been reserved by another
        part = leg is not None and leg.route[-1].distance_to(vehicle.pad) > BESIDE_PAD_M
        return replace(arrived, over_home=not part)
    if on_path and not vehicle.on_lane:
        return arrived
    near_m = setting.grid.cell_m  # farther away it has only made way, and still has to fly there
    cell = vehicle.vertex if vehicle.candidate is None else vehicle.candidate
    if cell is not None:
        away_m = event.position.distance_to(setting.where(cell, event.t_s))
        return replace(arrived, at_target=away_m <= near_m)
    if not vehicle.on_lane:
        here, lanes = setting.to_lanes(event.position, event.t_s), vehicle.lanes
        begun = bool(lanes) and here.distance_to(lanes[0][0]) <= near_m
        return replace(arrived, on_lane=begun)
    flown = lane_flown(arrived, setting.grid.cell_m)
    if flown.empty_lanes < MAX_EMPTY_LANES:
        return flown
    note = "the camera is silent: no frame of its lanes was judged"
    if event.t_s - vehicle.judged_s < MIN_PICTURE_GAP_S:
        note = "its frames do not show the rows of its lanes: it leans, or is blown off them"
    return replace(flown, return_reason=ReturnReason.FAULT, note=note)


def _frame_lost(event: ev.FrameLost, vehicle: VehicleState, setting: Setting) -> VehicleState:
    lost = replace(vehicle, frames_lost=vehicle.frames_lost + 1, note=event.reason)
    # an observation has that many frames, seconds apart; on a path several are lost in a second, or
    # one in several
    silent_s, on_path = event.t_s - vehicle.judged_s, vehicle.path is not None
    soon = on_path and silent_s < MIN_PICTURE_GAP_S
    nothing = on_path and silent_s >= _nothing_s(setting)
    if not vehicle.works or soon or (lost.frames_lost < MAX_FRAMES_LOST and not nothing):
        return lost
    note = f"{lost.frames_lost} pictures in a row were lost: {event.reason}"
    return _comes_home(lost, event.t_s, setting, note)


def _nothing_s(setting: Setting) -> float:
    """Return the maximum time without a report of a camera on a path, s."""
    return MAX_REPORT_GAP_S + 2.0 * setting.mission.camera.interval_s


def _comes_home(vehicle: VehicleState, t_s: float, setting: Setting, note: str) -> VehicleState:
    """Have a vehicle that cannot continue drop its task, and take no further part."""
    left = set_free(vehicle.interrupted(t_s), setting.grid.cell_m)
    return replace(left, return_reason=ReturnReason.FAULT, note=note)


def _guarded(event: ev.Guarded, vehicle: VehicleState, setting: Setting) -> VehicleState:
    does = "landing" if event.action == "land" else "returning"
    note = f"{does} by its guardian: {event.reason}"
    return control_lost(vehicle, setting, Phase.GUARDED, note, returns=event.action == "rtl")


def _battery_swapped(
    event: ev.BatterySwapped, vehicle: VehicleState, setting: Setting
) -> VehicleState:
    if vehicle.phase is not Phase.GROUNDED:  # no reason to take off
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


def _order_failed(event: ev.OrderFailed, vehicle: VehicleState, setting: Setting) -> VehicleState:
    note = f"{event.order}: {event.reason}"
    if vehicle.phase is Phase.GROUNDED and not vehicle.landed:  # a take-off that failed half-way
        vehicle = replace(vehicle, phase=Phase.AIRBORNE)
    if vehicle.works and event.behind:
        soon = event.t_s - vehicle.behind_s < BEHIND_S
        vehicle = replace(vehicle, behind=vehicle.behind * soon + 1, behind_s=event.t_s)
        if vehicle.behind <= MAX_CONTINUATIONS_BEHIND:
            return lane_left(vehicle.interrupted(event.t_s), setting.grid.cell_m)
    if vehicle.works:  # it cannot stay there
        return _comes_home(vehicle, event.t_s, setting, note)
    around = bool(corners_home(setting.fence, vehicle.position, vehicle.home))
    most_refused = MAX_RETURN_ATTEMPTS_AROUND_HOLE if around else MAX_RETURN_ATTEMPTS
    if vehicle.phase is Phase.AIRBORNE and vehicle.home_refused < most_refused:
        # a path of ours stays inside the fence; an autopilot's return is straight
        again = replace(vehicle.interrupted(event.t_s), over_home=False, note=note)
        return replace(again, home_refused=vehicle.home_refused + 1)
    if vehicle.phase is Phase.AIRBORNE:
        # no return path can be flown: its guardian has the autopilot return, and keeps watching
        return vehicle.left_to_autopilot(note)
    if not vehicle.landed:  # a pilot or a failsafe has control already
        return replace(vehicle, note=note)
    return vehicle.stood_down(Phase.FAILED, note)


_OF_ALL: Final[Mapping[type, Callable[[State, Any], State]]] = {
    ev.Recalled: lambda state, event: replace(state, recalled=True, paused=False),
    ev.Paused: lambda state, event: stop_all(replace(state, paused=True)),
    ev.Continued: lambda state, _: replace(state, paused=False, traffic=state.traffic.ignoring()),
    ev.TrafficSeen: lambda state, event: replace(
        state, traffic=state.traffic.with_tracks(event.tracks)
    ),
    ev.Resumed: lambda state, event: connections.resume(state),
    ev.FrameSeen: lambda state, event: finish_skipped_cells(frame_seen(state, event)),
    ev.LookEnded: lambda state, event: finish_skipped_cells(look_ended(state, event)),
    ev.CellSkipped: skip,
    **members.ON_EVENT,
}
"""Rules for events that change more than one vehicle, or more than vehicles."""

_OF_ONE: Final[Mapping[type, Callable[[Any, VehicleState, Setting], VehicleState]]] = {
    ev.Connected: connections.connected,
    ev.LinkLost: connections.link_lost,
    ev.GivenUp: lambda event, vehicle, setting: vehicle.stood_down(Phase.LOST, event.reason),
    ev.Overridden: connections.overridden,
    ev.Released: connections.released,
    ev.Landed: landed,
    ev.Crashed: crashed,
    ev.VehicleRecalled: vehicle_recalled,
    ev.LiftedOff: _lifted_off,
    ev.Airborne: _airborne,
    ev.Tracked: _tracked,
    ev.Arrived: _arrived,
    ev.FrameLost: _frame_lost,
    ev.Guarded: _guarded,
    # the corrected places are in other events
    ev.Navigated: lambda event, vehicle, setting: vehicle,
    ev.BatterySwapped: _battery_swapped,
    ev.OrderFailed: _order_failed,
}
"""Rules for events that concern one vehicle and nothing else."""


def apply(state: State, event: ev.Event) -> State:
    """Return the state after an event, before any vehicle is given a new order."""
    state = replace(state, t_s=max(state.t_s, event.t_s))
    if (rule := _OF_ALL.get(type(event))) is not None:
        return rule(state, event)
    assert isinstance(event, OfVehicle)
    changed = _OF_ONE[type(event)](event, state.vehicles[event.vehicle], state.setting)
    state = state.with_vehicle(changed)
    return follow_no_farther(state, changed) if isinstance(event, ev.Tracked) else state
