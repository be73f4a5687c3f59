"""The guardian of one aircraft: it detects that an order is not carried out, and chooses the
response.

    watch(limits, guard, seen) -> (guard, verdict)

Its inputs are the fence, the battery, the last order and the telemetry. It knows nothing of the
journal, the explorer, the camera or the other vehicles, so it continues when they fail. It is pure,
as the reducer is. The driver calls it once or twice a second and carries out its verdicts; tests
call it with a fleet of points.

A verdict climbs a ladder, one rung at a time, until a rung helps:

    report   the mission receives that the order failed, and returns the vehicle
    rtl      the autopilot returns by itself
    land the vehicle lands at its place, before its energy is used up
    crashed  it is already down

The guardian sends no command to a vehicle that a pilot or a failsafe flies (`mode` "other").
"""

from __future__ import annotations

from missions.geo.fence import corners_home
from missions.guardian.guardian_state import Action, Guard, Limits, Mode, Snapshot, Task
from missions.guardian.rules import quick_aim_m, watch
from missions.guardian.thresholds import (
    DOWN_M,
    HARD_LANDING_M_S,
    LOW_CHARGE_S,
    PAD_M,
    QUICK_DESCENT_M_S,
)

__all__ = [
    "DOWN_M",
    "HARD_LANDING_M_S",
    "LOW_CHARGE_S",
    "PAD_M",
    "QUICK_DESCENT_M_S",
    "Action",
    "Guard",
    "Limits",
    "Mode",
    "Snapshot",
    "Task",
    "corners_home",
    "quick_aim_m",
    "watch",
]
