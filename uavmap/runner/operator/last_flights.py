"""What the journal of a flight that is resumed knows of its aircraft.

Where each was last, and which people have to look at before they take off again.

Autopilots take the place where they lie for their home: the pad is the one of the last take-off.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Final

from missions.events import Airborne, BatterySwapped, Connected, Crashed, Event
from missions.flight.setting import Setting
from missions.flight.state import State
from missions.geo.grid import Grid
from missions.guardian import PAD_M
from missions.units import GridPoint, LatLon
from uavmap.output.facts.figures import aircraft_down

_LOG: Final = logging.getLogger("uavmap.flight")


@dataclass(frozen=True, slots=True)
class LastFlight:
    """The last flight of a vehicle, whose battery has not been swapped since."""

    pad: GridPoint
    fell: bool = False

    def doubt(self, position: GridPoint) -> str:
        """Why it is not to take off unseen from where it stands; empty where it may."""
        away_m = position.distance_to(self.pad)
        if self.fell:
            return "was down"
        return f"stands {away_m:.0f} m from its pad" if away_m > PAD_M else ""


def last_flights(events: Iterable[Event]) -> dict[int, LastFlight]:
    """The last flight of each vehicle that has flown since its battery was swapped."""
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
    """Why vehicles are not to take off unseen from the places where they stand."""
    flights = last_flights(events)
    found = {
        number: flights[number].doubt(grid.fixed(place))
        for number, place in places.items()
        if number in flights and place is not None
    }
    return {number: why for number, why in found.items() if why}


def say_last_known(setting: Setting, state: State) -> None:
    """Log where aircraft were last that are not at home, where none has answered since."""
    for line in aircraft_down(setting, state):
        _LOG.info(f"not heard in this run; at {state.t_s:.0f} s of the mission: {line}")
