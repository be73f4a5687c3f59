"""What an explorer is: a rule that says where a robot at a vertex moves next.

Flight, replay and simulation call the same rule, so what the flight runs is what the simulation
measures. An explorer is pure and keeps nothing between calls.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from missions.tree import Tree
from missions.units import Cell


class Explorer(Protocol):
    """A strategy. `guarantee` and `source` are shown to the user."""

    @property
    def name(self) -> str:
        """The name on the command line."""
        ...

    @property
    def guarantee(self) -> str:
        """What it promises, in a line."""
        ...

    @property
    def source(self) -> str:
        """Where it comes from."""
        ...

    def moves(
        self, tree: Tree, at: Mapping[int, Cell], robots: Sequence[int]
    ) -> Mapping[int, Cell | None]:
        """Where each of `robots` moves from its vertex, which has been looked from.

        `at` holds for every robot of the team the vertex where it is or to which it moves;
        `robots` are those that decide now, in ascending order. A move is to a child or to the
        parent of the vertex; None at the root when all is explored.
        """
        ...
