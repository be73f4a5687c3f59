"""Votes by hand: ballots, late frames, missing votes of a look, and the map."""

from __future__ import annotations

import pytest

from missions.mapping.belief import Belief, FrameId, Tally
from missions.units import Cell

HERE = Cell(0, 0)
NORTH = Cell(0, 1)
EMPTY = Belief(frames=5, positive=3)


def voted(pattern: str, *, at: Cell = HERE, on: Cell = HERE, first_s: float = 0.0) -> Belief:
    """Return a belief of frames a second apart: `+` a yes, `-` a no, `.` without the cell."""
    return more(EMPTY, pattern, at=at, on=on, first_s=first_s)


def more(
    belief: Belief, pattern: str, *, at: Cell = HERE, on: Cell = HERE, first_s: float = 0.0,
    vehicle: int = 1,
) -> Belief:  # fmt: skip
    for number, mark in enumerate(pattern):
        seen = {} if mark == "." else {on: mark == "+"}
        belief = belief.with_frame(at, FrameId(vehicle, first_s + number), seen)
    return belief


def test_all_votes_are_in_the_map() -> None:
    """A cell shows all of its votes to a reader."""
    belief = more(voted("---++"), "++++", first_s=10.0)
    assert belief.cells() == {HERE: Tally(6, 9)}
    assert belief.roi == frozenset()


# --- frames from anywhere --------------------------------------------------------------------
def openly(pattern: str) -> Belief:
    belief = EMPTY
    for t, mark in enumerate(pattern):
        belief = belief.with_frame(None, FrameId(1, float(t)), {HERE: mark == "+"})
    return belief


@pytest.mark.parametrize(
    ("pattern", "verdict", "provisional"),
    [
        ("", None, None),
        ("+", None, True),
        ("-", None, False),
        ("+-", None, False),  # a tie is no majority
        ("++-", None, True),
        ("++--", None, False),
        ("+++", True, True),
        ("---", False, False),
        ("--++-", False, False),
        ("-+-+++++", True, True),
        ("---+++++", False, False),
    ],
)
def test_three_equal_votes_of_five_decide(
    pattern: str, verdict: bool | None, provisional: bool | None
) -> None:
    belief = openly(pattern)
    assert belief.verdict(HERE) is verdict
    assert belief.provisional(HERE) is provisional
    assert (HERE in belief.roi) is (verdict is True)
    counted = pattern[:5]
    assert belief.tally(HERE, None) == Tally(counted.count("+"), len(counted))


def test_a_vantage_decides_for_a_cell_and_not_against_it() -> None:
    assert voted("+++").verdict(HERE) is True
    assert voted("-----").verdict(HERE) is None
    assert voted("-----").provisional(HERE) is None


def test_open_ballots_are_found_by_cell_and_listed_among_the_detections() -> None:
    belief = more(openly("+++"), "-----", at=NORTH, on=NORTH, first_s=10.0)
    belief = belief.with_frame(None, FrameId(1, 30.0), {NORTH: True})
    assert {cell: len(ballot) for cell, ballot in belief.open_ballots.items()} == {
        HERE: 3,
        NORTH: 1,
    }
    assert belief.detections() == [(NORTH, NORTH, False), (None, HERE, True)]
    assert belief.frames_taken(HERE) == 0
    assert belief.cells_searched == 3  # one with frames taken over it, two shown by others


# --- one frame twice -------------------------------------------------------------------------
def test_rest_of_a_late_frame_takes_nothing_back() -> None:
    early = voted("--+++", first_s=10.0)
    frame = FrameId(2, 0.0)
    assert early.in_time(HERE, frame, {HERE: False, NORTH: True}) == {NORTH: True}
    assert early.in_time(NORTH, frame, {HERE: False}) == {HERE: False}  # another vantage
    after = early.with_frame(HERE, frame, early.in_time(HERE, frame, {HERE: False}))
    assert after.roi == early.roi
    assert after.frames_taken(HERE) == 6  # the belief keeps that the frame was taken


def test_a_frame_of_the_same_instant_as_the_last_is_in_time() -> None:
    early = voted("--+++")
    last = FrameId(1, 4.0)
    assert early.in_time(HERE, last, {HERE: True}) == {HERE: True}
    assert early.in_time(HERE, FrameId(1, 3.9), {HERE: True}) == {}


# --- looks -----------------------------------------------------------------------------------
def test_a_look_is_over_when_all_five_cells_have_their_votes() -> None:
    belief = EMPTY
    for t in range(5):
        assert not belief.fully_voted(HERE)
        belief = belief.with_frame(HERE, FrameId(1, float(t)), dict.fromkeys(HERE.cross(), False))
    assert belief.fully_voted(HERE)
    assert not belief.fully_voted(NORTH)


def test_a_neighbour_that_was_cut_off_keeps_a_look_going() -> None:
    three = HERE.cross()[:4]
    belief = EMPTY
    for t in range(9):
        belief = belief.with_frame(HERE, FrameId(1, float(t)), dict.fromkeys(three, True))
    assert belief.frames_taken(HERE) == 9
    assert not belief.fully_voted(HERE)
    assert belief.tally(three[0], HERE) == Tally(5, 5)


def test_detections_are_full_ballots_in_a_fixed_order() -> None:
    belief = more(voted("+++--"), "---++", on=NORTH, first_s=100.0)
    belief = more(belief, "+++", at=NORTH, first_s=200.0)  # not full: no detection
    assert belief.detections() == [(HERE, HERE, True), (HERE, NORTH, False)]
    assert belief.roi == {HERE}
