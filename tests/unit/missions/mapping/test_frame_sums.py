"""Sums of many frames over a cell: sure or unsure, and of which class."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from missions.classes import ClassShare
from missions.events import FrameSeen, Vote, from_json, to_json
from missions.fleet_events import Fact, FactsShared
from missions.mapping.frame_sums import FrameSums
from missions.units import Cell

FEW = st.integers(-2, 2)
CELLS = st.builds(Cell, FEW, FEW)
FRAMES = st.lists(st.dictionaries(CELLS, st.booleans(), min_size=1), max_size=12)


def frame(verdicts: dict[Cell, bool], *, overview: bool = False) -> FrameSeen:
    votes = tuple(Vote(cell, False, 0.0) for cell in verdicts)
    unsure = tuple(cell for cell, doubt in verdicts.items() if doubt) or None
    return FrameSeen(1, 2.0, None, votes, overview=overview or None, unsure=unsure)


@given(FRAMES)
def test_cell_is_unsure_where_half_of_its_frames_leave_it_so(
    frames: list[dict[Cell, bool]],
) -> None:
    unsure = FrameSums()
    for verdicts in frames:
        unsure.note(frame(verdicts))
    by_cell: dict[Cell, list[bool]] = {}
    for verdicts in frames:
        for cell, doubt in verdicts.items():
            by_cell.setdefault(cell, []).append(doubt)
    expected = {
        c for c, doubts in by_cell.items() if any(doubts) and 2 * sum(doubts) >= len(doubts)
    }
    assert {Cell(*cell) for cell in unsure.cells().tolist()} == expected
    assert all(unsure.is_unsure(cell) == (cell in expected) for cell in by_cell)


def test_frame_from_the_height_of_a_search_leaves_no_cell_unsure() -> None:
    unsure = FrameSums()
    unsure.note(frame({Cell(0, 0): True}, overview=True))
    assert not len(unsure.cells())


def test_unsure_cell_that_other_frames_take_for_region_is_not_beyond_the_region() -> None:
    unsure = FrameSums()
    unsure.note(frame({Cell(0, 0): True, Cell(0, 1): False}))
    assert unsure.beyond(frozenset())
    assert not unsure.beyond({Cell(0, 0)})


def test_unsure_cells_survive_the_journal_and_a_sure_frame_writes_none() -> None:
    doubtful, sure = frame({Cell(0, 0): True, Cell(0, 1): False}), frame({Cell(0, 0): False})
    assert from_json(to_json(doubtful)) == doubtful
    assert "unsure" not in to_json(sure)


SHARES = st.dictionaries(CELLS, st.dictionaries(st.integers(1, 3), st.floats(0, 1)), min_size=1)


@given(st.lists(SHARES, max_size=8))
def test_shares_are_means_over_frames_and_the_class_is_the_largest_of_those_asked(
    frames: list[dict[Cell, dict[int, float]]],
) -> None:
    sums, shown = FrameSums(), dict[Cell, list[dict[int, float]]]()
    for shares in frames:
        classes = tuple(
            ClassShare(cell, number, round(share, 3))
            for cell, some in shares.items()
            for number, share in some.items()
        )
        votes = tuple(Vote(cell, False, 0.0) for cell in shares)
        sums.note(FrameSeen(1, 2.0, None, votes, classes=classes or None))
        for cell, some in shares.items():
            shown.setdefault(cell, []).append(some)
    cells = np.array([*shown, Cell(9, 9)], np.int32)
    expected = [
        [sum(round(one.get(n, 0.0), 3) for one in some) / len(some) for n in (1, 3)]
        for some in (*shown.values(), [{}])
    ]
    assert sums.shares(cells, (1, 3)) == pytest.approx(np.array(expected))
    for number, (one, three) in zip(sums.classes(cells, (1, 3)).tolist(), expected, strict=True):
        assert {0: 0.0, 1: one, 3: three}[number] == pytest.approx(max(one, three))
        assert bool(number) == (max(one, three) > 0.0)


def test_classes_survive_the_journal_and_a_frame_without_writes_none() -> None:
    cell = Cell(2, -1)
    reported = FrameSeen(
        1, 2.0, None, (Vote(cell, True, 0.5),), classes=(ClassShare(cell, 4, 0.5),)
    )
    assert from_json(to_json(reported)) == reported
    assert "classes" not in to_json(frame({cell: False}))


def test_fact_of_another_member_counts_as_one_frame_that_knows_its_cells() -> None:
    here, beside = Cell(0, 0), Cell(1, 0)
    own = FrameSeen(1, 2.0, None, (Vote(here, True, 1.0),), classes=(ClassShare(here, 1, 0.6),))
    fact = Fact(3.0, ((here, True), (beside, False)), classes=(ClassShare(here, 3, 0.8),))
    sums = FrameSums()
    for event in (own, FactsShared(2, 4.0, 0, (fact, Fact(3.0, ((beside, False),))))):
        sums.note(event)
    cells = np.array([here, beside])
    assert sums.shares(cells, (1, 3)) == pytest.approx(np.array([[0.3, 0.4], [0.0, 0.0]]))
    assert sums.classes(cells, (1, 3)).tolist() == [3, 0]
    assert not len(sums.cells())
