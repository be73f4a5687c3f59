"""The service: the straight path from what happens to what everybody does.

    frame -> look(frame, grid, detector) -> votes
    step(state, event) -> (state, orders)
    orders -> vehicle.give(order) -> MAVLink

An event is committed to the journal before it is acted on.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from typing import Protocol

from missions.events import Event, Recalled
from missions.orders import Order
from missions.state import Setting, State
from missions.step import step
from uavmap.record.journal import Journal

Observer = Callable[[Event, State], None]


class Vehicle(Protocol):
    """What the service needs of a vehicle."""

    async def run(self, report: Callable[[Event], None]) -> None:
        """Report events and carry out orders until cancelled."""
        ...

    def give(self, order: Order) -> None:
        """Carry out an order instead of the present one."""
        ...


class Service:
    """One mission under way."""

    def __init__(
        self,
        setting: Setting,
        journal: Journal,
        vehicles: Mapping[int, Vehicle],
        state: State,
        observe: Observer,
    ) -> None:
        self.setting = setting
        self.state = state
        self._journal = journal
        self._vehicles = vehicles
        self._observe = observe
        self._over = asyncio.Event()
        self._failure: Exception | None = None

    def post(self, event: Event) -> None:
        """Something happened: commit it, take it in, hand out the orders that follow.

        What goes wrong here ends the flight: most calls come from the event loop itself, which
        would note the error and fly on with an event lost.
        """
        try:
            self._post(event)
        except Exception as failure:
            self._failure = self._failure or failure
            self._over.set()
            raise

    def _post(self, event: Event) -> None:
        self._journal.append(event)
        self.state, orders = step(self.setting, self.state, event)
        for number, order in orders:
            self._vehicles[number].give(order)
        self._observe(event, self.state)
        if self.state.over:
            self._over.set()

    def recall(self) -> None:
        """Call everybody home; the mission can be resumed later."""
        if not self.state.recalled:
            self.post(Recalled(self.state.t_s))

    def stop(self) -> None:
        """End the flight as it is; the journal tells how to go on."""
        self._over.set()

    async def fly(self) -> State:
        """Fly until nobody has anything more to do. Returns the final state."""
        async with asyncio.TaskGroup() as tasks:
            running = [tasks.create_task(v.run(self.post)) for v in self._vehicles.values()]
            await self._over.wait()
            for task in running:
                task.cancel()
        if self._failure is not None:
            raise self._failure
        return self.state
