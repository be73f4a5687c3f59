"""Whether a frame of a stream is there when it should be, or one of a backlog.

After a stall of the network a stream delivers what has piled up, frame upon frame. Such frames are
of an earlier moment, and would be put where the vehicle is by now.
"""

from __future__ import annotations

from typing import Final

SHORTEST_STALL_S: Final = 0.3
STALL_SPACINGS: Final = 4.0
"""A stall is so many usual spacings, and at least that long."""
BURST_SHARE: Final = 0.5
"""Frames that follow each other faster than at this share of the usual spacing have piled up."""
LONGEST_S: Final = 3.0
"""After so long a backlog is over, whatever the spacing."""
_SHARE: Final = 0.1


class Freshness:
    """Looks at when frames were there.

    >>> times = [0.0, 0.1, 0.2, 1.5, 1.51, 1.52, 1.6, 1.7]
    >>> watch = Freshness()
    >>> [t_s for t_s in times if watch.fresh(t_s)]
    [0.0, 0.1, 0.2, 1.6, 1.7]
    """

    def __init__(self) -> None:
        self._last_s: float | None = None
        self._usual_s: float | None = None
        self._stalled_s: float | None = None
        """When the backlog began to come, None while there is none."""

    def fresh(self, there_s: float) -> bool:
        """Take note of a frame; whether it is of now."""
        last_s, self._last_s = self._last_s, there_s
        if last_s is None:
            return True
        gap_s = there_s - last_s
        if self._usual_s is None:
            self._usual_s = gap_s
            return True
        if gap_s > max(SHORTEST_STALL_S, STALL_SPACINGS * self._usual_s):
            self._stalled_s = there_s
            return False
        if self._stalled_s is not None:
            piled_up = gap_s < BURST_SHARE * self._usual_s
            if piled_up and there_s - self._stalled_s < LONGEST_S:
                return False
            self._stalled_s = None
        self._usual_s += _SHARE * (gap_s - self._usual_s)
        return True
