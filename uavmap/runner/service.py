"""The service: from events to the orders of every vehicle.

    frame -> judge_frame(frame, grid, detector) -> votes
    step(state, event) -> (state, orders)
    orders -> aircraft.give(vehicle, order) -> MAVLink

Reports wait in a queue and are handled one at a time. An event is in the journal before it has an
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
    """The interface of the service's vehicles."""

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
        """Number of reports that no journal can hold."""
        self._reports = reports or Reports()
        self._over = asyncio.Event()
        self._recalled = self._flying = False
        self._failure: Exception | None = None
        self._unkept: Event | None = None
        """Report at which the journal failed."""

    def post(self, event: Event) -> None:
        """Add a report: it is handled after all earlier ones."""
        self._reports.post(event)

    async def _take_in(self) -> None:
        """Handle reports, in order; a failure ends the mission, for no event may be lost."""
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
        except EventError as refused:  # a report without a valid value changes nothing
            self._refuse(str(refused))
            return
        except Exception:
            self._unkept = event
            raise
        self.state, orders = step(self.state, event)
        for number, order in orders:
            self._aircraft.give(number, order)
        self._observe(event, self.state)
        if self.state.is_over:
            self._over.set()

    def flush_pending_events(self) -> None:
        """Commit reports from after the end, for a resume; they have no effect any more.

        Guardians continue until all vehicles are down. A report that the journal refused before is
        tried again: a disk may have room. Never raises: it logs a failure.
        """
        while self._unkept is not None or not self._reports.empty():
            self._unkept = self._unkept or self._reports.get_nowait()
            try:
                self._journal.append(self._unkept)
            except EventError as refused:
                self._refuse(str(refused))
            except Exception as failure:
                with contextlib.suppress(Exception):  # the terminal may be gone as well
                    _LOG.info(
                        "messages received after the mission's end are not in the journal "
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
        """True while reports are handled: the vehicles have answered, and it is not over."""
        return self._flying and not self.ended

    @property
    def begun(self) -> bool:
        """True once the vehicles have answered."""
        return self._flying

    @property
    def ended(self) -> bool:
        """True once reports are no longer handled."""
        return self._over.is_set()

    def recall(self) -> None:
        """Recall all vehicles; the mission can be resumed later."""
        if not self._recalled:
            self._recalled = True
            self.post(Recalled(self.state.t_s))

    # --- the operator's hand ---------------------------------------------------------------------
    def pause(self) -> bool:
        """Have all vehicles hold; False if they do already, or none flies."""
        if not self.flying or self.state.paused:
            return False
        self.post(Paused(self.state.t_s))
        return True

    def go_on(self) -> bool:
        """End a pause, or a hold for known traffic; False without one."""
        if not self.flying or not self.state.is_held:
            return False
        self.post(Continued(self.state.t_s))
        return True

    def recall_vehicle(self, number: int) -> bool:
        """Recall one vehicle, which stays home until a resume; False if it is recalled already.

        Raises `KeyError` for a number without a vehicle.
        """
        if not self.flying or self.state.vehicles[number].called_home:
            return False
        self.post(VehicleRecalled(number, self.state.t_s))
        return True

    def skip_cell(self, number: int) -> bool:
        """Skip the observation point that a vehicle is at, or on its way to.

        False without one: in lanes, on paths without a stop, on the ground. Raises `KeyError` as
        `recall_vehicle`.
        """
        strategy = self.state.setting.strategy.in_force(self.state)
        cell = strategy.to_skip(self.state, self.state.vehicles[number])
        if not self.flying or cell is None:
            return False
        self.post(CellSkipped(number, self.state.t_s, cell))
        return True

    def land_here(self, number: int) -> bool:
        """Have a vehicle land in place, by its autopilot; False without control of it.

        Raises `KeyError` as `recall_vehicle`.
        """
        vehicle = self.state.vehicles[number]
        if not self.flying or vehicle.landed or vehicle.phase in (Phase.YIELDED, Phase.LOST):
            return False
        self._aircraft.land_here(number, "commanded by the operator")
        return True

    def stop(self) -> None:
        """End the flight as it is; the journal allows a resume."""
        self._over.set()

    async def fly(self) -> State:
        """Fly until no vehicle has anything more to do; return the final state."""
        self._flying = True
        async with asyncio.TaskGroup() as tasks:
            taking_in = tasks.create_task(self._take_in())
            await self._over.wait()
            taking_in.cancel()
        if self._failure is not None:
            raise self._failure
        return self.state


class GroundService(Service):
    """A service without a vehicle, whose orders are sent to a fleet by `send`."""

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
        """Have all vehicles hold; False if they do already."""
        return self.flying and not self.state.paused and self._command("pause")

    def go_on(self) -> bool:
        """Have all vehicles continue: members hold for a pause, or for traffic."""
        return self.flying and self._command("continue")

    def recall_vehicle(self, number: int) -> bool:
        """Recall one vehicle. Raises `KeyError` for a number without a vehicle."""
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
