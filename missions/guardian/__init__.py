"""The guardian of one aircraft: notices that what should happen does not, and says what must.

    watch(limits, guard, seen) -> (guard, verdict)

It knows the fence, the battery, what the vehicle was told last, and what its telemetry says; not
the journal, the explorer, the camera or the other vehicles. So it goes on when they fail. Pure,
as the reducer is: the driver feeds it about once a second and carries out its verdicts, and the
tests feed it from a fleet of points.

A verdict climbs a ladder, one rung at a time, and stops where it helps:

    report   the mission is told that the order failed, and brings the vehicle home
    rtl      the autopilot brings it home by itself
    land     it lands where it is, before its energy is gone
    crashed  it is down already

Nothing is done to a vehicle that a pilot or a failsafe flies (`mode` "other").
"""

from __future__ import annotations

from missions.guardian.rules import landing_wh, quick_aim_m, watch
from missions.guardian.thresholds import (
    AT_ONCE_S,
    BLOWN_S,
    DOWN_M,
    DOWN_M_S,
    DOWN_S,
    FALL_M_S,
    HARD_M_S,
    HEIGHT_LOST_M,
    HEIGHT_LOST_S,
    HEIGHT_LOST_SHARE,
    HOPELESS,
    LAST_MARGIN,
    LEAVES_S,
    LEG_FACTOR,
    LEG_SLACK_S,
    NO_PROGRESS_S,
    OFF_PATH_HOME_S,
    OFF_PATH_M,
    OFF_PATH_S,
    OFF_PLAN_M,
    OFF_PLAN_S,
    OFF_PLAN_WIND_S,
    OUTSIDE_S,
    PAD_M,
    PROGRESS_M,
    QUICK_AIM_M,
    QUICK_M,
    REACH_M,
    REACH_M_S,
    RECEDING_M_S,
    RECEDING_S,
    RECOVERY_S,
    SPENT_S,
    STANDS_S,
    SWEPT_M_S,
    SWEPT_S,
    SWEPT_SHARE,
    UP_M,
)
from missions.guardian.values import Action, Doing, Guard, Limits, Mode, Seen, Task, Verdict

__all__ = [
    "AT_ONCE_S",
    "BLOWN_S",
    "DOWN_M",
    "DOWN_M_S",
    "DOWN_S",
    "FALL_M_S",
    "HARD_M_S",
    "HEIGHT_LOST_M",
    "HEIGHT_LOST_S",
    "HEIGHT_LOST_SHARE",
    "HOPELESS",
    "LAST_MARGIN",
    "LEAVES_S",
    "LEG_FACTOR",
    "LEG_SLACK_S",
    "NO_PROGRESS_S",
    "OFF_PATH_HOME_S",
    "OFF_PATH_M",
    "OFF_PATH_S",
    "OFF_PLAN_M",
    "OFF_PLAN_S",
    "OFF_PLAN_WIND_S",
    "OUTSIDE_S",
    "PAD_M",
    "PROGRESS_M",
    "QUICK_AIM_M",
    "QUICK_M",
    "REACH_M",
    "REACH_M_S",
    "RECEDING_M_S",
    "RECEDING_S",
    "RECOVERY_S",
    "SPENT_S",
    "STANDS_S",
    "SWEPT_M_S",
    "SWEPT_S",
    "SWEPT_SHARE",
    "UP_M",
    "Action",
    "Doing",
    "Guard",
    "Limits",
    "Mode",
    "Seen",
    "Task",
    "Verdict",
    "landing_wh",
    "quick_aim_m",
    "watch",
]
