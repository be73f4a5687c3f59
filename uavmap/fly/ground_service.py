"""The service of a ground station that listens to a fleet: it commands by word only.

It flies nothing. What an operator orders here is told to all members, who repeat it, and each has
its own vehicle do it; who is out of contact hears of it later.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from missions.fleet.codec import Order, Word
from uavmap.fly.service import Service


class GroundService(Service):
    """A service without a vehicle, whose orders are words to a fleet."""

    tell_all: Callable[[Word], None] = staticmethod(lambda word: None)
    """How a word is told."""
    _stamp = 0

    def recall(self) -> None:
        """Call everybody home."""
        self._say("recall")

    def pause(self) -> bool:
        """Have everybody hold; False where they do already."""
        return self.flying and not self.state.paused and self._say("pause")

    def go_on(self) -> bool:
        """End a pause; False where there is none."""
        return self.flying and self.state.paused and self._say("continue")

    def recall_vehicle(self, number: int) -> bool:
        """Call one vehicle home. Raises `KeyError` for a number that no vehicle has."""
        return (
            self.flying and self.state.vehicles[number] is not None and self._say("recall", number)
        )

    def skip_cell(self, number: int) -> bool:
        """Not from here: no vehicle of these strategies looks from a cell."""
        return False

    def land_here(self, number: int) -> bool:
        """Not from here: that is for who sees the aircraft."""
        return False

    def _say(self, order: Order, vehicle: int = 0) -> bool:
        self._stamp = max(self._stamp + 1, int(time.time()))
        self.tell_all(Word(self._stamp, vehicle, order))
        return True
