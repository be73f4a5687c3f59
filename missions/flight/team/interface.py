"""What a team is: the vehicles that a service commands, and what it agrees with other services.

`Setting.team` is one of `Alone`, `Member` and `Listener` (`missions.flight.team.teams`). Modules of
missions.flight ask it wherever a member of a fleet does something else than a service that
commands all vehicles. What is not overridden is what the latter does.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple

from missions.geo.fence import Fence
from missions.mission.schema import Mission
from missions.planning.search.lanes import Lane
from missions.units import GridPoint

if TYPE_CHECKING:
    from missions.flight.setting import Setting
    from missions.flight.state import State, VehicleState
    from missions.flight.strategy.interface import OpenWork, Work
    from missions.planning.sweep.chart import Known


class Fences(NamedTuple):
    """Where vehicles may fly."""

    ours: Fence
    """Where ours may."""
    everyones: Fence
    """Where each vehicle of a fleet may."""
    whole: Fence | None
    """Of a member: the fence without the columns over others' pads, which are holes of ours."""


class Team(ABC):
    """The vehicles that a service commands, and what it agrees with other services."""

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

    # --- on the ground --------------------------------------------------------------------------
    def refusal(self, setting: Setting, vehicle: VehicleState) -> str:
        """Return why a vehicle may not take off from where it stands; empty if it may."""
        return ""

    # --- in the air -----------------------------------------------------------------------------
    def first(self, setting: Setting, state: State, vehicle: VehicleState) -> State | None:
        """Return the state with what a vehicle has to do before all else; None: nothing."""
        return None

    def change_layer(self, setting: Setting, state: State, vehicle: VehicleState) -> State | None:
        """Return the state in which a vehicle changes its layer as others allow it; None: it may
        change it wherever the air is clear."""
        return None

    def way_out(self, setting: Setting, state: State, vehicle: VehicleState) -> State:
        """Return the state in which a waiting vehicle leaves its pad past those of others."""
        return state

    # --- work -----------------------------------------------------------------------------------
    def free_lane(self, setting: Setting, state: State) -> Lane | None:
        """Return the first lane with something left to judge that no vehicle holds."""
        return None

    def gathers(self, setting: Setting, state: State, vehicle: VehicleState) -> bool:
        """Return whether a vehicle without lanes has to hear of others before it does anything."""
        return False

    @abstractmethod
    def share_work(self, setting: Setting, state: State, work: OpenWork) -> Work:
        """Close in the chart what others are to see."""

    def want_reported(self, setting: Setting, state: State, known: Known) -> bool:
        """Have observed what others take for observed by ours and is undecided; whether there is
        any."""
        return False
