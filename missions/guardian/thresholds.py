"""From when on something is wrong: every figure of the guardian's rules."""

from __future__ import annotations

from typing import Final

LEG_FACTOR: Final = 3.0
LEG_SLACK_S: Final = 20.0
"""Maximum time of a leg, in estimates (`LEG_FACTOR`) and besides, s."""
NO_PROGRESS_S: Final = 15.0
"""Time for which a leg may bring the vehicle no nearer to its end, s."""
PROGRESS_M: Final = 1.0
OFF_PATH_M: Final = 12.0
"""Position control holds a path within 3 m, gusts included; a turn at full speed swings out 6 m."""
OFF_PATH_S: Final = 10.0
OFF_PATH_HOME_S: Final = 5.0
"""A jump of the position estimate is flown back from by the autopilot itself, in some seconds."""
OFF_PLAN_M: Final = 6.0
"""A path that is flown without stopping is followed within a metre, a PX4's corners within 3 m."""
OFF_PLAN_WIND_S: Final = 1.0
"""Time for which a gust carries a vehicle before it is made up for, s."""
OFF_PLAN_S: Final = 2.0
BEHIND_S: Final = 10.0
"""Maximum delay of a vehicle that is on its path and late, s."""
BEHIND_STEP_S: Final = 0.25
RECEDING_M_S: Final = 2.0
RECEDING_S: Final = 4.0
"""A vehicle that moves away from its goal this fast for this time is carried away."""
UNSEEN_S: Final = 3.0
"""Longest time between two looks over which a movement counts as going on, s."""
SWEPT_M_S: Final = 6.0
SWEPT_SHARE: Final = 1.2
SWEPT_S: Final = 3.0
"""One that is carried away faster than this, and than it flies, can do nothing against it."""
AT_ONCE_S: Final = 1.0
"""Time for that in a climb, which goes straight up, and where it leaves the fence, s: each second
more of a climb is one more to come down."""
LEAVES_S: Final = 4.0
"""It leaves the fence if it is outside, or will be after this time: soon after `SWEPT_S`."""
BLOWN_S: Final = 2.0
"""Time of being carried away that is enough in a wind that the airframe cannot hold, and in a
landing, which costs nothing to hasten, s."""
HOPELESS: Final = 1.5
"""Multiple of the wind that it can hold in which it lands before it is carried away."""
OUTSIDE_S: Final = 2.0
RECOVERY_S: Final = 6.0
"""A rung of the ladder has to help within this time."""
HEIGHT_LOST_M: Final = 4.0
HEIGHT_LOST_SHARE: Final = 0.35
HEIGHT_LOST_S: Final = 3.0
DOWN_M: Final = 0.8
DOWN_S: Final = 4.0
DOWN_M_S: Final = 0.7
"""Below this height, no faster than this, for this time: it lies on the ground."""
FALL_M_S: Final = 4.0
"""Nobody descends this fast: it falls."""
HARD_M_S: Final = 2.5
"""Nobody lands this fast: it struck the ground."""
STANDS_S: Final = 20.0
"""Time after a touch-down beyond which only the crew will stop motors that still turn, s."""
SINKS_M: Final = 0.5
"""Height that a landing loses within `STANDS_S` while the vehicle is in the air, m: autopilots
land at 0.3 m/s or faster."""
UP_M: Final = 2.0
REACH_M: Final = 5.0
REACH_M_S: Final = 15.0
"""A vehicle is looked for on its path no farther ahead than it can have flown."""
PAD_M: Final = 5.0
"""A landing nearer to its pad than this is a landing at home."""
QUICK_M: Final = 1.0
"""Height over home above which a vehicle that is carried away descends quickly, and again so far
below home: where it was carried to the ground is lower."""
QUICK_AIM_M: Final = 2.0
"""How much lower than that the target is: near a target it would slow down."""
HASTE_M_S: Final = 3.0
"""Descent speed that is commanded to a vehicle which is carried away, m/s; 1.5 is usual. Faster
looks like a fall; at 15 m/s over ground it breaks anyhow, so distance counts."""
LAST_MARGIN: Final = 1.25
"""Of the energy for landing from here: with less it lands now."""
SPENT_S: Final = 2.5
"""Time for which the charge must be reported so low: one wrong message is no empty battery."""
