"""Facts merge: beliefs and trees are the same whatever the order, duplication or batching."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.arena.roi import KINDS, component
from missions.arena.run import look
from missions.mapping.belief import Belief, FrameId, Tally
from missions.mapping.tree import Tree, VertexState
from missions.units import Cell

FAST = settings(max_examples=120, deadline=None, derandomize=True)

small_cells = st.builds(Cell, st.integers(-1, 1), st.integers(-1, 1))
frame_ids = st.builds(FrameId, st.integers(1, 2), st.integers(0, 3).map(float))
verdicts = st.dictionaries(small_cells, st.booleans(), max_size=5)
reports = st.tuples(small_cells, frame_ids, verdicts)

Report = tuple[Cell, FrameId, dict[Cell, bool]]


def belief_of(frames: list[Report], *, start: Belief | None = None) -> Belief:
    belief = start if start is not None else Belief(frames=3, positive=2)
    for vantage, frame, seen in frames:
        belief = belief.with_frame(vantage, frame, seen)
    return belief


def facts(belief: Belief) -> tuple[object, ...]:
    return belief.roi, list(belief.cells().items()), belief.detections()


# --- belief ----------------------------------------------------------------------------------
@FAST
@given(st.lists(reports, max_size=14), st.data())
def test_frames_in_any_order_twice_and_in_batches_make_one_belief(
    frames: list[Report], data: st.DataObject
) -> None:
    whole = belief_of(frames)
    again = data.draw(st.permutations(frames + frames[: len(frames) // 2]))
    assert belief_of(again) == whole
    assert facts(belief_of(again)) == facts(whole)
    cut = data.draw(st.integers(0, len(again)))
    joined = belief_of(again[:cut]).join(belief_of(again[cut:]))
    assert joined == whole
    assert facts(joined) == facts(whole)


@FAST
@given(*[st.lists(reports, max_size=8)] * 3)
def test_the_join_of_beliefs_is_a_least_upper_bound(
    first: list[Report], second: list[Report], third: list[Report]
) -> None:
    a, b, c = belief_of(first), belief_of(second), belief_of(third)
    assert a.join(b) == b.join(a)
    assert a.join(b).join(c) == a.join(b.join(c))
    assert a.join(a) == a
    assert a.join(b).join(a) == a.join(b)
    assert a.roi | b.roi <= a.join(b).roi


@FAST
@given(st.lists(reports, max_size=14))
def test_a_positive_never_reverts(frames: list[Report]) -> None:
    belief = belief_of([])
    for frame in frames:
        after = belief_of([frame], start=belief)
        assert belief.roi <= after.roi
        belief = after


@FAST
@given(st.lists(reports, max_size=14))
def test_roi_is_what_some_vantage_gave_enough_votes(frames: list[Report]) -> None:
    """The rule of section 7, from the votes alone: positives of different vantages never add."""
    belief = belief_of(frames)
    expected = {
        cell
        for vantage in belief.looks
        for cell in belief.cells()
        if belief.tally(cell, vantage).positive >= belief.positive
    }
    assert belief.roi == expected


def test_a_negative_can_turn_and_the_tallies_say_how() -> None:
    here, there = Cell(0, 0), Cell(0, 1)
    votes = [False, False, False, True, True]
    frames = [(here, FrameId(1, float(t)), {there: says}) for t, says in enumerate(votes)]
    belief = belief_of(frames[:4])
    assert there not in belief.roi
    belief = belief_of(frames[4:], start=belief)
    assert there in belief.roi
    assert belief.tally(there, here) == Tally(2, 5)
    assert belief.detections() == [(here, there, True)]


def test_positives_of_two_vantages_do_not_add_up() -> None:
    one = (Cell(0, 0), FrameId(1, 0.0), {Cell(0, 1): True})
    other = (Cell(0, 2), FrameId(1, 1.0), {Cell(0, 1): True})
    belief = belief_of([one, other])
    assert belief.roi == frozenset()
    assert belief.cells()[Cell(0, 1)] == Tally(2, 2)


# --- tree ------------------------------------------------------------------------------------
def grown(roi: set[Cell], looks: int, rng: np.random.Generator) -> Tree:
    """A tree from the root by a random walk: any known vertex is looked from next."""
    tree = Tree.rooted(Cell(0, 0))
    for _ in range(looks):
        todo = sorted(c for c in tree.vertices if not tree.has_looked(c))
        if not todo:
            break
        tree = look(tree, todo[int(rng.integers(len(todo)))], roi)
    return tree


def is_sound(tree: Tree) -> None:
    for cell, vertex in tree.vertices.items():
        if vertex.parent is None:
            assert cell == tree.root
            assert vertex.depth == 0
        else:
            assert tree.vertices[vertex.parent].depth < vertex.depth
            assert vertex.parent in cell.neighbours()
            assert cell in tree.children(vertex.parent)
        assert next(reversed(list(tree.path_up(cell)))) == tree.root
        below = [c for c in tree.vertices if cell in tree.path_up(c)]
        done = all(tree.has_looked(c) for c in below)
        assert tree.is_explored(cell) == done
        unexplored = not tree.has_looked(cell)
        state = VertexState.UNEXPLORED if unexplored else VertexState.UNDER_EXPLORATION
        assert tree.state(cell) == (VertexState.EXPLORED if done else state)
    assert Tree.of(tree.root, tree.vertices) == tree


@pytest.mark.parametrize("kind", sorted(KINDS))
@pytest.mark.parametrize("seed", range(8))
def test_trees_grown_by_different_walks_join_in_any_order(seed: int, kind: str) -> None:
    rng = np.random.default_rng([seed, 7])
    roi = KINDS[kind](int(rng.integers(2, 40)), rng)
    a, b, c = (grown(roi, int(rng.integers(0, 40)), rng) for _ in range(3))
    for tree in (a, b, c):
        is_sound(tree)
    joined = a.join(b)
    is_sound(joined)
    assert joined == b.join(a)
    assert joined.join(c) == a.join(b.join(c))
    assert a.join(a) == a
    assert joined.join(a) == joined
    assert set(joined.vertices) == set(a.vertices) | set(b.vertices)
    assert all(joined.has_looked(v) for v in a.vertices if a.has_looked(v))


@pytest.mark.parametrize("seed", range(4))
def test_a_joined_tree_goes_on_to_the_whole_roi(seed: int) -> None:
    rng = np.random.default_rng(seed)
    roi = KINDS["eden"](30, rng)
    tree = grown(roi, 12, rng).join(grown(roi, 12, rng))
    while todo := [c for c in tree.vertices if not tree.has_looked(c)]:
        tree = look(tree, todo[0], roi)
    is_sound(tree)
    assert set(tree.vertices) == component(roi, Cell(0, 0))


def test_trees_of_different_roots_do_not_join() -> None:
    with pytest.raises(ValueError, match="different roots"):
        Tree.rooted(Cell(0, 0)).join(Tree.rooted(Cell(1, 0)))


def test_a_second_look_only_adds() -> None:
    tree = Tree.rooted(Cell(0, 0)).looked(Cell(0, 0), [Cell(0, 1)])
    late = tree.looked(Cell(0, 0), [Cell(1, 0)])
    assert late.children(Cell(0, 0)) == (Cell(0, 1), Cell(1, 0))
    is_sound(late)
