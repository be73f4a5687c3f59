"""The exploration tree of Algorithm 1: vertices, states, and the cycle check.

A vertex is a ROI cell; its parent is the cell from which it was first seen. States are the paper's
(section 4.1):

* *unexplored*: known, but not observed from above;
* *under exploration*: observed, but something below it is still unexplored;
* *explored*: observed, and so is everything below it.

Stored are facts that only grow: which cells are vertices, under which parent, and which were
observed. The state follows from them. So two trees can be joined in any order. A vertex that two
vehicles placed under different parents keeps the one of smaller depth, ties by cell. Depth falls
strictly from child to parent, also after a join, so there is no cycle.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Container, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum

from missions.mapping.belief import Belief
from missions.mapping.persistent import PersistentMap
from missions.units import Cell


class VertexState(StrEnum):
    """The paper's three states."""

    UNEXPLORED = "unexplored"
    UNDER_EXPLORATION = "under exploration"
    EXPLORED = "explored"


@dataclass(frozen=True, slots=True)
class Vertex:
    """A vertex: its parent, its depth, and whether a vehicle has observed it."""

    parent: Cell | None
    depth: int
    observed: bool = False


@dataclass(frozen=True, slots=True)
class Tree:
    """An immutable exploration tree.

    >>> tree = Tree.rooted(Cell(0, 0)).with_observation(Cell(0, 0), [Cell(1, 0), Cell(0, 1)])
    >>> tree.state(Cell(0, 0)).value, tree.state(Cell(1, 0)).value
    ('under exploration', 'unexplored')
    >>> tree.children(Cell(0, 0))
    (Cell(east=0, north=1), Cell(east=1, north=0))
    """

    root: Cell
    vertices: PersistentMap[Cell, Vertex]
    _children: PersistentMap[Cell, tuple[Cell, ...]]
    _unfinished: PersistentMap[Cell, int]
    """Number of unfinished items by vertex: itself until observed, and each unexplored child.

    A find below a vertex changes it, and those above it, only as far as it makes them unfinished or
    done.
    """

    @classmethod
    def rooted(cls, root: Cell) -> Tree:
        """Return the tree of a single unexplored vertex."""
        return cls.from_vertices(root, {root: Vertex(None, 0)})

    @classmethod
    def from_vertices(cls, root: Cell, vertices: Mapping[Cell, Vertex]) -> Tree:
        """Return a tree from its facts."""
        facts = vertices.items()
        children: dict[Cell, set[Cell]] = {cell: set() for cell in vertices}
        unfinished: dict[Cell, int] = {}
        for cell, vertex in facts:
            unfinished[cell] = int(not vertex.observed)
            if vertex.parent is not None:
                children[vertex.parent].add(cell)
        for cell, vertex in sorted(facts, key=lambda fact: -fact[1].depth):
            if vertex.parent is not None and unfinished[cell]:
                unfinished[vertex.parent] += 1
        ordered = {
            cell: tuple(c for c in cell.neighbours() if c in found)
            for cell, found in children.items()
        }
        return cls(root, PersistentMap(vertices), PersistentMap(ordered), PersistentMap(unfinished))

    def __contains__(self, cell: object) -> bool:
        return cell in self.vertices

    def __len__(self) -> int:
        return len(self.vertices)

    def children(self, cell: Cell) -> tuple[Cell, ...]:
        """Return the children of a vertex, in the order north, east, south, west."""
        return self._children[cell]

    def parent(self, cell: Cell) -> Cell | None:
        """Return the parent of a vertex, None for the root."""
        return self.vertices[cell].parent

    def is_observed(self, cell: Cell) -> bool:
        """Return whether a vehicle has observed a vertex."""
        return self.vertices[cell].observed

    def is_explored(self, cell: Cell) -> bool:
        """Return whether a vertex and everything below it is done."""
        return self._unfinished[cell] == 0

    def state(self, cell: Cell) -> VertexState:
        """Return the state of a vertex."""
        if self.is_explored(cell):
            return VertexState.EXPLORED
        looked = self.vertices[cell].observed
        return VertexState.UNDER_EXPLORATION if looked else VertexState.UNEXPLORED

    @property
    def depth(self) -> int:
        """Maximum depth of a vertex: depth_T."""
        return max(vertex.depth for vertex in self.vertices.values())

    def path_up(self, cell: Cell) -> Iterator[Cell]:
        """Yield the vertex and its ancestors, up to the root."""
        at: Cell | None = cell
        while at is not None:
            yield at
            at = self.vertices[at].parent

    def with_observation(self, cell: Cell, roi_neighbours: Iterable[Cell]) -> Tree:
        """Return the tree after an observation of `cell` that saw which neighbours are ROI.

        Neighbours that are in the tree already stay where they are: the cycle check of Algorithm 1,
        lines 9 to 13.
        """
        vertex = self.vertices[cell]
        new = dict.fromkeys(c for c in roi_neighbours if c not in self.vertices)
        kept = {*self._children[cell], *new}
        children = dict.fromkeys(new, ()) | {cell: tuple(c for c in cell.neighbours() if c in kept)}
        vertices = {cell: replace(vertex, observed=True)} | dict.fromkeys(
            new, Vertex(cell, vertex.depth + 1)
        )
        unfinished = self._unfinished_after(cell, len(new) - (not vertex.observed))
        return Tree(
            self.root,
            self.vertices.updated(vertices),
            self._children.updated(children),
            self._unfinished.updated(unfinished | dict.fromkeys(new, 1)),
        )

    def _unfinished_after(self, cell: Cell, gained: int) -> dict[Cell, int]:
        """Return the changed counts after `gained` more unfinished items below a vertex."""
        changed: dict[Cell, int] = {}
        at: Cell | None = cell
        while at is not None and gained:
            before = self._unfinished[at]
            changed[at] = after = before + gained
            gained = (after > 0) - (before > 0)
            at = self.vertices[at].parent
        return changed

    def join(self, other: Tree) -> Tree:
        """Return the joint knowledge of two vehicles on the tree.

        Raises ValueError when the two grew from different roots.
        """
        if other.root != self.root:
            raise ValueError(f"trees with different roots: {self.root} and {other.root}")
        vertices = dict(self.vertices.items())
        for cell, theirs in other.vertices.items():
            mine = vertices.get(cell, theirs)
            above = min((mine.depth, mine.parent or cell), (theirs.depth, theirs.parent or cell))
            parent = None if cell == self.root else above[1]
            vertices[cell] = Vertex(parent, above[0], mine.observed or theirs.observed)
        return Tree.from_vertices(self.root, vertices)


# --- breadth first over cells: what is reached, in how many steps, and by which way -------------
def reached(
    near: Callable[[Cell], Iterable[Cell]], start: Cell, until: Collection[Cell] = ()
) -> dict[Cell, int]:
    """Return the steps from `start` to every reached cell, nearest first, by the neighbours `near`.

    With `until` the search ends at the nearest of these.

    >>> reached(lambda cell: [Cell(cell.east + 1, 0)], Cell(0, 0), until=[Cell(2, 0)])[Cell(2, 0)]
    2
    """
    steps, count = {start: 0}, 0
    ring = [start]
    while ring and not (until and any(cell in until for cell in ring)):
        count += 1
        outer = []
        for cell in ring:
            for other in near(cell):
                if other not in steps:
                    steps[other] = count
                    outer.append(other)
        ring = outer
    return steps


def neighbours_in(known: Container[Cell]) -> Callable[[Cell], list[Cell]]:
    """Return the rule for `reached` that keeps to `known` cells."""
    return lambda cell: [near for near in cell.neighbours() if near in known]


def distances(known: Container[Cell], start: Cell) -> dict[Cell, int]:
    """Return the steps from `start` to every cell reached over `known` cells, nearest first."""
    return reached(neighbours_in(known), start)


def step_towards(known: Container[Cell], start: Cell, goal: Cell) -> Cell:
    """Return the first cell on a shortest way from `start` to `goal`.

    Of several it is the first in the order north, east, south, west.
    """
    if start == goal:
        return start
    steps = reached(neighbours_in(known), goal, until=[start])
    return min((near for near in start.neighbours() if near in steps), key=lambda near: steps[near])


def step_home(tree: Tree, start: Cell) -> Cell | None:
    """Return the next cell on a shortest known way to the root, None at the root."""
    return None if start == tree.root else step_towards(tree, start, tree.root)


def patches(cells: Collection[Cell]) -> tuple[frozenset[Cell], ...]:
    """Return the patches of some cells, largest first; of equal ones that with the lowest cell.

    >>> found = patches([Cell(0, 0), Cell(5, 5), Cell(5, 6), Cell(1, 1)])
    >>> [sorted(patch)[0] for patch in found]
    [Cell(east=5, north=5), Cell(east=0, north=0), Cell(east=1, north=1)]
    """
    left = set(cells)
    found: list[frozenset[Cell]] = []
    while left:
        patch, asked = set(), [left.pop()]
        while asked:
            cell = asked.pop()
            patch.add(cell)
            near = [n for n in cell.neighbours() if n in left]
            left.difference_update(near)
            asked.extend(near)
        found.append(frozenset(patch))
    return tuple(sorted(found, key=lambda patch: (-len(patch), min(patch))))


def beside(cells: Iterable[Cell]) -> set[Cell]:
    """Return the neighbours of some cells."""
    steps = Cell(0, 0).neighbours()
    return {Cell(e + east, n + north) for e, n in cells for east, north in steps}


def grown(tree: Tree, belief: Belief, fresh: Iterable[Cell]) -> Tree:
    """Return the tree in which vertices count as visited whose neighbours are all decided."""
    verdicts, region = belief.verdicts, belief.roi.as_dict()
    (_, *steps) = cross = Cell(0, 0).cross()
    asked = [Cell(e + east, n + north) for e, n in fresh for east, north in cross]
    while asked:
        e, n = cell = asked.pop()
        if cell not in tree or tree.is_observed(cell):
            continue
        near = [Cell(e + east, n + north) for east, north in steps]
        if any(verdicts.get(each) is None for each in near):
            continue
        roi = [each for each in near if each in region]
        asked.extend(each for each in roi if each not in tree)
        tree = tree.with_observation(cell, roi)
    return tree


def left_out(tree: Tree, belief: Belief) -> tuple[Tree, set[Cell]]:
    """Return the tree with every vertex visited, and region beside one a vertex as well.

    Return also the vertices that no vehicle has observed.
    """
    given_up: set[Cell] = set()
    left = [cell for cell, vertex in tree.vertices.items() if not vertex.observed]
    while left:
        cell = left.pop()
        if tree.is_observed(cell):
            continue
        given_up.add(cell)
        roi = [near for near in cell.neighbours() if near in belief.roi]
        left.extend(near for near in roi if near not in tree)
        tree = tree.with_observation(cell, roi)
    return grown(tree, belief, list(tree.vertices)), given_up
