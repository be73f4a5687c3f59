"""The exploration tree of Algorithm 1: vertices, states, and the cycle check.

A vertex is a ROI cell; its parent is the cell from which it was first seen. States are the
paper's (section 4.1):

* *unexplored*: known, but nobody has looked from it;
* *under exploration*: looked from, but something below it is still unexplored;
* *explored*: looked from, and so is everything below it.

What is stored are facts that only grow: which cells are vertices, under which parent, and which
were looked from. The state follows from them. So two trees can be joined in any order: a vertex
that two vehicles hung under different parents keeps the one of smaller depth, ties by cell.
Depth falls strictly from child to parent, also after a join, so there is never a cycle.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum

from missions.units import Cell


class VertexState(StrEnum):
    """The paper's three states."""

    UNEXPLORED = "unexplored"
    UNDER_EXPLORATION = "under exploration"
    EXPLORED = "explored"


@dataclass(frozen=True, slots=True)
class Vertex:
    """A vertex: where it hangs, how deep, and whether anybody looked from it."""

    parent: Cell | None
    depth: int
    looked: bool = False


@dataclass(frozen=True, slots=True)
class Tree:
    """An immutable exploration tree.

    >>> tree = Tree.rooted(Cell(0, 0)).looked(Cell(0, 0), [Cell(1, 0), Cell(0, 1)])
    >>> tree.state(Cell(0, 0)).value, tree.state(Cell(1, 0)).value
    ('under exploration', 'unexplored')
    >>> tree.children(Cell(0, 0))
    (Cell(east=0, north=1), Cell(east=1, north=0))
    """

    root: Cell
    vertices: Mapping[Cell, Vertex]
    _children: Mapping[Cell, tuple[Cell, ...]]
    _unexplored_below: Mapping[Cell, int]

    @classmethod
    def rooted(cls, root: Cell) -> Tree:
        """The tree of a single unexplored vertex."""
        return cls.of(root, {root: Vertex(None, 0)})

    @classmethod
    def of(cls, root: Cell, vertices: Mapping[Cell, Vertex]) -> Tree:
        """A tree from its facts."""
        children: dict[Cell, tuple[Cell, ...]] = dict.fromkeys(vertices, ())
        below = dict.fromkeys(vertices, 0)
        for cell, vertex in sorted(vertices.items()):
            if vertex.parent is not None:
                children[vertex.parent] += (cell,)
            if not vertex.looked:
                at: Cell | None = cell
                while at is not None:
                    below[at] += 1
                    at = vertices[at].parent
        ordered = {
            cell: tuple(c for c in cell.neighbours() if c in found)
            for cell, found in children.items()
        }
        return cls(root, dict(vertices), ordered, below)

    def __contains__(self, cell: Cell) -> bool:
        return cell in self.vertices

    def __len__(self) -> int:
        return len(self.vertices)

    def children(self, cell: Cell) -> tuple[Cell, ...]:
        """The children of a vertex, in the order north, east, south, west."""
        return self._children[cell]

    def parent(self, cell: Cell) -> Cell | None:
        """The parent of a vertex, None for the root."""
        return self.vertices[cell].parent

    def has_looked(self, cell: Cell) -> bool:
        """Whether somebody looked from a vertex."""
        return self.vertices[cell].looked

    def is_explored(self, cell: Cell) -> bool:
        """Whether a vertex and everything below it is done."""
        return self._unexplored_below[cell] == 0

    def state(self, cell: Cell) -> VertexState:
        """The state of a vertex."""
        if self.is_explored(cell):
            return VertexState.EXPLORED
        looked = self.vertices[cell].looked
        return VertexState.UNDER_EXPLORATION if looked else VertexState.UNEXPLORED

    @property
    def depth(self) -> int:
        """depth_T: the greatest depth of a vertex."""
        return max(vertex.depth for vertex in self.vertices.values())

    def path_up(self, cell: Cell) -> Iterator[Cell]:
        """The vertex and its ancestors, up to the root."""
        at: Cell | None = cell
        while at is not None:
            yield at
            at = self.vertices[at].parent

    def looked(self, cell: Cell, roi_neighbours: Iterable[Cell]) -> Tree:
        """The tree after somebody looked from `cell` and saw which neighbours are ROI.

        Neighbours that hang in the tree already are left where they are: the cycle check of
        Algorithm 1, lines 9 to 13.
        """
        new = [c for c in roi_neighbours if c not in self.vertices]
        vertex = self.vertices[cell]
        gained = len(new) - (not vertex.looked)
        vertices = {**self.vertices, cell: Vertex(vertex.parent, vertex.depth, True)}
        vertices.update((c, Vertex(cell, vertex.depth + 1)) for c in new)
        below = {**self._unexplored_below, **dict.fromkeys(new, 1)}
        for ancestor in self.path_up(cell):
            below[ancestor] += gained
        kept = {*self._children[cell], *new}
        children = {**self._children, **dict.fromkeys(new, ())}
        children[cell] = tuple(c for c in cell.neighbours() if c in kept)
        return Tree(self.root, vertices, children, below)

    def join(self, other: Tree) -> Tree:
        """What two vehicles know of the tree once they have met.

        Raises ValueError when the two grew from different roots.
        """
        if other.root != self.root:
            raise ValueError(f"trees with different roots: {self.root} and {other.root}")
        vertices = dict(self.vertices)
        for cell, theirs in other.vertices.items():
            mine = vertices.get(cell, theirs)
            above = min((mine.depth, mine.parent or cell), (theirs.depth, theirs.parent or cell))
            parent = None if cell == self.root else above[1]
            vertices[cell] = Vertex(parent, above[0], mine.looked or theirs.looked)
        return Tree.of(self.root, vertices)
