"""A partition of a team, in flight as on the grid."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Partition:
    """From `begin` to `end` only members of one group hear each other; without groups none do.
    Times are those of the caller: seconds, or the unit of a simulation.

    >>> Partition(10.0, 20.0, (frozenset({0, 1}),)).parts(0, 1, 15.0)
    False
    >>> Partition(10.0, 20.0).parts(0, 1, 15.0)
    True
    """

    begin: float
    end: float
    groups: tuple[frozenset[int], ...] = ()

    def parts(self, one: int, other: int, t: float) -> bool:
        """Whether two cannot hear each other at a time."""
        if not self.begin <= t < self.end:
            return False
        return not any(one in group and other in group for group in self.groups)
