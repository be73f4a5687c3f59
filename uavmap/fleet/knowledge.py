"""A member's knowledge of all facts: by the member whose frames made them, numbered from 0.

Facts only grow, and each counts by itself: one that comes twice, late or out of order changes
nothing. A member's knowledge of another's facts is a few numbers: all below one, and the first runs
beyond it. By these, two members know exactly which facts one lacks.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final, NamedTuple

from missions.fleet_events import Fact

MAX_BEYOND: Final = 5_000
"""Maximum number of a fact beyond the first missing one; a higher one is refused, and comes
again."""
MAX_RUNS: Final = 3
"""Maximum number of runs beyond the first missing fact that are sent."""


class Run(NamedTuple):
    """Facts of one member with consecutive numbers."""

    first: int
    facts: tuple[Fact, ...]


class Holding(NamedTuple):
    """The facts of a member that another holds, by its own report."""

    upto: int = 0
    """All facts below this number are held."""
    beyond: tuple[tuple[int, int], ...] = ()
    """Further runs: the first number of each, and the first after it."""

    def holds(self, number: int) -> bool:
        """Return whether a fact is among them.

        >>> [Holding(2, ((4, 6),)).holds(number) for number in (1, 2, 4, 6)]
        [True, False, True, False]
        """
        return number < self.upto or any(first <= number < end for first, end in self.beyond)

    @property
    def top(self) -> int:
        """First number above all of them."""
        return self.beyond[-1][1] if self.beyond else self.upto


NOTHING: Final = Holding()


@dataclass(slots=True)
class Knowledge:
    """The facts of every member, as far as they are known.

    >>> known = Knowledge()
    >>> known.add(3, 1, [Fact(2.0, ())])  # doctest: +NORMALIZE_WHITESPACE
    [Run(first=1, facts=(Fact(t_s=2.0, votes=(), overview=False, seen=False, classes=(),
    doubt=False),))]
    >>> known.have
    {3: Holding(upto=0, beyond=((1, 2),))}
    >>> [run.first for run in known.add(3, 0, [Fact(1.0, ()), Fact(2.0, ())])], known.have
    ([0], {3: Holding(upto=2, beyond=())})
    """

    facts: dict[int, dict[int, Fact]] = field(default_factory=dict)
    """Facts by their member, and by number."""
    _upto: dict[int, int] = field(default_factory=dict)
    """Number below which no fact of a member is missing."""

    def upto(self, origin: int) -> int:
        """Return the number below which all facts of a member are known."""
        return self._upto.get(origin, 0)

    @property
    def have(self) -> dict[int, Holding]:
        """Holdings of each member with any known fact."""
        return {origin: self._holding(origin) for origin in sorted(self.facts)}

    def _holding(self, origin: int) -> Holding:
        upto, known = self._upto[origin], self.facts[origin]
        if len(known) == upto:
            return Holding(upto)
        beyond = runs_of(sorted(number for number in known if number > upto))
        return Holding(upto, tuple((run[0], run[-1] + 1) for run in beyond[:MAX_RUNS]))

    def add(self, origin: int, first: int, facts: Iterable[Fact]) -> list[Run]:
        """Add facts; return the new ones."""
        known, upto = self.facts.get(origin, {}), self.upto(origin)
        new = {
            number: fact
            for number, fact in enumerate(facts, start=first)
            if number not in known and number < upto + MAX_BEYOND
        }
        if not new:
            return []
        self.facts[origin] = known
        known.update(new)
        while upto in known:
            upto += 1
        self._upto[origin] = upto
        return [Run(run[0], tuple(new[number] for number in run)) for run in runs_of(sorted(new))]

    def runs(self, origin: int, first: int = 0) -> list[Run]:
        """Return the known facts of a member from a number on."""
        known = self.facts.get(origin, {})
        numbers = sorted(number for number in known if number >= first)
        return [Run(run[0], tuple(known[number] for number in run)) for run in runs_of(numbers)]

    def missing(self, theirs: Mapping[int, Holding]) -> dict[int, list[int]]:
        """Return the facts known here that another lacks who holds `theirs`, by member."""
        found = {}
        for origin, known in sorted(self.facts.items()):
            held = theirs.get(origin, NOTHING)
            if held.upto >= self.upto(origin) and len(known) == self.upto(origin):
                continue
            lacks = sorted(number for number in known if not held.holds(number))
            if lacks:
                found[origin] = lacks
        return found

    def lacking(self, theirs: Mapping[int, Holding]) -> bool:
        """Return whether another who holds `theirs` knows facts that are missing here."""
        return any(
            held.upto > self.upto(origin)
            or any(
                number not in self.facts.get(origin, {})
                for first, end in held.beyond
                for number in range(first, min(end, first + MAX_BEYOND))
            )
            for origin, held in theirs.items()
        )


def runs_of(numbers: Sequence[int]) -> list[Sequence[int]]:
    """Return ascending numbers, split where one is left out.

    >>> runs_of([1, 2, 5])
    [[1, 2], [5]]
    """
    ends = [k for k in range(1, len(numbers)) if numbers[k] != numbers[k - 1] + 1]
    parts = pairwise([0, *ends, len(numbers)]) if numbers else ()
    return [numbers[begin:end] for begin, end in parts]
