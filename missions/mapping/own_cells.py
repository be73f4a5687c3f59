"""Cells that our own frames have decided: the facts for other members, and no more.

Five votes on each of a thousand cells would fill a narrow radio; decisions are a bit a cell. So a
fact is the decisions of one vehicle's frames within a second. If several vehicles have decided the
same cell, the first counts. It raises no chance of an error. The first has mostly needed three
frames that were alike. These are wrong more rarely than four or five that were not: e^3 against 10
e^3, for votes that err with probability e each.

A cell that is seen in passing, and lies beside no patch, needs no decision. Its sighting is a fact
as well, or another vehicle would fly there to see it.

All frames of a pass decide whether a cell is unsure. So it is a fact once the vehicle has passed,
and again if a later pass changes it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np

from missions.classes import ClassShare
from missions.events import FrameSeen, Vote
from missions.fleet_events import Fact
from missions.mapping.belief import Belief, FrameId
from missions.mapping.frame_sums import FrameSums
from missions.units import Cell

PASSED_S: Final = 4.0
"""Time without a frame of a cell after which the vehicle has passed it, s."""
_TENTHS: Final = 10


@dataclass(slots=True)
class OwnCells:
    """The decisions of one vehicle's frames, from map height and from search height.

    >>> own = OwnCells(Belief(5, 3), Belief(5, 3))
    >>> seen = (Vote(Cell(0, 0), True, 1.0),)
    >>> [own.add(FrameSeen(1, t / 5, None, seen)) for t in range(5)]
    [[], [], [], [], []]
    >>> own.passed(1.2)  # doctest: +NORMALIZE_WHITESPACE
    [Fact(t_s=0.0, votes=((Cell(east=0, north=0), True),), overview=False, seen=False, classes=(),
    doubt=False)]
    """

    low: Belief
    high: Belief
    explored: tuple[int, ...] = ()
    """Numbers of the explored classes; empty if the detector knows the region only."""
    _sums: FrameSums = field(default_factory=FrameSums)
    _second: int = 0
    _decided: dict[bool, dict[Cell, bool]] = field(default_factory=dict)
    """Decisions of the current second, by whether they are from search height."""
    _shown: dict[Cell, float] = field(default_factory=dict)
    """Time of the last frame that showed an undecided cell as no region, if all from below did."""
    _done: set[Cell] = field(default_factory=set)
    """Cells that are decided or that a frame showed as region.

    Reported of them is only a decision, and once that a cell was seen.
    """
    _unsure: dict[Cell, bool] = field(default_factory=dict)
    """The last reported doubt of each cell that a frame from below left unsure."""
    _doubted: dict[Cell, float] = field(default_factory=dict)
    """Time of the last frame that showed such a cell, until the vehicle has passed."""

    def add(self, event: FrameSeen) -> list[Fact]:
        """Add a frame; return the facts of seconds that are over.

        Raises ValueError for a frame from a vantage, which a fleet does not take.
        """
        if event.vantage is not None:
            raise ValueError("a frame from a vantage is no fact of a fleet")
        facts = self.passed(event.t_s)
        self._sums.note(event)
        overview = bool(event.overview)
        before = self.high if overview else self.low
        said = {vote.cell: vote.positive for vote in event.votes}
        if not overview:
            self._unsure |= {c: False for c in event.unsure or () if c not in self._unsure}
            self._doubted |= {c: event.t_s for c in said if c in self._unsure}
        undecided = set(before.undecided(said))
        after = before.with_frame(None, FrameId(event.vehicle, event.t_s), said)
        for cell in sorted(said):
            verdict = after.verdict(cell)
            if verdict is not None and cell in undecided:
                self._decided.setdefault(overview, {})[cell] = verdict
            if not overview and cell not in self._done:
                if verdict is None and not said[cell]:
                    self._shown[cell] = event.t_s
                else:
                    self._shown.pop(cell, None)
                    self._done.add(cell)
        if overview:
            self.high = after
        else:
            self.low = after
        return facts

    def passed(self, t_s: float) -> list[Fact]:
        """Return the facts of the seconds before `t_s` that were not reported yet."""
        second = math.floor(t_s)
        if second <= self._second:
            return []
        at_s, self._second = self._second, second
        decided, self._decided = self._decided, {}
        facts = [
            Fact(float(at_s), tuple(sorted(cells.items())), overview, classes=classes)
            for overview, cells in sorted(decided.items())
            for classes in [() if overview else self._classes(sorted(cells))]
        ]
        gone = sorted(cell for cell, last_s in self._shown.items() if last_s < second - PASSED_S)
        if gone:
            facts.append(Fact(float(at_s), tuple((cell, False) for cell in gone), seen=True))
            self._done.update(gone)
            for cell in gone:
                del self._shown[cell]
        return facts + self._doubts(float(at_s), second - PASSED_S)

    def _doubts(self, at_s: float, until_s: float) -> list[Fact]:
        """Return the facts on cells last shown before `until_s` whose doubt has changed.

        The facts carry the classes that no decision reports.
        """
        passed = sorted(cell for cell, last_s in self._doubted.items() if last_s < until_s)
        if not passed:
            return []
        unsure = self._sums.which_unsure(np.array(passed, np.int32)).tolist()
        reported: dict[bool, dict[Cell, bool]] = {}
        for cell, doubt in zip(passed, unsure, strict=True):
            del self._doubted[cell]
            if self._unsure[cell] is not doubt:
                self._unsure[cell] = doubt
                new = bool(self.explored) and self.low.verdict(cell) is None
                reported.setdefault(new, {})[cell] = doubt
        return [
            Fact(at_s, tuple(cells.items()), classes=classes, doubt=True)
            for new, cells in sorted(reported.items())
            for classes in [self._classes(list(cells)) if new else ()]
        ]

    def _classes(self, cells: Sequence[Cell]) -> tuple[ClassShare, ...]:
        """Return the mean shares of the explored classes so far, in tenths."""
        shares = self._sums.shares(np.array(cells, np.int32), self.explored)
        return tuple(
            ClassShare(cell, number, tenths / _TENTHS)
            for number, column in zip(self.explored, shares.T, strict=True)
            for cell, tenths in zip(cells, np.rint(_TENTHS * column).tolist(), strict=True)
            if tenths > 0.0
        )


def as_frames(vehicle: int, fact: Fact, frames: int, positive: int) -> list[FrameSeen]:
    """Return a fact as the fewest frames that decide its cells, for the map.

    >>> fact = Fact(7.0, ((Cell(0, 0), True), (Cell(1, 0), False)))
    >>> [len(frame.votes) for frame in as_frames(2, fact, 5, 4)]
    [2, 2, 1, 1]
    """
    needed = {True: positive, False: frames - positive + 1}
    high: Literal[True] | None = True if fact.overview else None
    reported = []
    for k in range(max(needed.values())):
        votes = tuple(
            Vote(cell, says, float(says)) for cell, says in fact.votes if k < needed[says]
        )
        if votes:
            t_s = round(fact.t_s + k / 1000.0, 3)
            reported.append(FrameSeen(vehicle, t_s, None, votes, overview=high))
    return reported
