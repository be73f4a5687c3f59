"""A fleet in simulation: a service for each vehicle, in one process, over a simulated air.

Every member has a journal, a guardian and a radio of its own, and knows of the others only what
comes over the air. The results in the fleet's folder are made of all journals afterwards.
"""

from __future__ import annotations

import asyncio
import hashlib
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Final

from missions.errors import LinkError
from missions.events import Event
from missions.state import Phase, Setting, State
from missions.units import GridPoint
from uavmap.clock import VirtualClock, run
from uavmap.comms.air import Air, LinkModel, link_model
from uavmap.comms.sealing import Seal
from uavmap.fly.flight import Flight
from uavmap.fly.progress import Progress
from uavmap.record.flight_plan import JOURNAL, FlightPlan
from uavmap.record.journal import Journal
from uavmap.results.merging import merged_results

MEMBER_FOLDER: Final = "vehicle-{number}"


class OfMember:
    """What one member of a fleet says: lines with its number, and no table of its own."""

    def __init__(self, number: int, progress: Progress) -> None:
        self._number = number
        self._progress = progress

    def say(self, text: str) -> None:
        """A line that stays."""
        self._progress.say(f"vehicle {self._number}: {text}")

    def begin(self, setting: Setting, *, again: bool) -> None:
        """Nothing: the fleet's begins once."""

    def update(self, event: Event, state: State, again: int) -> None:
        """Nothing."""

    def end(self) -> None:
        """Nothing."""


def fly_fleet(plan: FlightPlan, folder: Path, progress: Progress) -> dict[str, Any]:
    """Fly a simulated fleet into a folder; returns the summary of the map of all.

    Raises `MissionFileError`, `JournalError`, `LinkError` as a flight does.
    """
    try:
        model = link_model(plan.comms or "free")
    except ValueError as error:
        raise LinkError(f"--comms {plan.comms}: {error}") from None
    setting = replace(plan, member=0).setting(progress.say)
    flights: dict[int, Flight] = {}
    for number in range(1, len(setting.mission.vehicles) + 1):
        own = replace(plan, member=number)
        at = folder / MEMBER_FOLDER.format(number=number)
        journal = Journal.create(at / JOURNAL, {"plan": asdict(own)})
        mine = Setting.of(setting.mission, number)
        flights[number] = Flight(
            own, mine, at, journal, State.initial(mine), OfMember(number, progress)
        )
    truth = run(_fly(flights, setting, plan.seed, model), VirtualClock(plan.speedup))
    for flight in flights.values():
        flight.finish()
    return merged_results(
        [flight.folder for flight in flights.values()], folder, progress.say, truth
    )


async def _fly(
    flights: dict[int, Flight], setting: Setting, seed: int, model: LinkModel
) -> dict[str, Any]:
    from uavmap.simulation import Simulation  # noqa: PLC0415 - real aircraft need no simulator

    world, air = Simulation(setting, seed), Air(model, seed)
    key = hashlib.blake2s(f"simulated fleet {seed}".encode()).digest()
    async with asyncio.TaskGroup() as tasks:
        turning = tasks.create_task(world.run())
        async with asyncio.TaskGroup() as members:
            for number, flight in flights.items():
                flight.seal = Seal(key, number, 1)
                flight.radio = air.radio(number, _place_of(flight))
                members.create_task(flight.fly_member(world))
        turning.cancel()
    figures: dict[str, Any] = dict(world.truth.figures())
    return figures | {"bytes_on_air": {str(k): v for k, v in sorted(air.sent_bytes.items())}}


def _place_of(flight: Flight) -> Callable[[], tuple[GridPoint, float]]:
    def place() -> tuple[GridPoint, float]:
        vehicle = flight.state.ours[0]
        if vehicle.phase is Phase.OFFLINE and vehicle.landed:  # it has not said where it is
            return flight.setting.pad_of(vehicle.vehicle), 0.0
        return vehicle.position, vehicle.height_m

    return place
