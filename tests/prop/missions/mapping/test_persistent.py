"""Every version of a map, and every belief and tree that was handed out, stays what it was."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.lab.arena.minds import look
from missions.lab.arena.roi import KINDS
from missions.mapping.belief import Belief, FrameId
from missions.mapping.persistent import PersistentMap
from missions.mapping.tree import Tree
from missions.units import Cell

FAST = settings(max_examples=150, deadline=None)

changes = st.dictionaries(st.integers(0, 6), st.integers(), max_size=4)
steps = st.lists(st.tuples(st.integers(0, 99), changes, st.booleans()), max_size=30)


@FAST
@given(steps)
def test_versions_are_as_good_as_copies(plan: list[tuple[int, dict[int, int], bool]]) -> None:
    """Changes to any version, and reading any in between, against plain copies."""
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
    """Frames added to any belief and beliefs joined, against beliefs made of the same votes."""
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
        grown = look(tree, known[int(rng.integers(len(known)))], roi)
        were.append(list(grown.vertices.items()))
        trees.append(grown)
    for i in rng.permutation(len(trees)).tolist():
        assert list(trees[i].vertices.items()) == were[i]
        assert trees[i] == Tree.of(Cell(0, 0), dict(were[i]))
