"""The cost of a frame does not depend on the size of the map, counted and not timed.

It counts memory for copies, and calls of Python functions, of which a walk over all cells makes
many. Medians: now and then a table grows.
"""

from __future__ import annotations

import statistics
import sys
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from types import FrameType

import pytest

from missions.events import FrameSeen
from missions.mapping.belief import Belief, FrameId
from missions.mapping.tree import Tree
from missions.orders import Look
from missions.units import Cell
from tests.benchmarks.planning.belief import (
    Flight,
    block,
    exploring,
    frame,
    frame_from_anywhere,
    map_region,
    searching,
    seen_openly,
)

SMALL, LARGE = 200, 2_000


class Costs:
    """A counter of the bytes and calls of an action."""

    def __init__(self) -> None:
        self.bytes: list[int] = []
        self.calls: list[int] = []

    def measure(self, work: Callable[[], object]) -> None:
        count = 0

        def called(_frame: FrameType, event: str, _arg: object) -> None:
            nonlocal count
            count += event == "call"

        tracemalloc.start()
        before, _ = tracemalloc.get_traced_memory()
        tracemalloc.reset_peak()
        sys.setprofile(called)
        try:
            work()
        finally:
            sys.setprofile(None)
            _, peak = tracemalloc.get_traced_memory()
            tracemalloc.stop()
        self.bytes.append(peak - before)
        self.calls.append(count)

    def medians(self) -> tuple[float, float]:
        return statistics.median(self.bytes), statistics.median(self.calls)


def in_search(cells: int) -> tuple[float, float]:
    flight, costs = searching(cells), Costs()
    for east in range(20):
        seen = frame(flight.next_s(), Cell(east, 4))
        costs.measure(lambda seen=seen: flight.post(seen))
    return costs.medians()


def in_exploration(cells: int) -> tuple[float, float]:
    flight, costs = exploring(cells), Costs()
    for _ in range(6):
        while (here := looking_at(flight)) is None:
            flight.arrive()
        beside = Cell(here.east - 1, here.north), Cell(here.east + 1, here.north)
        while looking_at(flight) == here:
            seen = frame(flight.next_s(), here, here, *beside)
            costs.measure(lambda seen=seen: flight.post(seen))
    return costs.medians()


def looking_at(flight: Flight) -> Cell | None:
    order = flight.order()
    return order.cell if isinstance(order, Look) else None


def of_looks(cells: int) -> tuple[float, float]:
    """Measure looks at the end of a corridor: the root is as far away as there are cells."""
    tree, costs = Tree.rooted(Cell(0, 0)), Costs()
    for east in range(cells):
        tree = tree.with_observation(Cell(east, 0), [Cell(east + 1, 0)])
    held = [tree]
    for east in range(cells, cells + 20):
        costs.measure(
            lambda east=east: held.append(
                held.pop().with_observation(Cell(east, 0), [Cell(east + 1, 0)])
            )
        )
    return costs.medians()


def from_anywhere(cells: int) -> tuple[float, float]:
    """Measure frames without stops, each with its cells; the planner requests verdicts."""
    flight, costs = searching(cells), Costs()
    flight.state = replace(flight.state, belief=seen_openly(block(cells)))
    for east in range(20):
        seen = frame_from_anywhere(flight.next_s(), Cell(east, 10))

        def judge_frame(seen: FrameSeen = seen) -> None:
            flight.post(seen)
            for vote in seen.votes:
                flight.state.belief.verdict(vote.cell)
                flight.state.belief.provisional(vote.cell)

        costs.measure(judge_frame)
    return costs.medians()


def from_one_vantage(cells: int) -> tuple[float, float]:
    """Measure photographs that count as taken from one vantage, with the votes of all cells."""
    vantage, costs = Cell(0, 0), Costs()
    held = [Belief(5, 3)]
    for number, cell in enumerate(block(cells)):
        held = [held[0].with_frame(vantage, FrameId(1, float(number)), {cell: True})]
    for number in range(20):
        photograph = FrameId(2, float(number))
        costs.measure(
            lambda photograph=photograph: held.append(
                held.pop().with_frame(vantage, photograph, {Cell(-1, -1): True})
            )
        )
    return costs.medians()


def of_a_no(cells: int) -> tuple[float, float]:
    """Measure negative votes from new vantages on the last ROI cell, which others elected."""
    held, costs = [map_region(Belief(1, 1), block(cells), roi=True)], Costs()
    last = block(cells)[-1]
    for number in range(20):
        vantage = Cell(-5, -5 - number)
        costs.measure(
            lambda vantage=vantage: held.append(
                held.pop().with_frame(vantage, FrameId(1, 9.0), {last: False})
            )
        )
    assert last in held[0].roi
    return costs.medians()


COSTS = [in_search, in_exploration, from_anywhere, of_looks, from_one_vantage, of_a_no]


@pytest.mark.parametrize("cost", COSTS)
def test_a_large_map_costs_no_more_a_frame(cost: Callable[[int], tuple[float, float]]) -> None:
    small, large = cost(SMALL), cost(LARGE)
    assert large[0] <= small[0] * 1.2 + 512
    assert large[1] <= small[1] * 1.2
