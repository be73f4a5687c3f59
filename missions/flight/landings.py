"""What the end of a sortie means: a landing at the pad or elsewhere, a crash."""

from __future__ import annotations

from dataclasses import replace

from missions.events import Crashed, Landed
from missions.flight.lane_progress import lane_left
from missions.flight.setting import Setting
from missions.flight.state import Phase, ReturnReason, VehicleState
from missions.guardian import PAD_M
from missions.orders import AwaitBattery, StandDown


def landed(event: Landed, vehicle: VehicleState, setting: Setting) -> VehicleState:
    """A landing: at its pad it is over, elsewhere somebody has to fetch the vehicle."""
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
        # it stays whose it is; but somebody has to know, also where all is explored without it
        note = f"{vehicle.note}; it landed {away_m:.0f} m from its pad"
        return replace(down, landed_away_m=away_m, note=note)
    if away_m > PAD_M or vehicle.phase is Phase.DOWN:
        away = f"it landed {away_m:.0f} m from its pad"
        note = f"{vehicle.note}; {away}" if vehicle.note else away
        return replace(down, phase=Phase.DOWN, order=StandDown(), note=note)
    if vehicle.return_reason is ReturnReason.BATTERY:
        return replace(down, phase=Phase.GROUNDED, order=AwaitBattery())
    if vehicle.return_reason in (ReturnReason.DONE, ReturnReason.RECALLED):
        return replace(down, phase=Phase.FINISHED, order=StandDown(), vertex=None)
    if vehicle.phase is Phase.GUARDED:
        return replace(down, phase=Phase.FAILED, order=StandDown())
    if setting.member == 0:  # who only knows does not know what it was told to do
        return replace(down, phase=Phase.GROUNDED)
    note = vehicle.note or "landed unexpectedly (no land command was sent)"
    return replace(down, phase=Phase.FAILED, order=StandDown(), note=note)


def crashed(event: Crashed, vehicle: VehicleState, setting: Setting) -> VehicleState:
    """A crash: it is down, wherever that is."""
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
