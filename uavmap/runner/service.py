"""The service: from what happens to what every vehicle does.

    frame -> look(frame, grid, detector) -> votes
    step(state, event) -> (state, orders)
    orders -> aircraft.give(vehicle, order) -> MAVLink

Reports wait in a queue and are taken in one at a time. An event is in the journal before it has an
effect. A line for the operator is information, not an effect: it is shown when the event arrives.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable, Sequence
from typing import Final, Protocol

from missions.errors import EventError
from missions.events import CellSkipped, Continued, Event, Paused, Recalled, VehicleRecalled
from missions.flight.state import State
from missions.flight.step import step
from missions.flight.vehicle_state import Phase
from missions.orders import Order
from uavmap.fleet.codec import Order as OrderWord
from uavmap.journal.event_log import Journal

Observer = Callable[[Event, State], None]
_LOG: Final = logging.getLogger("uavmap.flight")


class Aircraft(Protocol):
    """What the service needs of its vehicles."""

    def give(self, vehicle: int, order: Order) -> None:
        """Have a vehicle carry out an order instead of the present one."""
        ...

    def land_here(self, vehicle: int, reason: str) -> None:
        """Have a vehicle land where it is, by its autopilot."""
        ...


class Reports(asyncio.Queue[Event]):
    """Events on their way to a service; `notice` sees each of them arrive."""

    def __init__(self, notice: Sequence[Callable[[Event], None]] = ()) -> None:
        super().__init__()
        self._notice = notice

    def post(self, event: Event) -> None:
        """Add an event."""
        for notice in self._notice:
            notice(event)
        self.put_nowait(event)


class Service:
    """One mission under way; `reports` is given where others report before there is a service."""

    def __init__(
        self,
        journal: Journal,
        aircraft: Aircraft,
        state: State,
        observe: Observer,
        reports: Reports | None = None,
    ) -> None:
        self.setting = state.setting
        self.state = state
        self._journal = journal
        self._aircraft = aircraft
        self._observe = observe
        self.refused = 0
        """How many reports no journal can hold."""
        self._reports = reports or Reports()
        self._over = asyncio.Event()
        self._recalled = self._flying = False
        self._failure: Exception | None = None
        self._unkept: Event | None = None
        """The report at which the journal failed."""

    def post(self, event: Event) -> None:
        """Report an event: it is taken in after all that were reported before it."""
        self._reports.post(event)

    async def _take_in(self) -> None:
        """Take in reports, in order; a failure ends the mission, for no event may be lost."""
        while True:
            event = await self._reports.get()
            try:
                self._post(event)
            except Exception as failure:
                self._failure = failure
                self._over.set()
                return
            finally:
                if self._unkept is None:
                    self._reports.task_done()

    def _post(self, event: Event) -> None:
        try:
            self._journal.append(event)
        except EventError as refused:  # a report that makes no sense changes nothing
            self._refuse(str(refused))
            return
        except Exception:
            self._unkept = event
            raise
        self.state, orders = step(self.state, event)
        for number, order in orders:
            self._aircraft.give(number, order)
        self._observe(event, self.state)
        if self.state.over:
            self._over.set()

    def keep_last_words(self) -> None:
        """Commit what was reported after the end, for a resume; nothing acts on it any more.

        Guardians go on until all vehicles are down. A report that the journal refused before is
        tried again: a disk may have room. Never raises: it logs what cannot be kept.
        """
        while self._unkept is not None or not self._reports.empty():
            self._unkept = self._unkept or self._reports.get_nowait()
            try:
                self._journal.append(self._unkept)
            except EventError as refused:
                self._refuse(str(refused))
            except Exception as failure:
                with contextlib.suppress(Exception):  # a terminal may be gone, too
                    _LOG.info(
                        "what the aircraft told after the mission's end is not in the journal "
                        f"({failure}): look at each of them before you resume"
                    )
                return
            self._unkept = None
            self._reports.task_done()

    def _refuse(self, reason: str) -> None:
        self.refused += 1
        if self.refused == 1:
            _LOG.info(f"a report was refused: {reason}")

    @property
    def flying(self) -> bool:
        """Whether reports are taken in: the vehicles have answered, and it is not over."""
        return self._flying and not self.ended

    @property
    def begun(self) -> bool:
        """Whether the vehicles have answered once."""
        return self._flying

    @property
    def ended(self) -> bool:
        """Whether nothing is taken in any more."""
        return self._over.is_set()

    def recall(self) -> None:
        """Call everybody home; the mission can be resumed later."""
        if not self._recalled:
            self._recalled = True
            self.post(Recalled(self.state.t_s))

    # --- the operator's hand ---------------------------------------------------------------------
    def pause(self) -> bool:
        """Have everybody hold; False where they do already, or nobody flies."""
        if not self.flying or self.state.paused:
            return False
        self.post(Paused(self.state.t_s))
        return True

    def go_on(self) -> bool:
        """End a pause, or a hold for traffic that is known; False where there is none."""
        if not self.flying or not self.state.held:
            return False
        self.post(Continued(self.state.t_s))
        return True

    def recall_vehicle(self, number: int) -> bool:
        """Call one vehicle home, to stay there until a resume; False where it is called already.
        Raises `KeyError` for a number that no vehicle has."""
        if not self.flying or self.state.vehicles[number].called_home:
            return False
        self.post(VehicleRecalled(number, self.state.t_s))
        return True

    def skip_cell(self, number: int) -> bool:
        """Skip the observation point that a vehicle is at, or on its way to.

        False where there is none: in lanes, on paths without a stop, on the ground. Raises
        `KeyError` as `recall_vehicle`.
        """
        strategy = self.state.setting.strategy.in_force(self.state)
        cell = strategy.to_skip(self.state, self.state.vehicles[number])
        if not self.flying or cell is None:
            return False
        self.post(CellSkipped(number, self.state.t_s, cell))
        return True

    def land_here(self, number: int) -> bool:
        """Have a vehicle land where it is, by its autopilot; False without control of it. Raises
        `KeyError` as `recall_vehicle`."""
        vehicle = self.state.vehicles[number]
        if not self.flying or vehicle.landed or vehicle.phase in (Phase.YIELDED, Phase.LOST):
            return False
        self._aircraft.land_here(number, "the operator wants it down")
        return True

    def stop(self) -> None:
        """End the flight as it is; the journal tells how to go on."""
        self._over.set()

    async def fly(self) -> State:
        """Fly until nobody has anything more to do. Returns the final state."""
        self._flying = True
        async with asyncio.TaskGroup() as tasks:
            taking_in = tasks.create_task(self._take_in())
            await self._over.wait()
            taking_in.cancel()
        if self._failure is not None:
            raise self._failure
        return self.state


class GroundService(Service):
    """A service without a vehicle, whose orders are words to a fleet; `send` takes them."""

    def __init__(
        self,
        journal: Journal,
        aircraft: Aircraft,
        state: State,
        observe: Observer,
        reports: Reports,
        send: Callable[[OrderWord, int], None],
    ) -> None:
        super().__init__(journal, aircraft, state, observe, reports)
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
