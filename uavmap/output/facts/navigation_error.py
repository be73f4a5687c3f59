"""How well a vehicle knew where it was, from the events of its flight."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from missions.events import Event, Landed, Navigated


@dataclass(slots=True)
class NavigationLog:
    """What one vehicle went by; times are mission seconds.

    >>> from missions.units import GridPoint
    >>> log = NavigationLog()
    >>> log.take(Navigated(1, 60.0, "lost", sigma_m=0.4, off_m=GridPoint(0.0, 0.0)))
    >>> log.take(Navigated(1, 90.0, "lost", sigma_m=0.6, off_m=GridPoint(3.0, 4.0)))
    >>> log.take(Landed(1, 100.0, 30.0))
    >>> log.figures()["lost_s"], log.figures()["off_m"], log.figures()["sigma_m"]
    (40.0, 5.0, 0.6)
    """

    noticed_s: float | None = None
    """When satellites were lost, or found to be wrong, first."""
    lost_s: float = 0.0
    wrong_s: float = 0.0
    off_m: float | None = None
    """The largest error of the told position, by the vehicle's own pictures."""
    sigma_m: float | None = None
    """The largest standard deviation of what it went by instead."""
    _gnss: str = "good"
    _since_s: float = 0.0
    _times: dict[str, float] = field(default_factory=dict)

    def take(self, event: Event) -> None:
        """Take in an event of this vehicle; others than changes and landings say nothing."""
        if isinstance(event, Landed):
            self._pass(event.t_s)
        if not isinstance(event, Navigated):
            return
        self._pass(event.t_s)
        self._gnss = event.gnss
        if event.gnss != "good" and self.noticed_s is None:
            self.noticed_s = event.t_s
        if event.off_m is not None:
            self.off_m = max(self.off_m or 0.0, math.hypot(*event.off_m))
        if event.sigma_m is not None:
            self.sigma_m = max(self.sigma_m or 0.0, event.sigma_m)

    def _pass(self, t_s: float) -> None:
        passed_s = max(t_s - self._since_s, 0.0)
        if self._gnss == "lost":
            self.lost_s += passed_s
        elif self._gnss == "wrong":
            self.wrong_s += passed_s
        self._since_s = t_s

    def figures(self) -> dict[str, Any]:
        """For summary.json; empty where satellites were good all the time."""
        if self.noticed_s is None:
            return {}
        return {
            "noticed_s": self.noticed_s,
            "lost_s": round(self.lost_s, 1),
            "wrong_s": round(self.wrong_s, 1),
            "off_m": None if self.off_m is None else round(self.off_m, 2),
            "sigma_m": self.sigma_m,
        }


def in_words(figures: Mapping[str, Any]) -> str:
    """A line of a report from the figures of one vehicle.

    >>> told = {"noticed_s": 138.7, "lost_s": 90.0, "wrong_s": 0.0, "off_m": 0.8, "sigma_m": 0.9}
    >>> in_words(told)[49:]
    'the told place was off by up to 0.8 m, and its own map told it to ±0.9 m (1 sigma) or better'
    >>> in_words({"noticed_s": 60.0, "lost_s": 0, "wrong_s": 20.0, "off_m": None, "sigma_m": None})
    'satellites were wrong for 20 s, noticed at 60 s'
    """
    what = " and ".join(
        f"{word} for {figures[key]:.0f} s"
        for word, key in (("lost", "lost_s"), ("wrong", "wrong_s"))
        if figures[key]
    )
    text = f"satellites were {what or 'lost'}, noticed at {figures['noticed_s']:.0f} s"
    if figures["off_m"] is None or figures["sigma_m"] is None:
        return text
    return (
        f"{text}; the told place was off by up to {figures['off_m']:.1f} m, and its own map told "
        f"it to ±{figures['sigma_m']:.1f} m (1 sigma) or better"
    )
