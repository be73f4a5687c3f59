"""What a team is: the vehicles that a service commands, and what it agrees with other services.

`setting.team` is one of `Alone`, `Member` and `Listener` (`missions.flight.team.teams`). What is
not overridden is what a service that commands all vehicles does.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
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
    """Fence of the vehicles that are commanded."""
    everyones: Fence
    """Fence of each vehicle of a fleet."""
    whole: Fence | None
    """Of a member: the fence without the columns over others' pads, which are holes of `ours`."""


class Team(ABC):
    """The vehicles that a service commands, and what it agrees with other services."""

    number: int | None = None
    """The one vehicle that is commanded, 0 for none of a fleet; None: all are."""
    knows_orders: bool = True
    """Whether it knows what vehicles are ordered."""
    shares_facts: bool = False
    """Whether other services receive what its frames decide, and make the same map of it."""
    climbs_on_path: bool = True
    """Whether a vehicle may change its layer while it flies to somewhere else."""

    def controls(self, number: int) -> bool:
        """Return whether a vehicle is commanded."""
        return True

    def fences(self, mission: Mission, whole: Fence, pads: Sequence[GridPoint]) -> Fences:
        """Return where vehicles may fly that start from their pads."""
        return Fences(whole, whole, None)

    def refusal(self, setting: Setting, vehicle: VehicleState) -> str:
        """Return why a vehicle may not take off from where it stands; empty if it may."""
        return ""

    def urgent_order(self, setting: Setting, state: State, vehicle: VehicleState) -> State | None:
        """Return the state in which a vehicle does what comes before all else; None: nothing."""
        return None

    def change_layer(self, setting: Setting, state: State, vehicle: VehicleState) -> State | None:
        """Return the state in which a vehicle changes its layer as others allow it; None: it may
        change it wherever the air is clear."""
        return None

    def way_out(self, setting: Setting, state: State, vehicle: VehicleState) -> State:
        """Return the state in which a waiting vehicle leaves its pad past those of others."""
        return state

    def free_lane(self, setting: Setting, state: State) -> Lane | None:
        """Return the first lane with something left to judge that no vehicle holds."""
        return None

    def gathers(self, setting: Setting, state: State, vehicle: VehicleState) -> bool:
        """Return whether a vehicle without lanes has to hear of others before it does anything."""
        return False

    @abstractmethod
    def share_work(self, setting: Setting, state: State, work: OpenWork) -> Work:
        """Close in the chart what others are to see."""

    def mark_unreported(self, setting: Setting, state: State, known: Known) -> bool:
        """Mark undecided cells that others may take for observed; return whether there are any."""
        return False
