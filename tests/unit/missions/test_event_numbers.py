"""What an event says is what is read back, to the last bit; what JSON cannot hold is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from missions.errors import EventError, UavmapError
from missions.events import (
    Connected,
    Event,
    FrameLost,
    FrameSeen,
    Tracked,
    Vote,
    from_json,
    to_json,
)
from missions.units import Cell, GridPoint

finite = st.floats(allow_nan=False, allow_infinity=False)
wild = st.sampled_from([math.nan, math.inf, -math.inf])
numbers = st.integers(1, 50)
cells = st.builds(Cell, st.integers(-(2**31), 2**31), st.integers(-(2**31), 2**31))
points = st.builds(GridPoint, finite, finite)
votes = st.lists(st.builds(Vote, cells, st.booleans(), finite), max_size=5).map(tuple)
events: st.SearchStrategy[Event] = st.one_of(
    st.builds(Tracked, numbers, finite, points, finite, finite),
    st.builds(FrameSeen, numbers, finite, st.none() | cells, votes),
    st.builds(FrameLost, numbers, finite, st.text(st.characters(codec="utf-8"))),
    st.builds(
        Connected, numbers, finite, points, points, finite, st.booleans(), st.booleans(), finite
    ),
)


@given(events)
def test_an_event_is_read_back_as_it_was(event: Event) -> None:
    text = to_json(event)
    assert from_json(text) == event
    assert to_json(from_json(text)) == text


@given(events, wild)
def test_a_time_that_is_none_is_refused(event: Event, value: float) -> None:
    with pytest.raises(EventError, match=f"{event.kind}: t_s = "):
        to_json(replace(event, t_s=value))


@given(wild)
def test_a_number_deep_inside_is_refused(value: float) -> None:
    place = GridPoint(0.0, value)
    vote = Vote(Cell(0, 0), True, value)
    for event in (
        Tracked(1, 0.0, place, 1.0, 1.0),
        FrameSeen(1, 0.0, Cell(0, 0), (vote,)),
    ):
        with pytest.raises(EventError, match=event.kind):
            to_json(event)


def test_the_word_null_is_a_word() -> None:
    event = FrameLost(1, 0.0, "null and nan")
    assert from_json(to_json(event)) == event


def test_a_text_that_is_no_unicode_is_refused() -> None:
    with pytest.raises(EventError, match="frame_lost"):
        to_json(FrameLost(1, 0.0, "\ud800"))
    assert issubclass(EventError, ValueError)
    assert issubclass(EventError, UavmapError)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        '{"vehicle":1,"t_s":null,"kind":"airborne"}',
        '{"vehicle":1,"t_s":NaN,"kind":"airborne"}',
        '{"vehicle":1,"t_s":1e999,"kind":"airborne"}',
        '{"vehicle":"1","t_s":0.0,"kind":"airborne"}',
        '{"vehicle":1,"t_s":0.0,"kind":"eaten"}',
        '{"vehicle":1,"t_s":0.0,"kind":"airborne"',
        "[" * 10_000,
    ],
)
def test_what_is_no_event(text: str) -> None:
    with pytest.raises((ValidationError, EventError)):
        from_json(text)
