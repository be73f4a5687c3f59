"""A fleet in simulation: a service for each vehicle, in one process, over a simulated radio.

Each member has its own journal, guardian and radio. The fleet's results are made of all journals.
"""

from __future__ import annotations

import asyncio
import hashlib
import logging
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from missions.errors import LinkError, PreflightError, leaves
from missions.flight.setting_of import setting_of
from missions.flight.vehicle_state import Phase
from missions.mission.fleet_checks import check_fleet
from missions.units import GridPoint
from uavmap.base.clock import VirtualClock, run
from uavmap.base.messages import prefixed
from uavmap.fleet.radio import SealedRadio
from uavmap.fleet.sealing import Seal
from uavmap.fleet.simulated_radio import Air, LinkModel, link_model
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import JOURNAL, FlightPlan
from uavmap.output.merging import merged_results
from uavmap.runner.one_flight import Flight

_LOG: Final = logging.getLogger("uavmap.fleet")
MEMBER_FOLDER: Final = "vehicle-{number}"


def fly_fleet(plan: FlightPlan, folder: Path) -> dict[str, Any]:
    """Fly a simulated fleet into a folder; return the summary of the map of all.

    Raises `MissionFileError`, `JournalError`, `LinkError` as a flight does.
    """
    try:
        model = link_model(plan.comms or "free")
    except ValueError as error:
        raise LinkError(f"--comms {plan.comms}: {error}") from None
    fleet = SimulatedFleet(plan, folder, model)
    try:
        truth = run(fleet.fly(), VirtualClock(plan.speedup))
    except ExceptionGroup as group:
        refused, rest = group.split(PreflightError)
        if refused is None or rest is not None:
            raise
        raise leaves(refused)[0] from None  # each member raises it
    for number, flight in fleet.flights.items():
        with prefixed_lines(number):
            flight.finish()
    folders = [flight.folder for flight in fleet.flights.values()]
    return merged_results(folders, folder, _LOG.info, truth)


class SimulatedFleet:
    """The members of a fleet, each with a folder, a journal, and a service of its own."""

    def __init__(self, plan: FlightPlan, folder: Path, model: LinkModel) -> None:
        """Raises `MissionFileError`, `JournalError`."""
        from uavmap.runner.simulation import Simulation  # noqa: PLC0415 - real aircraft need no simulator

        self.plan = plan.as_member(0)
        self.setting = self.plan.setting(_LOG.info)
        check_fleet(self.setting.mission, plan.mission_source)
        self.world = Simulation(self.setting, plan.seed)
        self.air = Air(model, plan.seed)
        self._folder = folder
        self._key = hashlib.blake2s(f"simulated fleet {plan.seed}".encode()).digest()
        numbers = range(1, len(self.setting.mission.vehicles) + 1)
        self.flights = {number: self.new(number) for number in numbers}

    def folder(self, number: int) -> Path:
        """Return the folder of a member."""
        return self._folder / MEMBER_FOLDER.format(number=number)

    def new(self, number: int) -> Flight:
        """Return a member before its first start."""
        own = replace(self.plan, member=number)
        at = self.folder(number)
        journal = Journal.create(at / JOURNAL, {"plan": own.as_json()})
        mine = setting_of(self.setting.mission, number)
        return Flight(own, at, journal, mine.initial_state())

    def radio(self, flight: Flight, number: int, start: int = 1) -> SealedRadio:
        """Return the radio of a member at its program's start number `start`."""
        radio = self.air.radio(number, _place_of(flight))
        return SealedRadio(radio, Seal(self._key, number, start))

    async def fly(self) -> dict[str, Any]:
        """Fly until all members have ended; return the simulator's observations."""
        async with asyncio.TaskGroup() as tasks:
            turning = tasks.create_task(self.world.run())
            async with asyncio.TaskGroup() as members:
                for number in self.flights:
                    members.create_task(self.live(number))
            turning.cancel()
        figures: dict[str, Any] = dict(self.world.truth.figures())
        return figures | {
            "bytes_on_air": {str(k): v for k, v in sorted(self.air.sent_bytes.items())}
        }

    async def live(self, number: int) -> None:
        """Run one member's program from its start to its end."""
        flight = self.flights[number]
        with prefixed_lines(number):
            await flight.fly_member(self.world, self.radio(flight, number))
        self.air.silence(number)


def prefixed_lines(number: int) -> AbstractContextManager[None]:
    """Begin the lines of a member with its number."""
    return prefixed(f"vehicle {number}: ")


def _place_of(flight: Flight) -> Callable[[], tuple[GridPoint, float]]:
    def place() -> tuple[GridPoint, float]:
        vehicle = flight.state.own_vehicles[0]
        if vehicle.phase is Phase.OFFLINE and vehicle.landed:  # it has not reported its position
            return flight.setting.pad_of(vehicle.vehicle), 0.0
        return vehicle.position, vehicle.height_m

    return place
