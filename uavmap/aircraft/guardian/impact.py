"""How hard a vehicle met the ground, by the vertical speed that it tells.

A landing ends at half a metre a second. A vehicle whose motors stop while it is in the air lands,
too, by its own word: it is disarmed, and stands on the ground. Only its speed tells the difference.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Final

REST_M_S: Final = 0.3
"""A vehicle that sinks more slowly does not sink."""
LAST_S: Final = 0.6
"""The end of a descent. Who comes to rest in the air was not fast so shortly before."""
KEPT_S: Final = 5.0
"""So long an impact is remembered: until the motors are off and that is told, and over a bounce."""
GRAVITY_M_S2: Final = 9.80665
LEAST_FALL: Final = 0.3
MOST_FALL: Final = 1.5
"""Shares of gravity with which a free fall gains speed, as its messages tell it."""
FALLS_S: Final = 2.0
"""So long a vehicle that has landed by its own word may fall still: from 20 m."""


class Impact:
    """Takes the vertical speeds of one vehicle, by its own clock.

    A single wrong message is no impact: the second of the greatest speeds counts, and the greatest
    only at the end of a free fall, which three messages in a row show.

    >>> impact = Impact()
    >>> for tenth, sink_m_s in enumerate([0.5, 0.5, 1.5, 2.5, 3.4, 4.4, 0.0]):
    ...     impact.take(tenth / 10, sink_m_s)
    >>> impact.speed_m_s, impact.sinks
    (4.4, False)
    >>> for tenth, sink_m_s in enumerate([0.5, 0.5, 4.4, 0.5, 0.0], start=100):
    ...     impact.take(tenth / 10, sink_m_s)
    >>> impact.speed_m_s
    0.5
    """

    def __init__(self) -> None:
        self.sinks = False
        """Whether it sinks now."""
        self.speed_m_s = 0.0
        """Of the end of its fastest descent in the last `KEPT_S`, in m/s downwards."""
        self._descent: deque[tuple[float, float]] = deque()
        self._rested_s = float("-inf")

    def take(self, t_s: float, sink_m_s: float) -> None:
        """Take in how fast it sinks at a time of its clock, in s and m/s."""
        descent = self._descent
        if descent and t_s < descent[-1][0]:  # its clock began anew
            descent.clear()
            self.speed_m_s = 0.0
        descent.append((t_s, sink_m_s))
        while descent[0][0] < t_s - LAST_S:
            descent.popleft()
        if t_s - self._rested_s > KEPT_S:
            self.speed_m_s = 0.0
        sank, self.sinks = self.sinks, sink_m_s > REST_M_S
        if sank and not self.sinks and len(descent) > 1:
            ended_m_s = sorted(speed for _, speed in descent)[-2]
            if len(descent) > 3 and all(map(_falls, *_last_steps(descent))):
                ended_m_s = max(ended_m_s, descent[-2][1])
            if ended_m_s > self.speed_m_s:
                self.speed_m_s, self._rested_s = ended_m_s, t_s


_Sample = tuple[float, float]


def _last_steps(descent: Sequence[_Sample]) -> tuple[list[_Sample], list[_Sample]]:
    """From and to of the last two steps before it came to rest."""
    last = [descent[-4], descent[-3], descent[-2]]
    return last[:-1], last[1:]


def _falls(one: _Sample, other: _Sample) -> bool:
    """Whether it gained speed as in a free fall, or nearly: some thrust and drag may be left."""
    elapsed_s, gained_m_s = other[0] - one[0], other[1] - one[1]
    most_m_s = GRAVITY_M_S2 * elapsed_s
    return LEAST_FALL * most_m_s <= gained_m_s <= MOST_FALL * most_m_s
