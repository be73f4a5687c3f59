"""Lower bounds that no team can beat, with any method and any knowledge.

`LowerBounds` is for steps from cell to neighbouring cell and takes the largest of three bounds,
each valid by itself. A team of R robots begins and ends at the start; T is the largest number of
steps of a robot. The grid is bipartite, so a closed walk has an even number of steps.

1. *Eccentricity.* A robot goes to the farthest cell and back: T >= 2 ecc(start).
2. *Shell.* One robot visits at least ceil(N / R) of the N cells whose distance is at least d and
   has the parity of d. The way there and back takes 2 d steps, and a step between two of these
   cells at least two. So T >= 2 d - 2 + 2 ceil(N / R).
3. *Blocks.* Contract all cells nearer than d to one vertex. The rest stays bipartite, and the
   closed walks of all robots together visit every vertex of every biconnected block. Within a block
   a closed walk alternates between the colours, so it takes at least 2 max(black, white) steps. Let
   L be their sum. A robot that gets to distance d walks 2 (d - 1) steps more inside the
   contracted ball. So T >= 2 (d - 1) + L / R, rounded up to an even number.

`flight_lower_bound` is for robots that fly straight over all cells between.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from missions.mapping.tree import distances
from missions.planning.stepwise.interface import Metric
from missions.units import Cell

COMPILED_FROM = 5000
"""Number of cells from which on the search for blocks takes longer than loading the compiler."""

_Ints = list[int] | NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Shell:
    """The cells at a distance from the start or farther."""

    distance: int
    same_parity: int
    """Cells at this distance or farther, of the distance's parity."""
    block_steps: int
    """Steps of the shortest closed walks over all blocks, with nearer cells contracted."""


@dataclass(frozen=True, slots=True)
class LowerBounds:
    """The lower bounds of a ROI, for any number of robots.

    >>> row = {Cell(0, 0), Cell(1, 0), Cell(2, 0)}
    >>> LowerBounds.from_roi(row, Cell(0, 0)).moves(robots=3)
    4
    """

    shells: tuple[Shell, ...]
    """Shells by distance, from 1 to the start's eccentricity."""

    @classmethod
    def from_roi(cls, roi: Collection[Cell], start: Cell) -> LowerBounds:
        """Return the bounds of the cells that are connected with `start` in a ROI."""
        steps = distances(roi, start)
        names = {cell: i for i, cell in enumerate(steps)}  # nearest first
        near = [names.get(c, -1) for cell in steps for c in cell.neighbours()]
        return cls(_shells(near, list(steps.values())))

    def moves(self, robots: int) -> int:
        """Return the largest of the three bounds, in steps."""
        return max((self._at(shell, robots) for shell in self.shells), default=0)

    @staticmethod
    def _at(shell: Shell, robots: int) -> int:
        out_and_back = 2 * (shell.distance - 1)
        share = max(
            -(-shell.same_parity // robots),  # never less than 1: the eccentricity's bound
            -(-shell.block_steps // (2 * robots)),
        )
        return out_and_back + 2 * share


def drift_lower_bound(static_moves: float, metric: Metric) -> float:
    """Return the minimum time of a team that needs at least `static_moves` steps on a resting ROI.

    Tours are closed, so a step costs on average at least its cost across the drift: 1 / sqrt(Sr^2 -
    Sp^2).
    """
    return static_moves * metric.least_per_length


def flight_lower_bound(roi: Collection[Cell], start: Cell, robots: int, metric: Metric) -> float:
    """Return the minimum time of the last robot to observe every cell and return in flight.

    A cell's Euclidean distance from the start counts. Let N cells be at distance d or farther. One
    robot visits k >= ceil(N / R) of them. It flies d out and d back. In between it flies k - 1 legs
    of at least the length of a cell, and it observes k times. Over a closed tour a unit of length
    costs at least 1 / sqrt(Sr^2 - Sp^2). The bound is the maximum over d. The observation from the
    start, before any move, is not counted.
    """
    best = 0.0
    for distance, visits in _shares(roi, start, robots):
        length = 2.0 * distance + visits - 1
        best = max(best, length * metric.least_per_length + visits * metric.look)
    return best


def one_way_lower_bound(
    roi: Collection[Cell], start: Cell, robots: int, metric: Metric, breaks: int = 0
) -> float:
    """Return the bound of `flight_lower_bound` for robots that do not return, and may break off.

    An open path may lead with the drift all along: a unit of length costs at least 1 / (Sr + Sp). A
    robot that breaks off, as for a battery, continues anywhere. So every break is worth a leg, and
    after the first one the distance from the start is unknown.
    """
    fastest = 1.0 / (metric.speed + metric.drift_speed)
    best = 0.0
    for distance, visits in _shares(roi, start, robots):
        length = distance + visits - 1 if breaks == 0 else max(visits - 1 - breaks, 0)
        best = max(best, length * fastest + visits * metric.look)
    return best


def _shares(roi: Collection[Cell], start: Cell, robots: int) -> Iterator[tuple[float, int]]:
    """Yield, by Euclidean distance, the number of such or farther cells that one robot has to
    visit."""
    far = sorted(
        math.hypot(cell.east - start.east, cell.north - start.north)
        for cell in roi
        if cell != start
    )
    for i, distance in enumerate(far):
        yield distance, -(-(len(far) - i) // robots)


def _shells(near: list[int], steps: list[int]) -> tuple[Shell, ...]:
    """Return every shell, from the outermost in.

    Cells are numbered by their distance `steps`; `near` has the four neighbours of each, -1 for
    none.

    With all cells nearer than d contracted, the blocks of different components of the rest are
    different blocks. A component that the contracted vertex touches at one cell only has a bridge
    there. The cells behind it have the blocks that they had with the cell contracted. So only
    components with several entries are searched.
    """
    shells: list[Shell] = []
    component = list(range(len(steps)))
    walks = [0] * len(steps)  # of a component, at its representative
    same_parity = [0, 0]
    total = 0
    search = _Search(near, steps)
    end = len(steps)
    while end > 1:
        distance = steps[end - 1]
        begin = end - 1
        while steps[begin - 1] == distance:
            begin -= 1
        entries: dict[int, list[int]] = {}
        for cell in range(begin, end):
            for other in near[4 * cell : 4 * cell + 4]:
                if other >= 0 and steps[other] > distance:
                    a, b = _find(component, cell), _find(component, other)
                    if a != b:
                        component[b] = a
                        walks[a] += walks[b]
        for cell in range(begin, end):
            entries.setdefault(_find(component, cell), []).append(cell)
        for top, cells in entries.items():
            before = walks[top]
            walks[top] = before + 2
            if len(cells) > 1:
                walks[top] = search.block_steps(cells[0], begin, end)
            total += walks[top] - before
        same_parity[distance % 2] += end - begin
        shells.append(Shell(distance, same_parity[distance % 2], total))
        end = begin
    return tuple(reversed(shells))


def _find(component: list[int], cell: int) -> int:
    """Return the representative of a cell's component."""
    while component[cell] != cell:
        component[cell] = component[component[cell]]
        cell = component[cell]
    return cell


class _Search:
    """Repeated `_block_steps` in one ROI, with buffers that are allocated once.

    It is compiled if there is a compiler and enough to do.
    """

    def __init__(self, near: list[int], steps: list[int]) -> None:
        self._count = 0
        self._blocks = _compiled() if len(steps) >= COMPILED_FROM else _block_steps
        room: list[_Ints] = [near, steps, *([0] * len(steps) for _ in range(6))]
        if self._blocks is not _block_steps:
            room = [np.array(values, np.int64) for values in room]
        self._room = room

    def block_steps(self, first: int, begin: int, end: int) -> int:
        """Return the sum over the blocks of the component that has the cell `first`."""
        total, self._count = self._blocks(first, begin, end, self._count, *self._room)
        return int(total)


@cache
def _compiled() -> Callable[..., tuple[int, int]]:
    # numba takes a second to import
    from missions.planning.kernels.jit import COMPILED, kernel  # noqa: PLC0415

    return kernel(_block_steps) if COMPILED else _block_steps


def _block_steps(
    first: int,
    begin: int,
    end: int,
    count: int,
    near: _Ints,
    steps: _Ints,
    order: _Ints,
    low: _Ints,
    above: _Ints,
    place: _Ints,
    turn: _Ints,
    found: _Ints,
) -> tuple[int, int]:
    """Return the sum of 2 max(black, white) over the blocks of one component and the contracted
    vertex.

    Tarjan's search for biconnected components, begun at the contracted vertex, which touches the
    cells `begin` to `end`, of which `first` is one of the component. It numbers the contracted
    vertex `count` and the cells from there on. The last number is returned for the next search.
    """
    base, count = count, count + 1
    order[first], low[first], above[first], turn[first] = count, count, -1, 0
    place[first], found[0] = 0, first
    size, cell, total = 1, first, 0
    while cell >= 0:
        if turn[cell] < 4:
            other = near[4 * cell + turn[cell]]
            turn[cell] += 1
            if other < begin or other == above[cell]:
                continue
            if order[other] > base:
                low[cell] = min(low[cell], order[other])
                continue
            count += 1
            order[other], low[other] = count, base if other < end else count
            above[other], place[other], turn[other] = cell, size, 0
            found[size] = cell = other
            size += 1
            continue
        top = above[cell]
        if top < 0 or low[cell] >= order[top]:
            # the contracted vertex has the other colour than the cells next to it
            black = (steps[begin] - 1 if top < 0 else steps[top]) % 2
            for i in range(place[cell], size):
                black += steps[found[i]] % 2
            total += 2 * max(black, size - place[cell] + 1 - black)
            size = place[cell]
        if top >= 0:
            low[top] = min(low[top], low[cell])
        cell = top
    return total, count


def passing_bound_s(
    ground_m2: float,
    robots: int,
    breaks: int,
    footprint_m: tuple[float, float],
    lean_m: float,
    speed_m_s: float,
    *,
    turned: bool = False,
) -> float:
    """Return the minimum seconds of the last vehicle, by the area bound.

    The bound is that of `missions.lab.arena.time_bounds`.

    Args:
        ground_m2: ground that was seen for the first time, N w^2.
        robots: number of vehicles, at least 1.
        breaks: how often one of them left off and came back.
        footprint_m: the sides of a level picture on the ground, of the highest vehicle.
        lean_m: maximum shift of it by the lean.
        speed_m_s: of the fastest vehicle, above 0.
        turned: whether pictures lie at any angle to the grid.
    """
    east_m, north_m = footprint_m[0] + 2.0 * lean_m, footprint_m[1] + 2.0 * lean_m
    diagonal_m = math.hypot(east_m, north_m)
    at_once_m2 = math.pi * diagonal_m**2 / 4.0 if turned else east_m * north_m
    left_m2 = ground_m2 - (robots + breaks) * at_once_m2
    return max(0.0, left_m2) / (robots * diagonal_m * speed_m_s)
