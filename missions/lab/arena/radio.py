"""Radio between the robots of the arena: range, loss, partitions, delay, and rate.

At each instant (an arrival, or a whole unit of time) pairs in contact are drawn, both ways. Lost
news is sent again at the next instant; a robot relays all that it knows. News is the cells that
robots have observed, and thus which of their neighbours are ROI. A robot gets no news that it has
or that is on its way. Others' knowledge and positions come with every message and cost nothing.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from missions.fleet_events import Partition
from missions.mapping.tree import Tree
from missions.units import Cell


def observe(tree: Tree, cell: Cell, roi: Collection[Cell]) -> Tree:
    """Return the tree after a noise-free observation of a cell."""
    return tree.with_observation(cell, [c for c in cell.neighbours() if c in roi])


@dataclass(frozen=True, slots=True)
class Mind:
    """The tree, the last known places and the strategy's memory, of one robot or of all."""

    tree: Tree
    known_at: Mapping[int, tuple[float, Cell]]
    memory: object = None
    observed: int = 0
    """Observed cells, a bit each as `Radio` numbers them; 0 without a radio."""

    def meet(self, other: Mind) -> Mind:
        """Return the joined knowledge of two; the strategy's memory is this one's."""
        if other is self:
            return self
        tree = self.tree if other.tree is self.tree else self.tree.join(other.tree)
        known_at = {r: max(self.known_at[r], other.known_at[r]) for r in self.known_at}
        return Mind(tree, known_at, self.memory, self.observed | other.observed)

    def with_news(
        self,
        news: Iterable[tuple[Cell, int]],
        known_at: Mapping[int, tuple[float, Cell]],
        roi: Collection[Cell],
    ) -> Mind:
        """Return this mind after news of observations (cells with their bits) and of places.

        The robot adds these cells as its own observations, in the order of the news: cells in its
        tree stay there. Places outside the tree are ignored. Without news it is `self`.
        """
        tree, observed = self.tree, self.observed
        for cell, bit in news:
            if not observed & bit:
                tree, observed = observe(tree, cell, roi), observed | bit
        newer = {
            robot: known_at[robot]
            for robot, mine in self.known_at.items()
            if known_at[robot] is not mine
            and known_at[robot][0] > mine[0]
            and known_at[robot][1] in tree
        }
        if observed == self.observed and not newer:
            return self
        return replace(self, tree=tree, known_at={**self.known_at, **newer}, observed=observed)

    def done(self, at: Cell) -> bool:
        """Return whether a robot at a cell has nothing to do."""
        return at == self.tree.root and self.tree.is_explored(self.tree.root)


_SAME_INSTANT: Final = 1e-9
_NEAR: Final = 1e-9
"""Distance that counts as 0, cells: places are computed."""

Pairs = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Links:
    """The quality of the radio; lengths in cells, times in the unit of the metric.

    Robots at one vertex share everything, with any radio.
    """

    range_cells: float = math.inf
    """Range between the centres of two robots, in a straight line."""
    loss: float = 0.0
    """The share of exchanges that fail, drawn for each pair at each instant."""
    delay: float = 0.0
    """Time from a send to the first instant after which the news is known."""
    rate: float = math.inf
    """Cells of news that a robot can send in a unit of time, to all in contact."""
    apart: tuple[Partition, ...] = ()
    seed: int = 0

    @property
    def at_once(self) -> bool:
        """True if robots in contact know the same at once, and decide together."""
        return self.delay == 0.0 and math.isinf(self.rate)


@dataclass(frozen=True, slots=True)
class _Message:
    due_t: float
    receiver: int
    news: tuple[tuple[Cell, int], ...]
    known_at: Mapping[int, tuple[float, Cell]]


@dataclass(slots=True)
class Radio:
    """The radio of a run, from instant to instant."""

    links: Links
    roi: Collection[Cell]
    touch: dict[int, tuple[int, ...]] = field(default_factory=dict)
    """Robots in contact at each robot at this instant, also by relays, and itself."""
    _reach: Pairs = field(init=False)
    _receivers: Pairs = field(init=False)
    _cells: tuple[Cell, ...] = field(init=False)
    _bits: dict[Cell, int] = field(init=False)
    _random: np.random.Generator = field(init=False)
    _spare: dict[int, float] = field(default_factory=dict)
    _t: float = 0.0
    _on_the_way: deque[_Message] = field(default_factory=deque)
    _coming: dict[int, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._reach = self._receivers = np.zeros((0, 0), dtype=np.bool_)
        self._cells = tuple(sorted(self.roi))
        self._bits = {cell: 1 << number for number, cell in enumerate(self._cells)}
        self._random = np.random.default_rng(self.links.seed)

    def bit(self, cell: Cell) -> int:
        """Return the bit of a cell in `Mind.observed`."""
        return self._bits[cell]

    def tune(
        self, t: float, places: Mapping[int, tuple[float, float]], at: Mapping[int, Cell]
    ) -> None:
        """Draw which robots are in contact at an instant.

        `places` are those of all robots 0, 1, ...; `at` the vertices of those that are at one.
        """
        links, robots = self.links, len(places)
        reach = self._in_reach(t, places)
        kept = np.full_like(reach, links.loss < 1.0)
        if 0.0 < links.loss < 1.0:
            kept = np.tril(self._random.random((robots, robots)) >= links.loss)
            kept |= kept.T
        here = np.array([at.get(r, Cell(0, 0)) for r in range(robots)])
        stands = np.array([r in at for r in range(robots)])
        meets = (here[:, None, :] == here[None, :, :]).all(axis=2)
        meets &= stands[:, None] & stands[None, :]
        self._reach, self._receivers = reach | meets, (reach & kept) | meets
        most = max(links.rate, 1.0)
        for robot in range(robots):
            spare = self._spare.get(robot, most) + links.rate * (t - self._t)
            self._spare[robot] = min(spare, most) if math.isfinite(links.rate) else math.inf
        self._t = t
        self.touch = {r: group for group in self._groups() for r in group}

    def _in_reach(self, t: float, places: Mapping[int, tuple[float, float]]) -> Pairs:
        robots = range(len(places))
        east, north = np.array([places[r] for r in robots]).T
        away = np.hypot(east[:, None] - east[None, :], north[:, None] - north[None, :])
        reach = np.asarray(away <= self.links.range_cells + _NEAR)
        for apart in self.links.apart:
            if apart.begin <= t < apart.end:
                reach &= [[not apart.parts(one, other, t) for one in robots] for other in robots]
        return reach

    def _groups(self) -> Iterator[tuple[int, ...]]:
        left = np.ones(len(self._receivers), dtype=np.bool_)
        for first in range(len(left)):
            if not left[first]:
                continue
            group, todo = [first], [first]
            left[first] = False
            while todo:
                fresh = np.flatnonzero(self._receivers[todo.pop()] & left).tolist()
                left[fresh] = False
                group += fresh
                todo += fresh
            yield tuple(sorted(group))

    def together(self, robot: int) -> tuple[int, ...]:
        """Return the robots that decide with one because they are in contact at once; else none."""
        return self.touch[robot] if self.links.at_once else ()

    def deliver(self, minds: dict[int, Mind], done: Collection[int] = ()) -> None:
        """Deliver the news of this instant, before any observations.

        A group that knows the same at once has one memory: that of its first robot that is not
        `done`. So a robot in flight never forgets its target, and returns. The memory of a robot
        that is done may be out of date and send others back and forth without end.
        """
        if self.links.at_once:
            for group in sorted(set(self.touch.values())):
                leader = next((r for r in group if r not in done), group[0])
                self._share(leader, group, minds)
        while self._on_the_way and self._on_the_way[0].due_t <= self._t + _SAME_INSTANT:
            message = self._on_the_way.popleft()
            receiver = message.receiver
            minds[receiver] = minds[receiver].with_news(message.news, message.known_at, self.roi)

    def _share(self, leader: int, group: Sequence[int], minds: dict[int, Mind]) -> None:
        """Give a group one mind, with the memory of its leader."""
        mind = minds[leader]
        for robot in group:
            other = minds[robot]
            if other is not mind:
                news = self._news(other, other.observed & ~mind.observed)
                mind = mind.with_news(news, other.known_at, self.roi)
        for robot in group:
            minds[robot] = mind

    def send_places(self, robot: int, minds: dict[int, Mind]) -> None:
        """Without a delay, send the places that a robot knows to those in touch with it."""
        if self.links.delay == 0.0:
            for other in self.touch[robot]:
                minds[other] = minds[other].with_news((), minds[robot].known_at, self.roi)

    def send(self, minds: dict[int, Mind]) -> None:
        """Have every robot send its news; without a delay it arrives, and is relayed, at once.

        Robots with shared knowledge have done so already.
        """
        if self.links.at_once:
            return
        sent = dict.fromkeys(minds, 0)
        news_left = True
        while news_left:
            news_left = False
            for sender in sorted(minds):
                news_left |= self._send_one(sender, minds, sent)
            if self.links.delay == 0.0:
                self.deliver(minds)
            else:
                news_left = False

    def _send_one(self, sender: int, minds: Mapping[int, Mind], sent: dict[int, int]) -> bool:
        """Send one message: news nearest to the root first, so that it fits the receiver's tree.

        Return True if it held any news.
        """
        mind = minds[sender]
        lacks = {
            receiver: mind.observed & ~(minds[receiver].observed | self._coming.get(receiver, 0))
            for receiver in np.flatnonzero(self._reach[sender]).tolist()
            if receiver != sender
        }
        wanted = 0
        for cells in lacks.values():
            wanted |= cells
        news = self._news(mind, wanted & ~sent[sender])
        if len(news) > self._spare[sender]:
            news = news[: int(self._spare[sender] + _NEAR)]
        self._spare[sender] -= len(news)
        for _, bit in news:
            sent[sender] |= bit
        for receiver, cells in lacks.items():
            if self._receivers[sender, receiver]:
                mine = tuple((cell, bit) for cell, bit in news if cells & bit)
                for _, bit in mine:
                    self._coming[receiver] = self._coming.get(receiver, 0) | bit
                due_t = self._t + self.links.delay
                self._on_the_way.append(_Message(due_t, receiver, mine, mind.known_at))
        return bool(news)

    def _news(self, mind: Mind, wanted: int) -> list[tuple[Cell, int]]:
        """Return cells of some bits, by depth in a robot's tree."""
        found = []
        while wanted:
            bit = wanted & -wanted
            wanted ^= bit
            found.append((self._cells[bit.bit_length() - 1], bit))
        vertices = mind.tree.vertices
        return sorted(found, key=lambda each: (vertices[each[0]].depth, each[0]))
