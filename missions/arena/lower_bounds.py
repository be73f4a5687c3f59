"""Lower bounds: what no team can beat, however clever and whatever it knows beforehand.

`LowerBounds` is for steps from cell to neighbouring cell and takes the largest of three bounds,
each valid by itself. A team of R robots begins and ends at the start; T is the largest number of
steps of a robot. The grid is bipartite, so a closed walk has an even number of steps.

1. *Eccentricity.* Somebody goes to the farthest cell and back: T >= 2 ecc(start).
2. *Shell.* Somebody visits at least ceil(N / R) of the N cells whose distance is at least d and has
   the parity of d. The way there and back takes 2 d steps, and from one of these cells to the
   next it is at least two: T >= 2 d - 2 + 2 ceil(N / R).
3. *Blocks.* Contract all cells nearer than d to one vertex. What is left stays bipartite, and the
   closed walks of all robots together visit every vertex of every biconnected block. Within a
   block a closed walk alternates between the colours, so it takes at least 2 max(black, white)
   steps; let L be their sum. Who gets so far walks 2 (d - 1) steps more inside of the contracted
   ball: T >= 2 (d - 1) + L / R, rounded up to an even number.

`flight_lower_bound` is for robots that fly straight over whatever lies between.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

from missions.explorers.grid_paths import distances
from missions.explorers.metric import Metric
from missions.units import Cell


@dataclass(frozen=True, slots=True)
class Shell:
    """What lies at a distance from the start or farther."""

    distance: int
    same_parity: int
    """Cells at this distance or farther, of the distance's parity."""
    block_steps: int
    """Steps of the shortest closed walks over all blocks, with what is nearer contracted."""


@dataclass(frozen=True, slots=True)
class LowerBounds:
    """The lower bounds of a ROI, for any number of robots.

    >>> row = {Cell(0, 0), Cell(1, 0), Cell(2, 0)}
    >>> LowerBounds.of(row, Cell(0, 0)).moves(robots=3)
    4
    """

    shells: tuple[Shell, ...]
    """By distance, from 1 to the start's eccentricity."""

    @classmethod
    def of(cls, roi: Collection[Cell], start: Cell) -> LowerBounds:
        """The bounds of what hangs together with `start` in a ROI."""
        steps = distances(roi, start)
        names = {cell: i for i, cell in enumerate(steps)}  # nearest first
        near = [[names[c] for c in cell.neighbours() if c in names] for cell in steps]
        return cls(_shells(near, list(steps.values())))

    def moves(self, robots: int) -> int:
        """The largest of the three bounds, in steps."""
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
    """Time that a team needs at least whose steps on a resting ROI number `static_moves`.

    Tours are closed, so a step costs on average at least what it costs across the drift:
    1 / sqrt(Sr^2 - Sp^2).

    >>> drift_lower_bound(8, Metric(speed=1.0, drift_east=0.6))
    10.0
    """
    return static_moves * metric.least_per_length


def flight_lower_bound(roi: Collection[Cell], start: Cell, robots: int, metric: Metric) -> float:
    """Time that the last robot needs at least to look from every cell and return in flight.

    A cell's Euclidean distance from the start counts. Of the N cells at distance d or farther
    somebody visits k >= ceil(N / R); it flies d out, d back, and in between k - 1 legs of at least
    the length of a cell; and it looks k times. Over a closed tour a unit of length costs at least
    1 / sqrt(Sr^2 - Sp^2). The largest of these over all d. The look from the start, which comes
    before any move, is not counted.

    >>> flight_lower_bound([Cell(1, 0), Cell(2, 0)], Cell(0, 0), 1, Metric(straight=True))
    4.0
    """
    best = 0.0
    for distance, visits in _shares(roi, start, robots):
        length = 2.0 * distance + visits - 1
        best = max(best, length * metric.least_per_length + visits * metric.look)
    return best


def one_way_lower_bound(
    roi: Collection[Cell], start: Cell, robots: int, metric: Metric, breaks: int = 0
) -> float:
    """As `flight_lower_bound`, but nobody returns, and the way may be broken off.

    A way that does not close may lead with the drift all along: a unit of length costs at least
    1 / (Sr + Sp). Who breaks off, as for a battery, goes on anywhere: every break is worth a leg,
    and with the first one nothing is known of the way from the start.
    """
    fastest = 1.0 / (metric.speed + metric.drift_speed)
    best = 0.0
    for distance, visits in _shares(roi, start, robots):
        length = distance + visits - 1 if breaks == 0 else max(visits - 1 - breaks, 0)
        best = max(best, length * fastest + visits * metric.look)
    return best


def _shares(roi: Collection[Cell], start: Cell, robots: int) -> Iterator[tuple[float, int]]:
    """By Euclidean distance: how many cells so far or farther somebody has to visit."""
    far = sorted(
        math.hypot(cell.east - start.east, cell.north - start.north)
        for cell in roi
        if cell != start
    )
    for i, distance in enumerate(far):
        yield distance, -(-(len(far) - i) // robots)


def _shells(near: Sequence[Sequence[int]], steps: Sequence[int]) -> tuple[Shell, ...]:
    """Every shell, from the outermost in. `near` are the neighbours of cells that are numbered by
    their distance `steps`.

    With everything nearer than d contracted, the blocks of different components of the rest are
    different blocks. A component that the contracted vertex touches at one cell only has a bridge
    there, and what hangs on the cell has the blocks that it had with the cell contracted. So only
    components with several entries are searched.
    """
    shells: list[Shell] = []
    component = list(range(len(near)))
    walks = [0] * len(near)  # of a component, at its representative
    same_parity = [0, 0]
    total = 0
    end = len(near)
    while end > 1:
        distance = steps[end - 1]
        begin = end - 1
        while steps[begin - 1] == distance:
            begin -= 1
        entries: dict[int, list[int]] = {}
        for cell in range(begin, end):
            for other in near[cell]:
                if steps[other] > distance:
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
                walks[top] = _block_steps(near, steps, cells[0], begin, end)
            total += walks[top] - before
        same_parity[distance % 2] += end - begin
        shells.append(Shell(distance, same_parity[distance % 2], total))
        end = begin
    return tuple(reversed(shells))


def _find(component: list[int], cell: int) -> int:
    """The representative of a cell's component."""
    while component[cell] != cell:
        component[cell] = component[component[cell]]
        cell = component[cell]
    return cell


def _block_steps(
    near: Sequence[Sequence[int]], steps: Sequence[int], first: int, begin: int, end: int
) -> int:
    """The sum of 2 max(black, white) over the blocks of one component and the contracted vertex.

    Tarjan's search for biconnected components, begun at the contracted vertex, which the search
    numbers 0; it touches the cells `begin` to `end`, of which `first` is one of the component.
    """
    order = [0] * len(near)
    low = [0] * len(near)
    above = [-1] * len(near)
    place = [0] * len(near)
    rest: list[Iterator[int]] = [iter(())] * len(near)
    order[first] = low[first] = count = 1
    rest[first] = iter(near[first])
    found = [first]
    cell, total = first, 0
    while True:
        for other in rest[cell]:
            if other < begin or other == above[cell]:
                continue
            if order[other]:
                low[cell] = min(low[cell], order[other])
                continue
            count += 1
            order[other] = count
            low[other] = 0 if other < end else count
            above[other], place[other], rest[other] = cell, len(found), iter(near[other])
            found.append(other)
            cell = other
            break
        else:
            top = above[cell]
            if top < 0 or low[cell] >= order[top]:
                # the contracted vertex is of the colour that the cells next to it are not of
                odd = (steps[begin] - 1 if top < 0 else steps[top]) % 2
                black = odd + sum(steps[c] % 2 for c in found[place[cell] :])
                total += 2 * max(black, len(found) - place[cell] + 1 - black)
                del found[place[cell] :]
            if top < 0:
                return total
            low[top] = min(low[top], low[cell])
            cell = top
