"""The thresholds of the guardian's rules."""

from __future__ import annotations

from typing import Final

LEG_FACTOR: Final = 3.0
LEG_SLACK_S: Final = 20.0
"""Maximum time of a leg: `LEG_FACTOR` times its estimate plus `LEG_SLACK_S`, s."""
NO_PROGRESS_S: Final = 15.0
"""Maximum time without progress towards the end of a leg, or towards home, s."""
OBEYS_S: Final = 15.0
"""Maximum time until a vehicle obeys a command to land or to return, s."""
PROGRESS_M: Final = 1.0
OFF_PATH_M: Final = 12.0
"""Maximum distance from a path, m; control holds it within 3 m, a turn at full speed within 6 m."""
OFF_PATH_S: Final = 10.0
OFF_PATH_HOME_S: Final = 5.0
"""Maximum time off the path, s; the autopilot corrects a jump of its estimate in some seconds."""
OFF_PLAN_M: Final = 6.0
"""Maximum distance from a planned position, m; paths are held within 1 m, a PX4's corners 3 m."""
OFF_PLAN_WIND_S: Final = 1.0
"""Assumed duration of a gust before the controller compensates, s."""
OFF_PLAN_S: Final = 2.0
BEHIND_S: Final = 10.0
"""Maximum delay of a vehicle that is on its path and late, s."""
BEHIND_STEP_S: Final = 0.25
RECEDING_M_S: Final = 2.0
RECEDING_S: Final = 4.0
"""A vehicle that moves away from its goal at `RECEDING_M_S` for `RECEDING_S` is carried away."""
MAX_CALL_GAP_S: Final = 3.0
"""Maximum time between two calls over which a motion counts as continuous, s."""
CARRIED_AWAY_M_S: Final = 6.0
CARRIED_AWAY_SHARE: Final = 1.2
CARRIED_AWAY_S: Final = 3.0
"""A vehicle carried away faster than `CARRIED_AWAY_M_S`, and than it can fly, has no control."""
QUICK_VERDICT_S: Final = 1.0
"""Time for that verdict in a climb and at the fence, s: a longer climb makes a longer descent."""
FENCE_LOOK_AHEAD_S: Final = 4.0
"""Look-ahead of the prediction that it leaves the fence, s: soon after `CARRIED_AWAY_S`."""
BLOWN_AWAY_S: Final = 2.0
"""Time of being carried away for a verdict in a wind beyond its limit or in a landing, s."""
LAND_AT_ONCE_WIND_FACTOR: Final = 1.5
"""Multiple of its wind limit at which it lands before it is carried away."""
OUTSIDE_S: Final = 2.0
RECOVERY_S: Final = 6.0
"""Time in which a rung of the ladder has to help, s."""
HEIGHT_LOST_M: Final = 4.0
HEIGHT_LOST_SHARE: Final = 0.35
HEIGHT_LOST_S: Final = 3.0
DOWN_M: Final = 0.8
DOWN_S: Final = 4.0
DOWN_M_S: Final = 0.7
"""Below `DOWN_M` and slower than `DOWN_M_S` for `DOWN_S`, a vehicle lies on the ground."""
FALLING_M_S: Final = 4.0
"""Sink rate above which a vehicle is falling, m/s."""
HARD_LANDING_M_S: Final = 2.5
"""Touch-down speed above which a vehicle has struck the ground, m/s."""
MOTORS_OFF_WAIT_S: Final = 20.0
"""Time after a touch-down beyond which only the crew will stop motors that still run, s."""
LANDING_DESCENT_M: Final = 0.5
"""Minimum descent of a landing within `MOTORS_OFF_WAIT_S`, m: autopilots land at >= 0.3 m/s."""
UP_M: Final = 2.0
REACH_M: Final = 5.0
REACH_M_S: Final = 15.0
"""Maximum advance along a path in which a vehicle is searched, m and m/s."""
PAD_M: Final = 5.0
"""Maximum distance from the pad of a landing at home, m."""
QUICK_M: Final = 1.0
"""Height above home from which a vehicle that is carried away descends quickly, m.

It does so again that far below home, where the ground is lower.
"""
QUICK_AIM_M: Final = 2.0
"""Distance of its target below that height, m: it would slow down near a target."""
QUICK_DESCENT_M_S: Final = 3.0
"""Descent rate for a vehicle that is carried away, m/s; the usual one is 1.5.

A faster one looks like a fall. At 15 m/s over ground it breaks anyway, so distance counts.
"""
LANDING_ENERGY_FACTOR: Final = 1.25
"""Multiple of the energy of a landing below which it lands at once."""
LOW_CHARGE_S: Final = 2.5
"""Time for which such a low charge must be reported, s: one wrong message is no empty battery."""
