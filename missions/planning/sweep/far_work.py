"""What it costs to leave work undone that is far away: never less than to go there.

A plan may leave a cell of work for what `penalty_s` says. Where the way to it and back takes longer
than that, every plan would leave it, and so would the one after: a region of a few hundred metres
would never be finished. So the penalty is never less than the detour.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from missions.planning.sweep.chart import Chart
from missions.planning.sweep.planned_team import Flyer, Tuning, Valued

_TIMES: Final = 1.2
"""A detour takes longer than straight lines at full speed do, by turns and by speeding up, ..."""
_TURN_S: Final = 5.0
"""... and so much besides."""


def worth_the_way(tuning: Tuning, chart: Chart, team: Sequence[Flyer], valued: Valued) -> Valued:
    """What frames are worth, with each work cell worth the way of the vehicle that is nearest.

    Nothing changes where the least detour takes less than (penalty_s - 5 s) / 1.2; `valued` is
    left as it is.
    """
    worth, need, cells, work = valued
    mine = cells[:work]
    x = (mine % chart.columns + chart.west) * chart.cell_m
    y = (mine // chart.columns + chart.south) * chart.cell_m
    least_s = np.full(work, np.inf)
    for flyer in team:
        (here_x, here_y), (end_x, end_y) = flyer.place, flyer.end
        way_m = np.hypot(x - here_x, y - here_y) + np.hypot(x - end_x, y - end_y)
        way_m -= math.hypot(end_x - here_x, end_y - here_y)
        np.minimum(least_s, way_m / flyer.kinematics.speed_m_s, out=least_s)
    worth = worth.copy()
    worth[mine] *= np.maximum(1.0, (_TIMES * least_s + _TURN_S) / tuning.penalty_s)
    return worth, need, cells, work
