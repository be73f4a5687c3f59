"""Backbone and ribs of an exploration tree, and where to draw them.

After Sung and Tokekar, section 4.2 (the terms are Higashikawa's): a backbone is a path from the
root to a leaf, the ribs are the subtrees that are left when it is taken away. Of all backbones the
longest is meant here, whose length is depth_T.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from typing import NamedTuple

from missions.mapping.tree import Tree
from missions.units import Cell


def backbone(tree: Tree) -> tuple[Cell, ...]:
    """The longest path from the root down to a leaf; of several, that to the least cell.

    >>> tree = Tree.rooted(Cell(0, 0)).looked(Cell(0, 0), [Cell(1, 0), Cell(0, 1)])
    >>> backbone(tree.looked(Cell(1, 0), [Cell(2, 0)]))[-1]
    Cell(east=2, north=0)
    """
    end = min(tree.vertices, key=lambda cell: (-tree.vertices[cell].depth, cell))
    return tuple(reversed(list(tree.path_up(end))))


def ribs(tree: Tree, spine: tuple[Cell, ...]) -> tuple[Cell, ...]:
    """The roots of the ribs, by the depth at which they leave the backbone.

    >>> tree = Tree.rooted(Cell(0, 0)).looked(Cell(0, 0), [Cell(1, 0), Cell(0, 1)])
    >>> ribs(tree, (Cell(0, 0), Cell(0, 1)))
    (Cell(east=1, north=0),)
    """
    on_spine = set(spine)
    return tuple(child for cell in spine for child in tree.children(cell) if child not in on_spine)


class Spot(NamedTuple):
    """Where a vertex stands in a drawing by depth: its depth, and its row beside the backbone."""

    depth: int
    row: int


def spread(tree: Tree) -> Mapping[Cell, Spot]:
    """A place for every vertex: the backbone straight along row 0, the ribs on both sides.

    From the far end towards the root, every rib is laid outside of those already there, on the
    side where it comes to lie nearer to the backbone. A rib is laid out likewise, to one side of a
    longest path of its own. So no two edges cross, and no two vertices share a place.
    """
    heights = _heights(tree)
    spine = backbone(tree)
    spots = {cell: Spot(depth, 0) for depth, cell in enumerate(spine)}
    outer: dict[int, _Outer] = {side: defaultdict(int) for side in (1, -1)}
    for rib in reversed(ribs(tree, spine)):
        rows = _rows(tree, rib, heights)
        away = {side: _clear(tree, rows, outer[side]) for side in (1, -1)}
        side = 1 if away[1] <= away[-1] else -1
        for cell, row in rows.items():
            depth = tree.vertices[cell].depth
            spots[cell] = Spot(depth, side * (row + away[side]))
            outer[side][depth] = max(outer[side][depth], row + away[side])
    return spots


_Outer = defaultdict[int, int]
"""The outermost row in use, by depth."""


def _heights(tree: Tree) -> dict[Cell, int]:
    """How many edges the longest way down from each vertex has."""
    heights: dict[Cell, int] = {}
    for cell in sorted(tree.vertices, key=lambda cell: -tree.vertices[cell].depth):
        heights[cell] = max((heights[child] + 1 for child in tree.children(cell)), default=0)
    return heights


def _rows(tree: Tree, top: Cell, heights: Mapping[Cell, int]) -> dict[Cell, int]:
    """Rows for the subtree below `top`: 0 for a longest path, more for what hangs on it."""
    path = [top]
    while tree.children(path[-1]):
        path.append(max(tree.children(path[-1]), key=lambda cell: heights[cell]))
    rows = dict.fromkeys(path, 0)
    outer: _Outer = defaultdict(int)
    for rib in reversed(ribs(tree, tuple(path))):
        below = _rows(tree, rib, heights)
        away = _clear(tree, below, outer)
        for cell, row in below.items():
            rows[cell] = row + away
            depth = tree.vertices[cell].depth
            outer[depth] = max(outer[depth], row + away)
    return rows


def _clear(tree: Tree, rows: Mapping[Cell, int], outer: _Outer) -> int:
    """How far a subtree has to be moved to lie outside of what is there."""
    return max(outer[tree.vertices[cell].depth] + 1 - row for cell, row in rows.items())
