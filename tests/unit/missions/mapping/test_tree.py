"""The exploration tree by hand, and beside a plain one that derives everything anew."""

from __future__ import annotations

import itertools

from hypothesis import given, settings
from hypothesis import strategies as st

from missions.mapping.tree import Tree
from missions.units import Cell

FAST = settings(max_examples=60, deadline=None)
ROOT = Cell(0, 0)
NORTH, EAST, SOUTH, WEST = ROOT.neighbours()


# --- by hand ---------------------------------------------------------------------------------
def test_children_come_north_east_south_west_in_any_order_of_arrival() -> None:
    for order in itertools.permutations(ROOT.neighbours()):
        assert Tree.rooted(ROOT).with_observation(ROOT, order).children(ROOT) == (
            NORTH,
            EAST,
            SOUTH,
            WEST,
        )
    late = Tree.rooted(ROOT).with_observation(ROOT, [WEST]).with_observation(ROOT, [NORTH])
    assert late.children(ROOT) == (NORTH, WEST)


# --- joining ---------------------------------------------------------------------------------
def test_parent_nearer_to_the_root_is_kept() -> None:
    around = Tree.rooted(ROOT).with_observation(ROOT, [EAST]).with_observation(EAST, [Cell(1, 1)])
    around = around.with_observation(Cell(1, 1), [NORTH])  # found from the far side, at depth 3
    straight = Tree.rooted(ROOT).with_observation(ROOT, [NORTH])
    for joined in (around.join(straight), straight.join(around)):
        assert joined.parent(NORTH) == ROOT
        assert joined.vertices[NORTH].depth == 1
        assert joined.children(Cell(1, 1)) == ()


def test_parent_of_one_depth_and_lesser_cell_is_kept() -> None:
    over_north = (
        Tree.rooted(ROOT)
        .with_observation(ROOT, [NORTH, EAST])
        .with_observation(NORTH, [Cell(1, 1)])
    )
    over_east = (
        Tree.rooted(ROOT).with_observation(ROOT, [NORTH, EAST]).with_observation(EAST, [Cell(1, 1)])
    )
    for joined in (over_north.join(over_east), over_east.join(over_north)):
        assert joined.parent(Cell(1, 1)) == min(NORTH, EAST)
        assert joined.is_observed(NORTH)
        assert joined.is_observed(EAST)


# --- beside a plain one ----------------------------------------------------------------------
class Plain:
    """A tree of parents and looks alone, which computes every answer anew."""

    def __init__(self) -> None:
        self.parent: dict[Cell, Cell | None] = {ROOT: None}
        self.seen: set[Cell] = set()

    def look(self, cell: Cell, roi: set[Cell]) -> None:
        self.seen.add(cell)
        for near in cell.neighbours():
            if near in roi and near not in self.parent:
                self.parent[near] = cell

    def below(self, cell: Cell) -> set[Cell]:
        found = {cell}
        while more := {c for c, up in self.parent.items() if up in found} - found:
            found |= more
        return found

    def depth(self, cell: Cell) -> int:
        up = self.parent[cell]
        return 0 if up is None else 1 + self.depth(up)


rois = st.sets(st.builds(Cell, st.integers(-2, 2), st.integers(-2, 2)), max_size=18)


@FAST
@given(rois, st.data())
def test_tree_agrees_with_a_plain_one(roi: set[Cell], data: st.DataObject) -> None:
    """Late positives count also: a cell may be observed again when more of the ROI is known."""
    roi = roi | {ROOT}
    tree, plain = Tree.rooted(ROOT), Plain()
    for _ in range(data.draw(st.integers(0, 14))):
        cell = data.draw(st.sampled_from(sorted(tree.vertices)))
        shown = data.draw(st.sets(st.sampled_from(sorted(roi))))
        tree = tree.with_observation(cell, [n for n in cell.neighbours() if n in shown])
        plain.look(cell, shown)
    assert set(tree.vertices) == set(plain.parent)
    assert len(tree) == len(plain.parent)
    assert tree.depth == max(plain.depth(cell) for cell in plain.parent)
    for cell, parent in plain.parent.items():
        assert tree.parent(cell) == parent
        assert tree.vertices[cell].depth == plain.depth(cell)
        assert tree.is_observed(cell) == (cell in plain.seen)
        assert tree.is_explored(cell) == (plain.below(cell) <= plain.seen)
        assert set(tree.children(cell)) == {c for c, up in plain.parent.items() if up == cell}
    assert Tree.from_vertices(ROOT, tree.vertices) == tree
