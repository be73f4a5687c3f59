"""The guardian of one aircraft: notices that what should happen does not, and says what must.

    watch(limits, guard, seen) -> (guard, verdict)

It knows the fence, the battery, what the vehicle was told last, and what its telemetry says; not
the journal, the explorer, the camera or the other vehicles. So it goes on when they fail. Pure,
as the reducer is: the driver feeds it once or twice a second and carries out its verdicts, and the
tests feed it from a fleet of points.

A verdict climbs a ladder, one rung at a time, and stops where it helps:

    report   the mission is told that the order failed, and brings the vehicle home
    rtl      the autopilot brings it home by itself
    land     it lands where it is, before its energy is gone
    crashed  it is down already

Nothing is done to a vehicle that a pilot or a failsafe flies (`mode` "other").
"""

from __future__ import annotations

from missions.geo.fence import corners_home
from missions.guardian.guardian_state import Action, Guard, Limits, Mode, Seen, Task
from missions.guardian.rules import quick_aim_m, watch
from missions.guardian.thresholds import DOWN_M, HARD_M_S, HASTE_M_S, PAD_M, SPENT_S

__all__ = [
    "DOWN_M",
    "HARD_M_S",
    "HASTE_M_S",
    "PAD_M",
    "SPENT_S",
    "Action",
    "Guard",
    "Limits",
    "Mode",
    "Seen",
    "Task",
    "corners_home",
    "quick_aim_m",
    "watch",
]
