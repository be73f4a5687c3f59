"""What robots of the arena know, and how it grows: by looks, by meetings, by what they are told."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace

from missions.mapping.tree import Tree
from missions.units import Cell


def look(tree: Tree, cell: Cell, roi: Collection[Cell]) -> Tree:
    """The tree after a noise-free look from a cell.

    >>> len(look(Tree.rooted(Cell(0, 0)), Cell(0, 0), {Cell(0, 0), Cell(0, 1), Cell(5, 5)}))
    2
    """
    return tree.looked(cell, [c for c in cell.neighbours() if c in roi])


@dataclass(frozen=True, slots=True)
class Mind:
    """What a robot, or all of them, know: the tree, where everybody was last heard to be, and what
    the strategy remembers."""

    tree: Tree
    heard: Mapping[int, tuple[float, Cell]]
    memory: object = None
    looked: int = 0
    """The cells that somebody has looked from since the start, a bit each, as `Radio` numbers them;
    0 where there is no radio."""

    def meet(self, other: Mind) -> Mind:
        """What two know together; the strategy's memory is this one's."""
        if other is self:
            return self
        tree = self.tree if other.tree is self.tree else self.tree.join(other.tree)
        heard = {r: max(self.heard[r], other.heard[r]) for r in self.heard}
        return Mind(tree, heard, self.memory, self.looked | other.looked)

    def told(
        self,
        news: Iterable[tuple[Cell, int]],
        heard: Mapping[int, tuple[float, Cell]],
        roi: Collection[Cell],
    ) -> Mind:
        """What a robot knows that is told of looks, each from a cell with its bit, and of places.

        It looks, so to speak, from these cells itself, in the order of the news: its own tree
        grows, and what hangs in it stays where it is. A place that is not in the tree is not heard
        of. Who is told nothing new keeps its very mind.
        """
        tree, looked = self.tree, self.looked
        for cell, bit in news:
            if not looked & bit:
                tree, looked = look(tree, cell, roi), looked | bit
        newer = {
            robot: heard[robot]
            for robot, mine in self.heard.items()
            if heard[robot] is not mine and heard[robot][0] > mine[0] and heard[robot][1] in tree
        }
        if looked == self.looked and not newer:
            return self
        return replace(self, tree=tree, heard={**self.heard, **newer}, looked=looked)

    def done(self, at: Cell) -> bool:
        """Whether a robot that knows this has nothing to do."""
        return at == self.tree.root and self.tree.is_explored(self.tree.root)
