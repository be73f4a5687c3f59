"""What members of a fleet report to each other, as events of the journal (`missions.events`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

from missions.classes import ClassShare
from missions.units import Cell, GridPoint


@dataclass(frozen=True, slots=True)
class Partition:
    """From `begin` to `end` only members of one group hear each other; without groups none do.
    Times are those of the caller: seconds, or the unit of a simulation.

    >>> Partition(10.0, 20.0, (frozenset({0, 1}),)).parts(0, 1, 15.0)
    False
    >>> Partition(10.0, 20.0).parts(0, 1, 15.0)
    True
    """

    begin: float
    end: float
    groups: tuple[frozenset[int], ...] = ()

    def parts(self, one: int, other: int, t: float) -> bool:
        """Whether two cannot hear each other at a time."""
        if not self.begin <= t < self.end:
            return False
        return not any(one in group and other in group for group in self.groups)


@dataclass(frozen=True, slots=True)
class OfVehicle:
    """An event of one vehicle, at a mission time."""

    vehicle: int
    t_s: float


@dataclass(frozen=True, slots=True)
class Heard(OfVehicle):
    """What another member of a fleet said of its vehicle: where it is, and what it will do."""

    position: GridPoint
    height_m: float
    remaining_wh: float
    does: Literal["stands", "flies", "returns", "pilot", "guarded", "ended", "down"]
    home: GridPoint
    lanes: tuple[int, ...] = ()
    """Which lanes of the mission it holds, in the order of flight, by number from 0."""
    path: tuple[GridPoint, ...] = ()
    """Where its path leads from here."""
    layer_m: float | None = None
    """The altitude that it works in, where that is not the one from which it maps."""
    kind: Literal["heard"] = "heard"


class Fact(NamedTuple):
    """What a vehicle's frames have decided within a second: each cell, and whether it is region."""

    t_s: float
    votes: tuple[tuple[Cell, bool], ...]
    overview: bool = False
    """Whether from the height of a search."""
    seen: bool = False
    """Whether nothing is decided: all frames took these cells for no region, too few of them for a
    decision, and the vehicle has passed."""
    classes: tuple[ClassShare, ...] = ()
    """Mean shares of the explored classes in these cells over the vehicle's frames: whole tenths
    above 0, by number and cell."""
    doubt: bool = False
    """Whether nothing is decided: the vehicle has passed, and votes say of each cell whether its
    frames leave it unsure, or are sure of it again."""


@dataclass(frozen=True, slots=True)
class Shared(OfVehicle):
    """What another member of a fleet has decided, in facts numbered from `first` on."""

    first: int
    frames: tuple[Fact, ...]
    kind: Literal["shared"] = "shared"


class Part(NamedTuple):
    """What a vehicle of a fleet is to map: observation points, in order, as at mission time 0."""

    vehicle: int
    places: tuple[GridPoint, ...]


@dataclass(frozen=True, slots=True)
class Allotted(OfVehicle):
    """A member of a fleet has said who is to map what: what lies near to its places."""

    parts: tuple[Part, ...]
    kind: Literal["allotted"] = "allotted"


@dataclass(frozen=True, slots=True)
class Apart(OfVehicle):
    """Another member of a fleet has not been heard for some time: it goes on alone, as we do."""

    kind: Literal["apart"] = "apart"


@dataclass(frozen=True, slots=True)
class Asked(OfVehicle):
    """Another member asks for the air above and below a place: it is closed to us from now on.

    It is open again after `until_s`, or once another question of the same member is heard; one
    that ends when it is asked gives it back.
    """

    place: GridPoint
    low_m: float
    high_m: float
    until_s: float
    kind: Literal["asked"] = "asked"


@dataclass(frozen=True, slots=True)
class Leased(OfVehicle):
    """Everybody else has closed the air that our vehicle asked for to themselves."""

    place: GridPoint
    until_s: float
    kind: Literal["leased"] = "leased"
