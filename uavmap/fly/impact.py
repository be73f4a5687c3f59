"""How hard a vehicle met the ground, by the vertical speed that it tells.

A landing ends at half a metre a second. A vehicle whose motors stop while it is in the air lands,
too, by its own word: it is disarmed, and stands on the ground. Only its speed tells the difference.
"""

from __future__ import annotations

from collections import deque
from typing import Final

REST_M_S: Final = 0.3
"""A vehicle that sinks more slowly does not sink."""
LAST_S: Final = 0.6
"""The end of a descent. Who comes to rest in the air was not fast so shortly before."""
KEPT_S: Final = 5.0
"""So long an impact is remembered: until the motors are off and that is told, and over a bounce."""
FALLS_S: Final = 2.0
"""So long a vehicle that has landed by its own word may fall still: from 20 m."""


class Impact:
    """Takes the vertical speeds of one vehicle, by its own clock.

    A single wrong message is no impact: the second of the greatest speeds counts.

    >>> impact = Impact()
    >>> for tenth, sink_m_s in enumerate([0.5, 0.5, 1.5, 2.5, 3.4, 4.4, 0.0]):
    ...     impact.take(tenth / 10, sink_m_s)
    >>> impact.speed_m_s, impact.sinks
    (3.4, False)
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
            if ended_m_s > self.speed_m_s:
                self.speed_m_s, self._rested_s = ended_m_s, t_s
