"""Who has flown its lanes waits over its pad until those out of contact are back, and have told.

Where a radio does not reach over the box, each member knows after the search what it has seen
itself. Were it to begin to map that, it would be out of contact again before the next is back: each
would map what it knows of, several the same outline, and all come home for the rest. So it waits
over its pad, where everybody comes and is heard, for those who still fly lanes and are due, and for
what they have to tell. Then the one with the lowest number lays out who maps what
(`missions.flight.team.work_shares`), and nobody leaves before that was told: out of contact
everybody keeps to it. Who is late is not waited for, and nobody waits who maps already.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from missions.flight.setting import Setting
from missions.flight.state import Phase, State, VehicleState
from missions.flight.strategy.two_heights import is_over_pad

LATE_S: Final = 45.0
"""So long after it is due somebody is waited for: turns and wind are in no estimate."""
SILENT_S: Final = 5.0
"""Who is heard again has told what it knows when nothing new has come for so long..."""
TELLS_S: Final = 30.0
"""... or after so long."""
TOLD_S: Final = 15.0
"""So much longer who is to map what is waited for."""


def gathers(setting: Setting, state: State, vehicle: VehicleState) -> bool:
    """Whether a vehicle of a fleet without lanes has to hear of others before it does anything."""
    if vehicle.lanes:
        return False
    if setting.heights.in_layer(setting, state, vehicle) and not is_over_pad(vehicle):
        return False  # it maps
    others = [other for number, other in state.vehicles.items() if number != vehicle.vehicle]
    if any(_is_due(state, other) or _tells(state, other) for other in others):
        return True
    return _part_to_come(state, vehicle, others)


def _is_due(state: State, other: VehicleState) -> bool:
    # (what it has seen may be known from a third, long before it is over its pad, and heard itself)
    return other.phase is Phase.APART and state.t_s < other.due_s + LATE_S


def _tells(state: State, other: VehicleState) -> bool:
    if state.t_s >= other.back_s + TELLS_S or other.phase is Phase.APART:
        return False
    return state.t_s < max(other.back_s, state.shared_s) + SILENT_S


def _part_to_come(state: State, vehicle: VehicleState, others: Sequence[VehicleState]) -> bool:
    """Whether somebody is to say what this vehicle maps, and has not since all were back."""
    back_s = max(other.back_s for other in others) if others else -math.inf
    if not back_s <= state.t_s < back_s + TELLS_S + TOLD_S:
        return False
    somebody = any(o.vehicle < vehicle.vehicle and o.works and not o.lanes for o in others)
    found = state.allotment
    told = found is not None and found.made_s >= back_s and vehicle.vehicle in found.parts
    return somebody and not told
