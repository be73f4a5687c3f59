"""Deltas add up to the snapshot, at any rate of updates of a browser."""

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uavmap.ui.page import board as module
from uavmap.ui.page.board import Board
from uavmap.ui.page.hub import Timeline

few = st.integers(-2, 2)
number = st.floats(-1e6, 1e6, allow_nan=False)
changes = st.one_of(
    st.builds(lambda e, n, c: lambda b: b.set_cell((e, n), c), few, few, st.integers(0, 6)),
    st.builds(lambda k, v: lambda b: b.set_field(k, v), st.sampled_from("abc"), few),
    st.builds(lambda k, v: lambda b: b.set_vehicle(k, {"e": v}), st.integers(1, 3), number),
    st.builds(lambda k, e, n: lambda b: b.add_point(k, e, n), st.integers(1, 2), number, number),
    st.builds(lambda t: lambda b: b.add_line(t, "said", "x"), number),
)


@given(st.lists(st.tuples(st.lists(changes, max_size=8), st.booleans()), max_size=12))
@settings(max_examples=25)
def test_deltas_add_up_to_the_snapshot(turns):
    board, quick, slow = Board(), Board(), Board()
    for several, tell_slow in turns:
        for change in several:
            change(board)
        quick.apply(json.loads(json.dumps(board.since(quick.version))))
        if tell_slow:
            slow.apply(json.loads(json.dumps(board.since(slow.version))))
    slow.apply(board.since(slow.version))
    late = Board()
    late.apply(board.since(0))
    assert quick.since(0) == slow.since(0) == late.since(0) == board.since(0)


def test_deltas_of_bounded_lists_add_up_to_the_snapshot():
    board, slow = Board(), Board()
    for i in range(module.MAX_LINES + 7):
        board.add_line(float(i), "said", str(i))
        if i == 3:
            slow.apply(board.since(0))
    for i in range(module.MAX_POINTS + 5):
        board.add_point(1, float(i), 0.0)
    slow.apply(board.since(slow.version))
    assert slow.since(0) == board.since(0)
    assert len(board.since(0)["log"]) == module.MAX_LINES
    assert len(board.since(0)["tracks"]["1"]) == 2 * module.MAX_POINTS


def test_board_without_news_has_no_new_version():
    board = Board()
    board.set_cell((0, 0), 1)
    assert board.commit()
    board.set_cell((0, 0), 1)
    assert not board.commit()
    assert board.since(board.version) == {
        "v": 1, "since": 1, "cells": [], "fields": {}, "vehicles": {}, "tracks": {}, "log": [],
    }  # fmt: skip


def test_delta_after_a_gap_is_refused():
    board = Board()
    for code in range(3):
        board.set_cell((0, 0), code)
        board.commit()
    with pytest.raises(ValueError, match="does not follow"):
        Board().apply(board.since(2))


@given(st.lists(st.lists(changes, max_size=4), min_size=1, max_size=60), st.integers(0, 80))
@settings(max_examples=12)
def test_timeline_has_the_board_of_every_time(turns, at):
    board, timeline, then = Board(), Timeline(), []
    for t, several in enumerate(turns):
        for change in several:
            change(board)
        known = then[-1]["v"] if then else 0
        timeline.add(float(t), board.since(known))
        then.append(board.since(0))
    assert timeline.at(float(at)).since(0) == then[min(at, len(then) - 1)]
