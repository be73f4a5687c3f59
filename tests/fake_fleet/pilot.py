"""A pilot who takes a vehicle: flies about, perhaps through the layers of others, and ends it.

By hand, or by his autopilot's own modes LAND and RTL.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from missions.units import GridPoint

from .aircraft import STOP_M, Aircraft

Ending = Literal["release", "land", "keep", "LAND", "RTL"]
LOW_SHARE = 0.25
"""With less of its battery a pilot lands, wherever the vehicle is."""


@dataclass(slots=True)
class Pilot:
    """Flies through points with heights above the vehicle's home, then ends."""

    way: list[tuple[GridPoint, float]]
    ending: Ending
    capacity_wh: float
    keeps_s: float = 20.0
    done: bool = False

    def take(self, craft: Aircraft) -> None:
        """The mode switch turns; the vehicle stops."""
        craft.turn_switch("other")
        if not self.way:
            self._end_by_mode(craft)

    def fly(self, craft: Aircraft, dt_s: float) -> None:
        """One tick at the sticks."""
        if self.done:
            return
        if craft.crashed or not (craft.flying or craft.armed):
            self.done = True
            return
        if craft.wh < LOW_SHARE * self.capacity_wh:
            self.way, self.ending = [], "land"
        if self.way:
            point, height_m = self.way[0]
            craft.target, craft.target_height_m = point, height_m
            near = craft.believed.distance_to(point) <= 2 * STOP_M
            if near and abs(craft.height_m - height_m) < 0.5:
                self.way.pop(0)
            return
        self.keeps_s -= dt_s
        self._end_by_mode(craft)
        if self.ending == "land":
            if craft.target_height_m > -50.0:
                craft.target, craft.target_height_m = craft.believed, -99.0
        elif self.ending == "release" and self.keeps_s <= 0.0:
            craft.give_back()
            self.done = True

    def _end_by_mode(self, craft: Aircraft) -> None:
        if self.ending == "LAND":
            craft.turn_switch("land")
        elif self.ending == "RTL":
            craft.turn_switch("rtl")
        self.done = self.ending in ("LAND", "RTL")
