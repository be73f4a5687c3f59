"""Which vehicles a service commands: all of a mission, one of a fleet, or none."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from missions.geo.fence import Fence
from missions.mission.schema import Mission
from missions.units import GridPoint


class Fences(NamedTuple):
    """Where vehicles may fly."""

    ours: Fence
    """Where ours may."""
    everyones: Fence
    """Where each vehicle of a fleet may."""
    whole: Fence | None
    """Of a member: the fence without the columns over others' pads, which are holes of ours."""


class Scope:
    """Which vehicles a service commands.

    What it does with them where others command the rest is `missions.flight.team.interface.Team`.
    """

    number: int | None = None
    """The one vehicle that is commanded, 0 for none of a fleet; None: all are."""
    knows_orders: bool = True
    """Whether it knows what vehicles are ordered."""
    climbs_on_path: bool = True
    """Whether a vehicle may change its layer while it flies to somewhere else."""

    def controls(self, number: int) -> bool:
        """Return whether a vehicle is commanded."""
        return True

    def controlled(self, numbers: Iterable[int]) -> tuple[int, ...]:
        """Return those of some vehicles that are commanded, in order."""
        return tuple(sorted(filter(self.controls, numbers)))

    def fences(self, mission: Mission, whole: Fence, pads: Sequence[GridPoint]) -> Fences:
        """Return where vehicles may fly that start from their pads."""
        return Fences(whole, whole, None)
