"""Whether a vehicle's time passes as fast as the flight reckons: a wrong `--speedup` is noticed.

All that is reckoned by time, the power drawn first of all, is wrong by the same factor.
"""

from __future__ import annotations

from typing import Final

WINDOW_WALL_S: Final = 10.0
"""Real seconds over which the rates of the two clocks are compared."""
OFF: Final = 1.5
"""A simulator on a busy machine may be slower than it was told to be, but not by so much."""
_SAID_AT: Final = 2


class ClockRate:
    """A vehicle's clock beside the loop's, over windows in seconds of the loop.

    >>> rate = ClockRate(window_s=10.0, speedup=1.0)
    >>> [said for t in range(40) if (said := rate.take(float(t), 3.0 * t))]
    ['its clock runs 3.0 times as fast as this flight reckons; is --speedup 3 meant?']
    """

    def __init__(self, window_s: float, speedup: float) -> None:
        self._window_s = window_s
        self._speedup = speedup
        self._begin: tuple[float, float] | None = None
        """Our time and the vehicle's at the beginning of the window."""
        self._last_s = float("-inf")
        self._wrong = 0
        """How many windows in a row were wrong: the first may hold a change of pace."""

    def take(self, loop_s: float, boot_s: float) -> str:
        """Take in the vehicle's time; what is wrong with its pace, said once until it is right."""
        restarted, self._last_s = boot_s < self._last_s, boot_s
        if self._begin is None or restarted:
            self._begin = (loop_s, boot_s)
            return ""
        span_s = loop_s - self._begin[0]
        if span_s < self._window_s:
            return ""
        rate = (boot_s - self._begin[1]) / span_s
        self._begin = (loop_s, boot_s)
        self._wrong = 0 if 1.0 / OFF < rate < OFF else self._wrong + 1
        if self._wrong != _SAID_AT or rate <= 0.0:  # one that stands still is the gate's to refuse
            return ""
        return (
            f"its clock runs {rate:.1f} times as fast as this flight reckons; is --speedup "
            f"{self._speedup * rate:.2g} meant?"
        )
