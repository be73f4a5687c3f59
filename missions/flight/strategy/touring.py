"""Tours past all that is left to map, also of those who still fly lanes: who is to see what.

A plan is made for those who can fly it now. Were nobody else thought of, one vehicle would set out
to map all that four others have found, and leave that at every new plan. So tours are laid for all
of them (`missions.planning.sweep.tours`), from where each will be when its lanes are flown, and
what others are to see is left out of the plan.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

from missions.flight.setting import Setting
from missions.flight.state import State
from missions.flight.strategy.flyers import flyer_of
from missions.flight.strategy.interface import OpenWork, TourMemory
from missions.planning.sweep.chart import Known
from missions.units import Cell

if TYPE_CHECKING:
    from missions.planning.sweep.paths import Flyer
    from missions.planning.sweep.tours import Tour, Tours, Waypoints

EVERY_S: Final = 4.0
"""Between two decisions on who is to see what."""


def shared_out(setting: Setting, state: State, work: OpenWork) -> tuple[TourMemory, Waypoints]:
    """Close what others are to see in the chart, and lay tours if it is time to.

    Returns:
        What is decided now, and waypoints for the team; none where the last plan goes on.
    """
    known, team, memory, decision = work
    waypoints: Waypoints = ()
    numbers = frozenset(team)
    if state.t_s >= memory.laid_s + EVERY_S or not numbers <= memory.team:
        begin_s = round(state.t_s + 1.0, 3)
        everyone = at_once(team) | _later(setting, state, numbers, begin_s)
        tours = tours_of(setting, known, everyone, begin_s, decision, memory.tours)
        laid = {} if tours is None else dict(zip(everyone, tours.waypoints, strict=True))
        others: frozenset[Cell] = frozenset()
        if tours is not None:
            waypoints = tours.waypoints[: len(team)]
            cells = (tours.mine >= len(team)).nonzero()[0]
            others = frozenset(known.chart.cell(int(index)) for index in cells)
        memory = TourMemory(state.t_s, numbers, laid, others)
    chart = known.chart
    chart.closed[[chart.index(cell) for cell in memory.others if chart.holds(cell)]] = 1
    return memory, waypoints


def at_once(team: Mapping[int, Flyer]) -> dict[int, tuple[Flyer, float]]:
    """Those who can begin to map now."""
    return {number: (flyer, 0.0) for number, flyer in team.items()}


def tours_of(
    setting: Setting,
    known: Known,
    everyone: Mapping[int, tuple[Flyer, float]],
    begin_s: float,
    decision: int,
    before: Mapping[int, Tour],
    **how: float,
) -> Tours | None:
    """Lay a tour for everyone, who each begins so much later than `begin_s`, seconds.

    `before` are the tours that were laid last, `how` are options of `tours_once`. None where there
    is too little to be seen.
    """
    from missions.planning.sweep.memo import tours_once  # noqa: PLC0415 - numba takes a second to load

    votes = setting.mission.votes
    flyers, delays_s = zip(*everyone.values(), strict=True)
    return tours_once(
        setting.plans, known, flyers, delays_s, votes.frames, votes.positive, begin_s, decision,
        tuple(before.get(number, ()) for number in everyone), **how,  # type: ignore[arg-type]
    )  # fmt: skip


def _later(
    setting: Setting, state: State, team: frozenset[int], begin_s: float
) -> dict[int, tuple[Flyer, float]]:
    """Those who will map once their lanes are flown, and how much later than `begin_s`."""
    found = {}
    for number, vehicle in sorted(state.vehicles.items()):
        returns = vehicle.return_reason is not None
        if number in team or not vehicle.lanes or returns or vehicle.path is None:
            continue
        delay_s = max(vehicle.path.end_s - begin_s, 0.0)
        low = setting.heights.as_mapping(setting, vehicle)
        found[number] = flyer_of(setting, low, None, None, begin_s), delay_s
    return found
