"""Tours past all that is left to map, also of those who still fly lanes: who is to see what.

A plan is made for those who can fly it now. Were nobody else thought of, one vehicle would set out
to map all that four others have found, and leave that at every new plan. So tours are laid for all
of them (`missions.planning.sweep.tours`), from where each will be when its lanes are flown, and
what others are to see is left out of the plan.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from missions.flight.setting import Setting
from missions.flight.state import State, VehicleState
from missions.flight.strategy.flyers import flyer_of
from missions.flight.strategy.two_heights import at_map_height
from missions.orders import FlyPath
from missions.planning.sweep.chart import Known
from missions.units import Cell

if TYPE_CHECKING:
    from missions.planning.sweep.planned_team import Flyer
    from missions.planning.sweep.tours import Tour, Waypoints

EVERY_S: Final = 4.0
"""Between two decisions on who is to see what."""


@dataclass(frozen=True, slots=True)
class TourMemory:
    """What was decided last."""

    laid_s: float = float("-inf")
    team: frozenset[int] = frozenset()
    """Who was planned for."""
    tours: Mapping[int, Tour] = field(default_factory=dict)
    """Of each vehicle, also of those who still fly lanes."""
    others: frozenset[Cell] = frozenset()
    """What those are to see who still fly lanes."""


def shared_out(
    setting: Setting,
    state: State,
    known: Known,
    team: Mapping[int, Flyer],
    memory: TourMemory,
    decision: int,
) -> tuple[TourMemory, Waypoints]:
    """Close what others are to see, and lay tours if it is time to.

    Args:
        setting: Of the mission.
        state: Now.
        known: What is left to map; what others are to see is closed in it.
        team: Those who are planned for.
        memory: What was decided last.
        decision: Seeds the search.

    Returns:
        What is decided now, and waypoints for the team; none where the last plan goes on.
    """
    from missions.planning.sweep.memo import tours_once  # noqa: PLC0415 - numba takes a second to load

    if not setting.finds_all:
        return memory, ()
    waypoints: Waypoints = ()
    numbers = frozenset(team)
    if state.t_s >= memory.laid_s + EVERY_S or not numbers <= memory.team:
        begin_s = round(state.t_s + 1.0, 3)
        later = _later(setting, state, numbers, begin_s)
        flyers = (*team.values(), *(flyer for _, flyer, _ in later))
        delays_s = (*(0.0 for _ in team), *(delay_s for _, _, delay_s in later))
        votes = setting.mission.votes
        numbered = (*team, *(number for number, _, _ in later))
        before = tuple(memory.tours.get(number, ()) for number in numbered)
        tours = tours_once(
            setting.plans, known, flyers, delays_s, votes.frames, votes.positive, begin_s,
            decision, before,
        )  # fmt: skip
        laid = {} if tours is None else dict(zip(numbered, tours.waypoints, strict=True))
        others: frozenset[Cell] = frozenset()
        if tours is not None:
            waypoints = tours.waypoints[: len(team)]
            cells = (tours.mine >= len(team)).nonzero()[0]
            others = frozenset(known.chart.cell(int(index)) for index in cells)
        memory = TourMemory(state.t_s, numbers, laid, others)
    chart = known.chart
    chart.closed[[chart.index(cell) for cell in memory.others if chart.holds(cell)]] = 1
    return memory, waypoints


def _later(
    setting: Setting, state: State, team: frozenset[int], begin_s: float
) -> list[tuple[int, Flyer, float]]:
    """Those who will map once their lanes are flown, and how much later than `begin_s`."""
    found = []
    for number, vehicle in sorted(state.vehicles.items()):
        if number in team or not vehicle.lanes or vehicle.return_reason is not None:
            continue
        if not isinstance(vehicle.order, FlyPath):
            continue
        delay_s = max(vehicle.order.trajectory.end_s - begin_s, 0.0)
        found.append((number, _flyer(setting, vehicle, begin_s), delay_s))
    return found


def _flyer(setting: Setting, vehicle: VehicleState, begin_s: float) -> Flyer:
    return flyer_of(setting, at_map_height(setting, vehicle), None, None, begin_s)
