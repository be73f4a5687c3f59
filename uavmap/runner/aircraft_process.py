"""The process of the aircraft: started beside a flight, found again by the next."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from pathlib import Path

from uavmap.aircraft.process.messages import Begin
from uavmap.aircraft.process.port import Port
from uavmap.journal.flight_plan import FlightPlan

Connection = Callable[[Port, Begin], AbstractAsyncContextManager[None]]


class AircraftProcess:
    def __init__(self, plan: FlightPlan, folder: Path) -> None:
        self._plan = plan

    def connected(self, port: Port, begin: Begin) -> AbstractAsyncContextManager[None]:
        raise NotImplementedError
