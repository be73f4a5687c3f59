"""What a team is: the vehicles that a service commands, and what it agrees with other services.

`team_of(setting)` is one of `Alone`, `Member` and `Listener` (`missions.flight.team.teams`). It is
asked wherever a member of a fleet does something else than a service that commands all vehicles.
What is not overridden is what the latter does.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

from missions.flight.setting import Setting
from missions.flight.state import State, VehicleState
from missions.flight.strategy.interface import OpenWork, Work
from missions.flight.team.scope import Scope
from missions.planning.search.lanes import Lane
from missions.planning.sweep.chart import Known


class Team(Scope, ABC):
    """The vehicles that a service commands, and what it agrees with other services."""

    # --- on the ground --------------------------------------------------------------------------
    def refusal(self, setting: Setting, vehicle: VehicleState) -> str:
        """Return why a vehicle may not take off from where it stands; empty if it may."""
        return ""

    # --- in the air -----------------------------------------------------------------------------
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

    def mark_unreported(self, setting: Setting, state: State, known: Known) -> bool:
        """Mark undecided cells that others may take for observed; return whether there are any."""
        return False


def team_of(setting: Setting) -> Team:
    """Return the team of a mission."""
    team = setting.team
    assert isinstance(team, Team)
    return team
