"""The service of a ground station that listens to a fleet: it commands by word only.

It flies nothing. What an operator orders here is sent to all members, who repeat it, and each has
its own vehicle do it; a member out of contact receives it later.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from missions.events import Event
from missions.flight.setting import Setting
from missions.flight.state import State
from missions.orders import Order
from uavmap.fleet.codec import Order as OrderWord
from uavmap.journal.event_log import Journal
from uavmap.runner.service import Observer, Service


class NoAircraft:
    """The aircraft of a service that flies none."""

    def give(self, vehicle: int, order: Order) -> None:
        """Raise `KeyError`."""
        raise KeyError(vehicle)

    def land_here(self, vehicle: int, reason: str) -> None:
        """Raise `KeyError`."""
        raise KeyError(vehicle)


class GroundService(Service):
    """A service without a vehicle, whose orders are words to a fleet; `send` takes them."""

    def __init__(
        self,
        setting: Setting,
        journal: Journal,
        state: State,
        observe: Observer,
        reports: asyncio.Queue[Event],
        send: Callable[[OrderWord, int], None],
    ) -> None:
        super().__init__(setting, journal, NoAircraft(), state, observe, reports)
        self._send = send

    def recall(self) -> None:
        """Call all vehicles home."""
        self._command("recall")

    def pause(self) -> bool:
        """Have all vehicles hold; False where they do already."""
        return self.flying and not self.state.paused and self._command("pause")

    def go_on(self) -> bool:
        """End a pause; False where there is none."""
        return self.flying and self.state.paused and self._command("continue")

    def recall_vehicle(self, number: int) -> bool:
        """Call one vehicle home. Raises `KeyError` for a number that no vehicle has."""
        known = self.flying and self.state.vehicles[number] is not None
        return known and self._command("recall", number)

    def skip_cell(self, number: int) -> bool:
        """Return False: no vehicle of these strategies observes from a cell."""
        return False

    def land_here(self, number: int) -> bool:
        """Return False: only an operator who sees the aircraft lands it."""
        return False

    def _command(self, order: OrderWord, vehicle: int = 0) -> bool:
        self._send(order, vehicle)
        return True
