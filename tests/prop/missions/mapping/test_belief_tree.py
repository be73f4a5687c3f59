"""Facts merge: beliefs and trees are the same whatever the order, duplication or batching."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.lab.arena.radio import observe
from missions.lab.arena.roi import KINDS, component
from missions.mapping.belief import Belief, FrameId, Tally
from missions.mapping.tree import Tree, VertexState
from missions.units import Cell

FAST = settings(max_examples=120, deadline=None)

small_cells = st.builds(Cell, st.integers(-1, 1), st.integers(-1, 1))
frame_ids = st.builds(FrameId, st.integers(1, 2), st.integers(0, 3).map(float))
verdicts = st.dictionaries(small_cells, st.booleans(), max_size=5)
# None: a frame from anywhere
reports = st.tuples(st.none() | small_cells, frame_ids, verdicts)

Report = tuple[Cell | None, FrameId, dict[Cell, bool]]


AROUND = [Cell(east, north) for east in (-1, 0, 1) for north in (-1, 0, 1)]


def belief_of(frames: list[Report], *, start: Belief | None = None) -> Belief:
    belief = start if start is not None else Belief(frames=3, positive=2)
    for vantage, frame, seen in frames:
        belief = belief.with_frame(vantage, frame, seen)
    return belief


def facts(belief: Belief) -> tuple[object, ...]:
    here = [(belief.verdict(c), belief.provisional(c), belief.tally(c, None)) for c in AROUND]
    return belief.roi, list(belief.cells().items()), belief.detections(), here


# --- belief ----------------------------------------------------------------------------------
@FAST
@given(st.lists(reports, max_size=14), st.data())
def test_frames_in_any_order_twice_and_in_batches_make_one_belief(frames, data):
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
def test_the_join_of_beliefs_is_a_least_upper_bound(first, second, third):
    a, b, c = belief_of(first), belief_of(second), belief_of(third)
    assert a.join(b) == b.join(a)
    assert a.join(b).join(c) == a.join(b.join(c))
    assert a.join(a) == a
    assert a.join(b).join(a) == a.join(b)


@FAST
@given(st.lists(reports, max_size=20))
def test_verdicts_in_any_order_stay_when_late_votes_are_left_out(frames):
    belief = belief_of([])
    for vantage, frame, seen in frames:
        after = belief.with_frame(vantage, frame, belief.in_time(vantage, frame, seen))
        assert belief.roi <= after.roi
        belief = after


@FAST
@given(st.lists(reports, max_size=20))
def test_votes_in_the_order_of_exposure_are_not_late(frames):
    belief = belief_of([])
    for vantage, frame, seen in sorted(frames, key=lambda report: report[1].exposed):
        assert belief.in_time(vantage, frame, seen) == seen
        belief = belief.with_frame(vantage, frame, seen)


@FAST
@given(st.lists(reports, max_size=14))
def test_roi_is_elected_by_the_first_votes_of_some_vantage(frames):
    """The rule is computed from the votes alone, in another way."""
    votes: dict[tuple[Cell | None, Cell], dict[tuple[float, int], bool]] = {}
    for vantage, frame, seen in frames:
        for cell, elects_roi in seen.items():
            ballot = votes.setdefault((vantage, cell), {})
            exposed = (frame.t_s, frame.vehicle)
            ballot[exposed] = ballot.get(exposed, False) or elects_roi
    belief = belief_of(frames)
    expected = set()
    for (vantage, cell), ballot in votes.items():
        first = [ballot[exposed] for exposed in sorted(ballot)][:3]
        assert belief.tally(cell, vantage) == Tally(sum(first), len(first))
        if sum(first) >= 2:
            expected.add(cell)
    assert belief.roi == expected


# --- frames from anywhere --------------------------------------------------------------------
anywhere = st.tuples(st.none(), frame_ids, verdicts)


@FAST
@given(st.lists(anywhere, max_size=20))
def test_decided_cell_stays_decided_when_late_votes_are_left_out(frames):
    """Neither a yes nor a no is taken back, in any order of arrival; a frame is reported once."""
    belief, taken = belief_of([]), set()
    for vantage, frame, seen in frames:
        if frame in taken:
            continue
        taken.add(frame)
        after = belief.with_frame(vantage, frame, belief.in_time(vantage, frame, seen))
        for cell in AROUND:
            if (before := belief.verdict(cell)) is not None:
                assert after.verdict(cell) is before
                assert after.provisional(cell) is before
        belief = after


@FAST
@given(st.lists(anywhere, max_size=14), st.integers(1, 5), st.data())
def test_a_cell_is_decided_when_no_votes_to_come_could_change_it(frames, size, data):
    """The test tries every way in which the missing votes of a ballot could be cast."""
    empty = Belief(size, data.draw(st.integers(1, size)))
    belief = belief_of(frames, start=empty)
    for cell in AROUND:
        lacks = size - belief.tally(cell, None).total
        outcomes = set()
        for rest in itertools.product((False, True), repeat=lacks):
            later = [(None, FrameId(3, 9.0 + i), {cell: vote}) for i, vote in enumerate(rest)]
            outcomes.add(cell in belief_of(later, start=belief).roi)
        decided = belief.verdict(cell)
        assert outcomes == ({False, True} if decided is None else {decided})


@pytest.mark.parametrize("rate", [27 / 483, 0.2, 0.4])
@pytest.mark.parametrize("stop", ["decided", "after 2", "after 4", "after 9", "at a no"])
def test_no_rule_of_when_to_stop_makes_a_false_roi_cell_more_likely(rate, stop):
    """The test sums up every outcome of nine frames from anywhere, each wrong with a rate."""
    here = Cell(0, 0)
    chance = 0.0
    for votes in itertools.product((False, True), repeat=9):
        belief = Belief(frames=5, positive=3)
        for t, vote in enumerate(votes):
            enough = {
                "decided": belief.verdict(here) is not None,
                "at a no": t > 0 and not votes[t - 1],
            }.get(stop, stop == f"after {t}")
            if enough:
                break
            belief = belief.with_frame(None, FrameId(1, float(t)), {here: vote})
        if here in belief.roi:
            chance += math.prod(rate if vote else 1 - rate for vote in votes)
    exact = sum(math.comb(5, k) * rate**k * (1 - rate) ** (5 - k) for k in (3, 4, 5))
    assert chance <= exact + 1e-12
    if stop in ("decided", "after 9"):  # stopping at the decision loses no vote that counts
        assert chance == pytest.approx(exact)


def test_open_votes_and_those_of_a_vantage_do_not_add_up():
    here = Cell(0, 0)
    frames: list[Report] = [
        (vantage, FrameId(1, 10.0 * i + t), {here: t == 0})
        for i, vantage in enumerate((None, here))
        for t in range(2)
    ]
    belief = belief_of(frames)  # one of two, twice
    assert belief.roi == frozenset()
    assert belief.verdict(here) is None
    belief = belief.with_frame(None, FrameId(1, 50.0), {here: False})
    assert belief.verdict(here) is False
    belief = belief.with_frame(here, FrameId(1, 60.0), {here: True})
    assert belief.verdict(here) is True  # the vantage elects it


@pytest.mark.parametrize("order", ["as exposed", "any"])
def test_no_cell_was_ever_false_more_often_than_three_of_five_allow(order):
    """Thirty frames of noise alone: a share of cells was in the ROI at some time of the flight."""
    rng = np.random.default_rng(5)
    rate, cells, here = 0.2, [Cell(e, 0) for e in range(3000)], Cell(0, 0)
    belief = Belief(frames=5, positive=3)
    times = list(range(30)) if order == "as exposed" else rng.permutation(30).tolist()
    ever: set[Cell] = set()
    for t in times:
        seen = dict(zip(cells, (rng.random(len(cells)) < rate).tolist(), strict=True))
        frame = FrameId(1, float(t))
        belief = belief.with_frame(here, frame, belief.in_time(here, frame, seen))
        ever |= belief.roi
    exact = sum(math.comb(5, k) * rate**k * (1 - rate) ** (5 - k) for k in (3, 4, 5))  # 5.8 %
    four_sigma = 4 * math.sqrt(exact * (1 - exact) / len(cells))
    assert len(ever) / len(cells) == pytest.approx(exact, abs=four_sigma)


# --- tree ------------------------------------------------------------------------------------
def grown(roi: set[Cell], looks: int, rng: np.random.Generator) -> Tree:
    tree = Tree.rooted(Cell(0, 0))
    for _ in range(looks):
        todo = sorted(c for c in tree.vertices if not tree.is_observed(c))
        if not todo:
            break
        tree = observe(tree, todo[int(rng.integers(len(todo)))], roi)
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
        done = all(tree.is_observed(c) for c in below)
        assert tree.is_explored(cell) == done
        unexplored = not tree.is_observed(cell)
        state = VertexState.UNEXPLORED if unexplored else VertexState.UNDER_EXPLORATION
        assert tree.state(cell) == (VertexState.EXPLORED if done else state)
    assert Tree.from_vertices(tree.root, tree.vertices) == tree


@pytest.mark.parametrize("kind", sorted(KINDS))
@pytest.mark.parametrize("seed", range(8))
def test_trees_grown_by_different_walks_join_in_any_order(seed, kind):
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
    assert all(joined.is_observed(v) for v in a.vertices if a.is_observed(v))


@pytest.mark.parametrize("seed", range(4))
def test_a_joined_tree_goes_on_to_the_whole_roi(seed):
    rng = np.random.default_rng(seed)
    roi = KINDS["eden"](30, rng)
    tree = grown(roi, 12, rng).join(grown(roi, 12, rng))
    while todo := [c for c in tree.vertices if not tree.is_observed(c)]:
        tree = observe(tree, todo[0], roi)
    is_sound(tree)
    assert set(tree.vertices) == component(roi, Cell(0, 0))


def test_trees_of_different_roots_do_not_join():
    with pytest.raises(ValueError, match="different roots"):
        Tree.rooted(Cell(0, 0)).join(Tree.rooted(Cell(1, 0)))
