"""The people on the ground: they swap batteries, stand clear, and allow take-off.

At a terminal the service asks and waits for Enter. Elsewhere waiting vehicles stay on the ground
until `uavmap resume`; its journal shows which vehicles have to be examined first.
"""

from __future__ import annotations

import asyncio
import logging
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Final, TextIO

from missions.events import Airborne, BatterySwapped, Connected, Crashed, Event
from missions.flight.state import State
from missions.geo.grid import Grid
from missions.guardian import PAD_M
from missions.units import GridPoint, LatLon
from uavmap.base.terminal import forget_typed, read_line
from uavmap.output.facts.figures import aircraft_down

_LOG: Final = logging.getLogger("uavmap.flight")
_PREFLIGHT: Final = logging.getLogger("uavmap.runner.preflight")


class EnterKey:
    """The Enter key, as a keyboard passes it on that reads every key."""

    def __init__(self) -> None:
        self._asked: asyncio.Future[bool] | None = None
        self._lost = False

    async def wait(self) -> bool:
        """Wait until it is pressed, from now on; False when the terminal is gone."""
        if self._lost:
            return False
        self._asked = asyncio.get_running_loop().create_future()
        try:
            return await self._asked
        finally:
            self._asked = None

    def press(self) -> None:
        """Answer a waiting caller."""
        self._answer(pressed=True)

    def lose(self) -> None:
        """Answer that the terminal is gone, which is no consent."""
        self._lost = True
        self._answer(pressed=False)

    def _answer(self, *, pressed: bool) -> None:
        if self._asked is not None and not self._asked.done():
            self._asked.set_result(pressed)


class Operator:
    """The operator at the terminal, if there is one; the links go on while a question waits."""

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream: TextIO | None = stream or sys.stdin

    @property
    def absent(self) -> bool:
        """True if no answer will ever come."""
        return self._stream is None or not self._stream.isatty()

    async def ask(self, question: str) -> bool | None:
        """Ask, and wait for a line; return whether it is a yes, None if no answer will ever
        come."""
        if self.absent:
            return None
        forget_typed(self._stream)
        _PREFLIGHT.info(question)
        return (await read_line(self._stream)).strip().lower() in ("y", "yes")

    async def entered(self) -> bool:
        """Wait for a line; return False when the terminal is gone."""
        forget_typed(self._stream)
        return (await read_line(self._stream)).endswith("\n")


class Crew:
    """Asks for battery swaps, one at a time, answered by `enter` or a line of `stream`."""

    def __init__(
        self, *, automatic: bool, enter: EnterKey | None = None, stream: TextIO | None = None
    ) -> None:
        self._automatic = automatic
        self._enter = enter
        self._operator = Operator(stream)
        self._asking = asyncio.Lock()
        self._doubts: dict[int, str] = {}
        self.waiting: set[int] = set()

    @property
    def absent(self) -> bool:
        """True if no answer will ever come."""
        return not self._automatic and self._operator.absent

    @property
    def keeps_waiting(self) -> bool:
        """True if vehicles wait without a crew that can answer."""
        return bool(self.waiting) and self._operator.absent

    def doubt(self, vehicles: Mapping[int, str]) -> None:
        """Ask about vehicles before they take off, even if swaps are automatic: the reason, by
        number."""
        self._doubts |= vehicles

    async def swap(self, vehicle: int) -> None:
        """Return when the battery of a vehicle is swapped and it may take off again."""
        doubt = self._doubts.get(vehicle, "")
        if self._automatic and not doubt:
            return
        self.waiting.add(vehicle)
        try:
            if self._operator.absent:
                _LOG.info(
                    f"vehicle {vehicle} {doubt}: it takes off only after Enter at a terminal "
                    "confirms an inspection"
                    if doubt
                    else f"vehicle {vehicle} waits on the ground for a fresh battery"
                )
                await asyncio.Event().wait()
            async with self._asking:
                found = f"{doubt}: inspect it" if doubt else "has landed"
                _LOG.info(
                    f"vehicle {vehicle} {found}{',' if doubt else ':'} swap its battery, stand "
                    "clear, press Enter; it takes off by itself"
                )
                enter = self._enter
                if not await (self._operator.entered() if enter is None else enter.wait()):
                    await asyncio.Event().wait()
            self._doubts.pop(vehicle, None)
        finally:
            self.waiting.discard(vehicle)


def all_wait(state: State, waiting: set[int]) -> bool:
    """Return whether all unfinished vehicles wait for a battery that no crew here will announce."""
    return bool(waiting) and all(
        number in waiting or v.ended for number, v in state.vehicles.items()
    )


@dataclass(frozen=True, slots=True)
class LastFlight:
    """The last flight of a vehicle, whose battery has not been swapped since."""

    pad: GridPoint
    fell: bool = False

    def doubt(self, position: GridPoint) -> str:
        """Return why it needs an inspection before a take-off from `position`; empty if it does
        not."""
        away_m = position.distance_to(self.pad)
        if self.fell:
            return "was down"
        return f"stands {away_m:.0f} m from its pad" if away_m > PAD_M else ""


def last_flights(events: Iterable[Event]) -> dict[int, LastFlight]:
    """Return the last flight of each vehicle that has flown since its battery was swapped."""
    flights: dict[int, LastFlight] = {}
    for event in events:
        match event:
            case Airborne(vehicle=number, home=GridPoint() as home):
                flights[number] = LastFlight(home)
            case Connected(vehicle=number, airborne=True, home=home):
                flights.setdefault(number, LastFlight(home))
            case Crashed(vehicle=number) if number in flights:
                flights[number] = replace(flights[number], fell=True)
            case BatterySwapped(vehicle=number):
                flights.pop(number, None)
    return flights


def doubts(
    events: Iterable[Event], places: Mapping[int, LatLon | None], grid: Grid
) -> dict[int, str]:
    """Return why vehicles need an inspection before a take-off from their places."""
    flights = last_flights(events)
    found = {
        number: flights[number].doubt(grid.fixed(place))
        for number, place in places.items()
        if number in flights and place is not None
    }
    return {number: why for number, why in found.items() if why}


def log_last_positions(state: State) -> None:
    """Log the last known places of aircraft that are not at home, if none has answered since."""
    for line in aircraft_down(state):
        _LOG.info(f"no contact in this run; at {state.t_s:.0f} s of the mission: {line}")
