"""What a member knows of the facts of all: by whose frames have made them, numbered from 0.

Facts only grow, and are known up to a number: what comes with a gap before it waits until the gap
is filled. So a few numbers say who has what, two members that compare them know what to tell, and
telling it twice, late or in any order comes to the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from missions.events import Fact

MOST_WAITING = 5_000
"""Facts of one origin that wait for others before them; more are told again later."""


@dataclass(slots=True)
class Knowledge:
    """The facts of every member, as far as they are known without a gap.

    >>> known = Knowledge()
    >>> one, two = Fact(1.0, ()), Fact(2.0, ())
    >>> known.take(3, 1, [two]), known.take(3, 0, [one]), known.have
    ([], [Fact(t_s=1.0, votes=(), overview=False, seen=False), \
Fact(t_s=2.0, votes=(), overview=False, seen=False)], {3: 2})
    """

    facts: dict[int, list[Fact]] = field(default_factory=dict)
    _waiting: dict[int, dict[int, Fact]] = field(default_factory=dict)

    @property
    def have(self) -> dict[int, int]:
        """How many facts of each member are known."""
        return {origin: len(facts) for origin, facts in sorted(self.facts.items()) if facts}

    def take(self, origin: int, first: int, facts: Iterable[Fact]) -> list[Fact]:
        """Take facts in; returns those that are new and have none missing before them.

        The first of what is returned has the number that `have` said before.
        """
        known = self.facts.setdefault(origin, [])
        waiting = self._waiting.setdefault(origin, {})
        for number, fact in enumerate(facts, start=first):
            if number >= len(known) and (number in waiting or len(waiting) < MOST_WAITING):
                waiting.setdefault(number, fact)
        before = len(known)
        while len(known) in waiting:
            known.append(waiting.pop(len(known)))
        return known[before:]

    def missing(self, theirs: Mapping[int, int]) -> dict[int, int]:
        """Of whom another who has `theirs` lacks facts that are known here, and from which on."""
        return {
            origin: theirs.get(origin, 0)
            for origin, count in self.have.items()
            if theirs.get(origin, 0) < count
        }

    def lacking(self, theirs: Mapping[int, int]) -> bool:
        """Whether another who has `theirs` knows facts that are missing here."""
        return any(count > len(self.facts.get(origin, ())) for origin, count in theirs.items())
