"""What robots of the arena know, and how it grows: by looks, meetings and news."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace

from missions.mapping.tree import Tree
from missions.units import Cell


def look(tree: Tree, cell: Cell, roi: Collection[Cell]) -> Tree:
    """The tree after a noise-free look from a cell."""
    return tree.looked(cell, [c for c in cell.neighbours() if c in roi])


@dataclass(frozen=True, slots=True)
class Mind:
    """The tree, the last known places and the strategy's memory, of one robot or of all."""

    tree: Tree
    heard: Mapping[int, tuple[float, Cell]]
    memory: object = None
    looked: int = 0
    """The cells that were looked from, a bit each as `Radio` numbers them; 0 without a radio."""

    def meet(self, other: Mind) -> Mind:
        """The joined knowledge of two; the strategy's memory is this one's."""
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
        """This mind after news of looks (cells with their bits) and of places.

        The robot looks from these cells itself, so to speak, in the order of the news: what hangs
        in its tree stays there. Places outside the tree are ignored. Without news it is `self`.
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
        """Whether a robot at a cell has nothing to do."""
        return at == self.tree.root and self.tree.is_explored(self.tree.root)
