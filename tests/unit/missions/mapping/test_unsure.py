"""Cells of which the detector is not sure, over many frames."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from missions.events import FrameSeen, Vote, from_json, to_json
from missions.mapping.unsure import Unsure
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
    unsure = Unsure()
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
    unsure = Unsure()
    unsure.note(frame({Cell(0, 0): True}, overview=True))
    assert not len(unsure.cells())


def test_unsure_cell_that_other_frames_take_for_region_is_not_beyond_the_region() -> None:
    unsure = Unsure()
    unsure.note(frame({Cell(0, 0): True, Cell(0, 1): False}))
    assert unsure.beyond(frozenset())
    assert not unsure.beyond({Cell(0, 0)})


def test_unsure_cells_survive_the_journal_and_a_sure_frame_writes_none() -> None:
    doubtful, sure = frame({Cell(0, 0): True, Cell(0, 1): False}), frame({Cell(0, 0): False})
    assert from_json(to_json(doubtful)) == doubtful
    assert "unsure" not in to_json(sure)
