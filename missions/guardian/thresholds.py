"""From when on something is wrong: every figure of the guardian's rules."""

from __future__ import annotations

from typing import Final

LEG_FACTOR: Final = 3.0
LEG_SLACK_S: Final = 20.0
"""A leg may take its estimate so many times, and so long besides."""
NO_PROGRESS_S: Final = 15.0
"""So long a leg may bring the vehicle no nearer to its end."""
PROGRESS_M: Final = 1.0
OFF_PATH_M: Final = 12.0
"""Position control holds a path within 3 m, gusts included; a turn at full speed swings out 6 m."""
OFF_PATH_S: Final = 10.0
OFF_PATH_HOME_S: Final = 5.0
"""A jump of the position estimate is flown back from by the autopilot itself, in some seconds."""
OFF_PLAN_M: Final = 6.0
"""A path that is flown without stopping is followed within a metre, a PX4's corners within 3 m."""
OFF_PLAN_WIND_S: Final = 1.0
"""So long a gust carries a vehicle before it is made up for."""
OFF_PLAN_S: Final = 2.0
BEHIND_S: Final = 10.0
"""Who is where its path had it so long ago at most is late, and flies where it should."""
BEHIND_STEP_S: Final = 0.25
RECEDING_M_S: Final = 2.0
RECEDING_S: Final = 4.0
"""A vehicle that moves away from its goal this fast for so long is carried away."""
UNSEEN_S: Final = 3.0
"""Longest time between two looks over which a movement counts as going on, s."""
SWEPT_M_S: Final = 6.0
SWEPT_SHARE: Final = 1.2
SWEPT_S: Final = 3.0
"""One that is carried away faster than this, and than it flies, can do nothing against it."""
AT_ONCE_S: Final = 1.0
"""In a climb, and where it leaves the fence, so long is enough for that.

A climb goes straight up, and each second more of it is one more to come down.
"""
LEAVES_S: Final = 4.0
"""It leaves the fence if it is outside, or will be after so long: soon after `SWEPT_S`."""
BLOWN_S: Final = 2.0
"""In a wind that the airframe cannot hold, being carried away for so long is enough.

So it is in a landing: to hasten that costs nothing.
"""
HOPELESS: Final = 1.5
"""In so many times the wind that it can hold it lands before it is seen to be carried away."""
OUTSIDE_S: Final = 2.0
RECOVERY_S: Final = 6.0
"""A rung of the ladder has to help within this time."""
HEIGHT_LOST_M: Final = 4.0
HEIGHT_LOST_SHARE: Final = 0.35
HEIGHT_LOST_S: Final = 3.0
DOWN_M: Final = 0.8
DOWN_S: Final = 4.0
DOWN_M_S: Final = 0.7
"""Below this height, no faster than this, for so long: it lies on the ground."""
FALL_M_S: Final = 4.0
"""Nobody descends this fast: it falls."""
HARD_M_S: Final = 2.5
"""Nobody lands this fast: it struck the ground."""
STANDS_S: Final = 20.0
"""Motors that still turn so long after a touch-down will be stopped by nobody but the crew."""
UP_M: Final = 2.0
REACH_M: Final = 5.0
REACH_M_S: Final = 15.0
"""A vehicle is looked for on its path no farther ahead than it can have flown."""
PAD_M: Final = 5.0
"""A landing nearer to its pad than this is a landing at home."""
QUICK_M: Final = 1.0
"""Down to this height over home a vehicle that is carried away descends quickly, and again when it
is so far below home: where it has been carried to the ground is lower."""
QUICK_AIM_M: Final = 2.0
"""It is told to fly so much lower than that: near a target it would slow down."""
HASTE_M_S: Final = 3.0
"""The descent speed that a vehicle is asked for which is carried away; 1.5 m/s is usual.

Faster than that nobody is told from a fall; and an aircraft that moves over ground at 15 m/s breaks
however slowly it comes down, so what counts is how far it gets.
"""
LAST_MARGIN: Final = 1.25
"""Of the energy for landing from here: with less it lands now."""
SPENT_S: Final = 2.5
"""So long the charge must be told to be so low: one wrong message is no empty battery."""
