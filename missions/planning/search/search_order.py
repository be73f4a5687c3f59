"""Order and direction of lanes that show the region soonest.

The expected time to the first sighting is a sum over all lanes. A term is the lane's probability to
show the region, times its time. This is the minimum latency problem (Blum et al., "The minimum
latency problem", STOC 1994), with lanes for customers. Few lanes are ordered exactly, by a program
over their subsets. More lanes are ordered by a local search over one sequence of lanes and
vehicles. It begins with the plain order and with a greedy one. It reverses a part of the sequence,
or moves a short part elsewhere. All vehicles take off at once; swaps of batteries do not count.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from missions.planning.search.lanes import share_out
from missions.planning.search.prior import LikelyLane
from missions.units import GridPoint

EXACT_LANES: Final = 9
EXACT_VEHICLES: Final = 8
"""Maximum number of vehicles, with as many lanes, that are ordered exactly, in a tenth of a
second."""
LONGEST_MOVED: Final = 3
_MAX_ROUNDS: Final = 50
_MOVES: Final = 2000
_MIN_REACH: Final = 20
_GAIN_S: Final = 1e-9

Block = tuple[LikelyLane, ...]
Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Pace:
    """The speed of lanes and of the ways between them."""

    speed_m_s: float
    pause_s: float
    """Additional time of every lane and of every way to one, s: braking, turning, accelerating."""

    def leg_s(self, distance_m: float) -> float:
        """Return the time for a lane, or for the way to one, s."""
        return distance_m / self.speed_m_s + self.pause_s


def expected_s(blocks: Sequence[Block], homes: Sequence[GridPoint], pace: Pace) -> float:
    """Return the expected time to the first sighting, seconds from being at height over the homes.

    `blocks` holds the lanes of each vehicle in their order, `homes` their starting places.
    """
    total_s = 0.0
    for block, at in zip(blocks, homes, strict=True):
        t_s = 0.0
        for likely in block:
            t_s += pace.leg_s(at.distance_to(likely.lane[0]))
            total_s += likely.probability * (t_s + likely.middle_m / pace.speed_m_s)
            t_s += pace.leg_s(likely.length_m)
            at = likely.lane[1]
    return total_s


def plain_blocks(likely: Sequence[LikelyLane], vehicles: int) -> tuple[Block, ...]:
    """Return the lanes as they are shared out without a prior."""
    rest = iter(likely)
    shared = share_out([lane.lane for lane in likely], vehicles)
    return tuple(tuple(itertools.islice(rest, len(block))) for block in shared)


def soonest(
    likely: Sequence[LikelyLane], homes: Sequence[GridPoint], pace: Pace
) -> tuple[Block, ...]:
    """Return the lanes of each vehicle, in the order and direction that show the region soonest.

    It is never later than `plain_blocks`. Ways between lanes are straight, whatever lies between.

    >>> lanes = [LikelyLane((GridPoint(0, y), GridPoint(40, y)), p, 20.0)
    ...          for y, p in ((0, 0.1), (12, 0.1), (24, 0.8))]
    >>> [lane.lane[0].north_m for lane in soonest(lanes, [GridPoint(0, 12)], Pace(5.0, 0.0))[0]]
    [24, 12, 0]
    """
    plain = plain_blocks(likely, len(homes))
    found = [plain]  # a rounding error must not make it worse
    if len(likely) <= EXACT_LANES and len(homes) <= EXACT_VEHICLES:
        found.append(_exact(likely, homes, pace))
    else:
        tours = _Tours(likely, homes, pace)
        for tour in (tours.sequence(plain), tours.greedy()):
            found.append(tours.blocks(tours.improved(tour)))
    return min(found, key=lambda blocks: expected_s(blocks, homes, pace))


# --- few lanes: exact ----------------------------------------------------------------------------
def _exact(
    likely: Sequence[LikelyLane], homes: Sequence[GridPoint], pace: Pace
) -> tuple[Block, ...]:
    """Return the best of all orders, by a program over subsets.

    While a vehicle flies, time counts for all the probability that it has not seen yet. So the cost
    of a set of lanes from a place does not depend on the way before.
    """
    ways = [(lane, lane.turned) for lane in likely]
    everything = (1 << len(likely)) - 1
    weight = [
        sum(lane.probability for i, lane in enumerate(likely) if mask >> i & 1)
        for mask in range(everything + 1)
    ]

    @functools.cache
    def best(mask: int, at: GridPoint) -> tuple[float, Block]:
        found: tuple[float, Block] = (0.0, ())
        for i, way in enumerate(itertools.chain.from_iterable(ways)):
            lane = i // 2
            if not mask >> lane & 1:
                continue
            rest = mask & ~(1 << lane)
            left_s, block = best(rest, way.lane[1])
            cost_s = (
                pace.leg_s(at.distance_to(way.lane[0])) * weight[mask]
                + way.probability * way.middle_m / pace.speed_m_s
                + pace.leg_s(way.length_m) * weight[rest]
                + left_s
            )
            if not found[1] or cost_s < found[0] - _GAIN_S:
                found = (cost_s, (way, *block))
        return found

    @functools.cache
    def shared(mask: int, vehicle: int) -> tuple[float, tuple[Block, ...]]:
        if vehicle == len(homes) - 1:
            cost_s, block = best(mask, homes[vehicle])
            return cost_s, (block,)
        found: tuple[float, tuple[Block, ...]] | None = None
        mine = mask
        while True:
            cost_s, block = best(mine, homes[vehicle])
            others_s, others = shared(mask & ~mine, vehicle + 1)
            if found is None or cost_s + others_s < found[0] - _GAIN_S:
                found = (cost_s + others_s, (block, *others))
            if mine == 0:
                return found
            mine = (mine - 1) & mask

    return shared(everything, 0)[1]


# --- many lanes: a local search ------------------------------------------------------------------
class _Tours:
    """Sequences of numbers: 2 i is lane i, 2 i + 1 the same reversed, from 2 n on a vehicle.

    A vehicle flies the lanes that follow its number. A batch of sequences has the shape (k, m).
    """

    def __init__(
        self, likely: Sequence[LikelyLane], homes: Sequence[GridPoint], pace: Pace
    ) -> None:
        self._ways = [way for lane in likely for way in (lane, lane.turned)]
        self._vehicles = len(homes)
        # length of a part that is reversed, and distance of a move: with many lanes not all are
        # tried
        self._reach = max(_MIN_REACH, _MOVES // (len(likely) + len(homes)))
        starts = np.asarray([*(way.lane[0] for way in self._ways), *homes], float)
        ends = np.asarray([*(way.lane[1] for way in self._ways), *homes], float)
        legs_m = np.hypot(*np.moveaxis(ends[:, None, :] - starts[None, :, :], 2, 0))
        # to a number from the one before it; no way leads to a vehicle
        self._leg_s: Floats = legs_m / pace.speed_m_s + pace.pause_s
        self._leg_s[:, len(self._ways) :] = 0.0
        none = [0.0] * len(homes)
        self._lane_s = np.asarray([*(pace.leg_s(way.length_m) for way in self._ways), *none])
        self._weight = np.asarray([*(way.probability for way in self._ways), *none])
        self._middle_s = np.asarray([*(way.middle_m / pace.speed_m_s for way in self._ways), *none])

    def sequence(self, blocks: Sequence[Block]) -> Ints:
        """Return the sequence of lanes that are flown in these blocks, in their own direction."""
        numbers = iter(range(0, len(self._ways), 2))
        tour: list[int] = []
        for vehicle, block in enumerate(blocks):
            tour.extend([len(self._ways) + vehicle, *itertools.islice(numbers, len(block))])
        return np.asarray(tour, np.intp)

    def blocks(self, tour: Ints) -> tuple[Block, ...]:
        """Return the lanes of each vehicle."""
        found: list[list[LikelyLane]] = [[] for _ in range(self._vehicles)]
        vehicle = 0
        for number in tour:
            if number >= len(self._ways):
                vehicle = int(number) - len(self._ways)
            else:
                found[vehicle].append(self._ways[number])
        return tuple(tuple(block) for block in found)

    def costs_s(self, tours: Ints) -> Floats:
        """Return the expected time to the first sighting of each sequence of a batch."""
        before, after = tours[:, :-1], tours[:, 1:]
        took_s = self._lane_s[before] + self._leg_s[before, after]
        begun_s = np.cumsum(took_s, axis=1)  # of each number but the first
        first = np.where(after >= len(self._ways), begun_s, 0.0)
        begun_s -= np.maximum.accumulate(first, axis=1)  # every vehicle has its own clock
        costs: Floats = np.sum(self._weight[after] * (begun_s + self._middle_s[after]), axis=1)
        return costs

    def greedy(self) -> Ints:
        """Return the greedy sequence: the first free vehicle flies the lane with the most
        probability a second."""
        free_s = np.zeros(self._vehicles)
        at = [len(self._ways) + vehicle for vehicle in range(self._vehicles)]
        tours = [[number] for number in at]
        left = np.arange(len(self._ways))
        while len(left):
            vehicle = int(np.argmin(free_s))
            took_s = self._leg_s[at[vehicle], left] + self._lane_s[left]
            chosen = int(np.argmax(self._weight[left] / took_s))
            free_s[vehicle] += took_s[chosen]
            at[vehicle] = int(left[chosen])
            tours[vehicle].append(at[vehicle])
            left = left[left // 2 != at[vehicle] // 2]
        return np.asarray([*itertools.chain.from_iterable(tours)], np.intp)

    def improved(self, tour: Ints) -> Ints:
        """Return the sequence after moves that help, place after place, until none does."""
        cost_s = float(self.costs_s(tour[None, :])[0])
        for _ in range(_MAX_ROUNDS):
            before_s = cost_s
            for place, moves in itertools.product(range(1, len(tour)), (self._turned, self._moved)):
                batch = moves(tour, place)
                costs_s = self.costs_s(batch)
                best = int(costs_s.argmin())
                if costs_s[best] < cost_s - _GAIN_S:
                    tour, cost_s = batch[best], float(costs_s[best])
            if cost_s == before_s:
                break
        return tour

    def _flipped(self, part: Ints) -> Ints:
        """Return a part of a sequence from its end to its beginning, its lanes reversed."""
        back = part[::-1]
        return np.where(back < len(self._ways), back ^ 1, back)

    def _turned(self, tour: Ints, place: int) -> Ints:
        ends = range(place + 1, min(len(tour), place + self._reach) + 1)
        batch = np.repeat(tour[None, :], len(ends), axis=0)
        for row, end in zip(batch, ends, strict=True):
            row[place:end] = self._flipped(row[place:end])
        return batch

    def _moved(self, tour: Ints, place: int) -> Ints:
        """Return the sequences with a short part at a place moved elsewhere, reversed or not.

        The first vehicle stays first. Without a move it is the sequence itself.
        """
        found = [tour]
        for length in range(1, min(LONGEST_MOVED, len(tour) - place) + 1):
            part = tour[place : place + length]
            rest = np.delete(tour, slice(place, place + length))
            for way in (part, self._flipped(part)):
                found.extend(
                    np.concatenate((rest[:to], way, rest[to:]))
                    for to in range(
                        max(1, place - self._reach), min(len(rest), place + self._reach) + 1
                    )
                )
        return np.asarray(found, np.intp)
