"""Reports between members of a fleet, as events of the journal (`missions.events`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

from missions.classes import ClassShare
from missions.units import Cell, GridPoint


@dataclass(frozen=True, slots=True)
class Partition:
    """A time from `begin` to `end` in which only members of one group are in contact.

    Without groups none are. Times are those of the caller: seconds, or the unit of a simulation.

    >>> Partition(10.0, 20.0, (frozenset({0, 1}),)).parts(0, 1, 15.0)
    False
    >>> Partition(10.0, 20.0).parts(0, 1, 15.0)
    True
    """

    begin: float
    end: float
    groups: tuple[frozenset[int], ...] = ()

    def parts(self, one: int, other: int, t: float) -> bool:
        """Return whether two members are out of contact at a time."""
        if not self.begin <= t < self.end:
            return False
        return not any(one in group and other in group for group in self.groups)


@dataclass(frozen=True, slots=True)
class OfVehicle:
    """An event of one vehicle, at a mission time."""

    vehicle: int
    t_s: float


@dataclass(frozen=True, slots=True)
class MemberReport(OfVehicle):
    """Another member's report on its vehicle: where it is, and what it will do."""

    position: GridPoint
    height_m: float
    remaining_wh: float
    does: Literal["stands", "flies", "returns", "pilot", "guarded", "ended", "down"]
    home: GridPoint
    lanes: tuple[int, ...] = ()
    """Lanes of the mission that it holds, in the order of flight, by number from 0."""
    path: tuple[GridPoint, ...] = ()
    """Places along the rest of its path."""
    layer_m: float | None = None
    """Its working altitude if that differs from the altitude of the map, m."""
    kind: Literal["heard"] = "heard"


class Fact(NamedTuple):
    """Decisions of a vehicle's frames within a second: cells, and whether each is region."""

    t_s: float
    votes: tuple[tuple[Cell, bool], ...]
    overview: bool = False
    """True if it is from search height."""
    seen: bool = False
    """True if it decides nothing: all frames showed these cells as no region.

    They were too few for a decision, and the vehicle has passed.
    """
    classes: tuple[ClassShare, ...] = ()
    """Mean shares of the explored classes in these cells over the vehicle's frames.

    Whole tenths above 0, by number and cell.
    """
    doubt: bool = False
    """True if it decides nothing, and votes give the doubt of each cell.

    The vehicle has passed. A vote is True if its frames leave the cell unsure, and False once they
    are sure of it again.
    """


@dataclass(frozen=True, slots=True)
class FactsShared(OfVehicle):
    """Decisions of another member, in facts numbered from `first` on."""

    first: int
    frames: tuple[Fact, ...]
    kind: Literal["shared"] = "shared"


class Part(NamedTuple):
    """The part of a vehicle of a fleet: observation points, in order, as at mission time 0."""

    vehicle: int
    places: tuple[GridPoint, ...]


@dataclass(frozen=True, slots=True)
class PartsAllotted(OfVehicle):
    """A member of a fleet has assigned the parts of the map: cells near to the places of each."""

    parts: tuple[Part, ...]
    kind: Literal["allotted"] = "allotted"


@dataclass(frozen=True, slots=True)
class MemberApart(OfVehicle):
    """Another member of a fleet is out of contact: each continues alone."""

    kind: Literal["apart"] = "apart"


@dataclass(frozen=True, slots=True)
class AirRequested(OfVehicle):
    """Another member requests the air above and below a place: it is closed to us from now on.

    It is open again after `until_s`, or at the next request of the same member. A request that ends
    at once returns the air.
    """

    place: GridPoint
    low_m: float
    high_m: float
    until_s: float
    kind: Literal["asked"] = "asked"


@dataclass(frozen=True, slots=True)
class AirLeased(OfVehicle):
    """All others have closed to themselves the air that our vehicle requested."""

    place: GridPoint
    until_s: float
    kind: Literal["leased"] = "leased"
