"""Every version of a map, and every belief and tree that was handed out, stays unchanged."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.lab.arena.radio import observe
from missions.lab.arena.roi import KINDS
from missions.mapping.belief import Belief, FrameId
from missions.mapping.persistent import PersistentMap, PersistentSet
from missions.mapping.tree import Tree
from missions.units import Cell

ONE = {"b": 1, "a": 2}


def test_a_key_that_is_missing_is_an_error() -> None:
    one = PersistentMap(ONE)
    one.updated({"c": 3})
    with pytest.raises(KeyError, match="c"):
        one["c"]


def test_iteration_sees_one_version_while_newer_ones_are_made() -> None:
    now = PersistentMap({0: 0})
    seen = []
    for view in (now, now.keys(), now.values(), now.items()):
        for entry in view:
            seen.append(entry)
            now = now.updated({len(now): len(now)})
    assert seen == [0, 0, 0, (0, 0)]
    assert len(now) == 5


def test_maps_are_equal_by_their_content() -> None:
    one = PersistentMap(ONE)
    assert one == PersistentMap({"a": 2, "b": 1})
    assert one == ONE
    assert one.updated({"a": 3}) != one
    assert one.updated({"a": 3}).updated({"a": 2}) == one
    assert PersistentMap({1: one}) == PersistentMap({1: PersistentMap(ONE)})
    with pytest.raises(TypeError):
        hash(one)


@pytest.mark.parametrize(
    "again", [copy.copy, copy.deepcopy, lambda m: pickle.loads(pickle.dumps(m))]
)
def test_copies_hold_the_same(again: object) -> None:
    assert callable(again)
    one = PersistentMap(ONE)
    two = one.updated({"c": 3})
    assert again(one) == one
    assert again(two) == two
    assert list(again(one)) == list(one)
    assert again(PersistentSet(one)) == PersistentSet(one)


def test_long_history_is_released_and_read_without_recursion() -> None:
    """Neither may recurse: a mission has more frames than Python has stack."""
    first = now = PersistentMap({0: 0})
    for number in range(50_000):
        now = now.updated({number % 10: number})
    assert dict(first) == {0: 0}
    early = now
    for number in range(50_000):
        now = now.updated({number % 10: -number})
    del early
    assert now[9] == -49_999


def test_set_stays_unchanged() -> None:
    one = PersistentSet([2, 1])
    two = one.added([1, 3])
    assert two.added({3, 1}) is two
    less = two.without([2, 9])
    assert (set(one), set(two), set(less)) == ({1, 2}, {1, 2, 3}, {1, 3})
    assert list(two) == [2, 1, 3]


# --- any history -----------------------------------------------------------------------------
FAST = settings(max_examples=60, deadline=None)

changes = st.dictionaries(st.integers(0, 6), st.integers(), max_size=4)
steps = st.lists(st.tuples(st.integers(0, 99), changes, st.booleans()), max_size=30)


@FAST
@given(steps)
def test_versions_are_as_good_as_copies(plan: list[tuple[int, dict[int, int], bool]]) -> None:
    """Changes to any version, and reads in between, agree with plain copies."""
    maps, copies = [PersistentMap[int, int]()], [dict[int, int]()]
    for number, change, reads in plan:
        at = number % len(maps)
        maps.append(maps[at].updated(change))
        copies.append({**copies[at], **change})
        if reads:
            past = (number * 7) % len(maps)
            assert list(maps[past].items()) == list(copies[past].items())
    for one, plain in zip(maps, copies, strict=True):
        assert list(one.items()) == list(plain.items())
        assert list(one) == list(one.keys()) == list(plain)
        assert list(one.values()) == list(plain.values())
        assert len(one) == len(plain)
        assert one == plain
        assert [one.get(key) for key in range(8)] == [plain.get(key) for key in range(8)]


Report = tuple[Cell, FrameId, dict[Cell, bool]]
near = st.builds(Cell, st.integers(-1, 1), st.integers(-1, 1))
frames = st.builds(FrameId, st.integers(1, 2), st.integers(0, 3).map(float))
reports = st.tuples(near, frames, st.dictionaries(near, st.booleans(), max_size=5))


def belief_of(votes: list[Report]) -> Belief:
    belief = Belief(frames=3, positive=2)
    for report in votes:
        belief = belief.with_frame(*report)
    return belief


@FAST
@given(st.lists(st.tuples(st.integers(0, 99), st.none() | reports), max_size=12), st.data())
def test_a_belief_that_was_handed_out_never_changes(
    plan: list[tuple[int, Report | None]], data: st.DataObject
) -> None:
    """Frames added to any belief, and joined beliefs, agree with beliefs of the same votes."""
    beliefs, votes = [belief_of([])], [list[Report]()]
    for number, report in plan:
        at = -1 if number < 70 else number % len(beliefs)
        if report is None:
            beliefs.append(beliefs[at].join(beliefs[number % len(beliefs)]))
            votes.append(votes[at] + votes[number % len(votes)])
        else:
            beliefs.append(beliefs[at].with_frame(*report))
            votes.append([*votes[at], report])
    for i in data.draw(st.permutations(range(len(beliefs)))):
        alone = belief_of(votes[i])
        assert beliefs[i] == alone
        assert (beliefs[i].cells(), beliefs[i].detections()) == (alone.cells(), alone.detections())


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_a_tree_that_was_handed_out_never_changes(kind: str) -> None:
    rng = np.random.default_rng(3)
    roi = KINDS[kind](25, rng)
    trees = [Tree.rooted(Cell(0, 0))]
    were = [list(trees[0].vertices.items())]
    for _ in range(40):
        tree = trees[int(rng.integers(max(len(trees) - 3, 0), len(trees)))]
        known = sorted(tree.vertices)
        grown = observe(tree, known[int(rng.integers(len(known)))], roi)
        were.append(list(grown.vertices.items()))
        trees.append(grown)
    for i in rng.permutation(len(trees)).tolist():
        assert list(trees[i].vertices.items()) == were[i]
        assert trees[i] == Tree.from_vertices(Cell(0, 0), dict(were[i]))
