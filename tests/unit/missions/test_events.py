"""Entries of the journal: every event and its text, and invalid texts."""

from __future__ import annotations

import dataclasses
import json
import math
import types
import typing

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions import events
from missions.classes import ClassShare
from missions.errors import EventError, UavmapError
from missions.events import (
    Airborne,
    Event,
    FrameLost,
    FrameSeen,
    Tracked,
    Vote,
    from_json,
    to_json,
)
from missions.fleet_events import Fact, Part
from missions.traffic import Track
from missions.units import Cell, GridPoint

FAST = settings(max_examples=300, deadline=None)
KINDS: tuple[type, ...] = typing.get_args(Event)

finite = st.floats(allow_nan=False, allow_infinity=False)
wild = st.sampled_from([math.nan, math.inf, -math.inf])
points = st.builds(GridPoint, finite, finite)
cells = st.builds(Cell, st.integers(-9999, 9999), st.integers(-9999, 9999))
votes = st.builds(Vote, cells, st.booleans(), st.floats(0, 1))
shares = st.lists(
    st.builds(ClassShare, cells, st.integers(1, 254), st.floats(0, 1)), max_size=4
).map(tuple)
facts = st.builds(
    Fact,
    finite,
    st.lists(st.tuples(cells, st.booleans()), max_size=6).map(tuple),
    st.booleans(),
    st.booleans(),
    shares,
)
texts = st.text(max_size=20).map(lambda s: s.encode("utf-8", "ignore").decode())

tracks = st.builds(
    Track, texts, texts, finite, points, st.none() | finite, finite, st.none() | points
)


def field_values(kind: type) -> dict[str, st.SearchStrategy[object]]:
    """Return a strategy of values for every field of an event."""
    of_type: dict[object, st.SearchStrategy[object]] = {
        int: st.integers(1, 50),
        float: finite,
        bool: st.booleans(),
        str: texts,
        GridPoint: points,
        Cell: cells,
        tuple[int, ...]: st.lists(st.integers(0, 50), max_size=6).map(tuple),
        tuple[float, ...]: st.lists(finite, max_size=6).map(tuple),
        tuple[GridPoint, ...]: st.lists(points, max_size=4).map(tuple),
        tuple[Vote, ...]: st.lists(votes, max_size=6).map(tuple),
        tuple[Cell, ...]: st.lists(cells, max_size=6).map(tuple),
        tuple[ClassShare, ...]: shares,
        tuple[Track, ...]: st.lists(tracks, max_size=4).map(tuple),
        tuple[Fact, ...]: st.lists(facts, max_size=4).map(tuple),
        tuple[Part, ...]: st.lists(
            st.builds(Part, st.integers(1, 50), st.lists(points, max_size=4).map(tuple)), max_size=4
        ).map(tuple),
    }
    hints = typing.get_type_hints(kind)

    def value(hint: object) -> st.SearchStrategy[object]:
        of = typing.get_args(hint)
        if typing.get_origin(hint) is typing.Literal:
            return st.sampled_from(of)
        if types.NoneType in of:
            return st.none() | value(of[0])
        return of_type[hint]

    return {name: value(hint) for name, hint in hints.items() if name != "kind"}


anything = st.one_of([st.builds(kind, **field_values(kind)) for kind in KINDS])


@FAST
@given(anything)
def test_an_event_is_the_same_after_its_text_a_line_that_names_its_kind(event):
    text = to_json(event)
    again = from_json(text)
    assert again == event
    assert type(again) is type(event)
    assert to_json(again) == text
    assert "\n" not in text
    values = json.loads(text)
    assert values["kind"] == event.kind
    assert values["t_s"] == event.t_s


def test_event_of_a_vehicle_has_its_number_and_time():
    for kind in typing.get_args(events.VehicleEvent):
        assert [field.name for field in dataclasses.fields(kind)][:2] == ["vehicle", "t_s"]


def test_events_cannot_be_changed():
    for kind in KINDS:
        assert kind.__dataclass_params__.frozen


def test_the_text_of_a_frame_is_as_journals_have_it():
    text = (
        '{"vehicle":2,"t_s":31.25,"vantage":[3,-4],'
        '"votes":[[[3,-4],true,0.875],[[3,-3],false,0.0]],"kind":"frame_seen"}'
    )
    event = FrameSeen(
        2, 31.25, Cell(3, -4), (Vote(Cell(3, -4), True, 0.875), Vote(Cell(3, -3), False, 0.0))
    )
    assert from_json(text) == event
    assert to_json(event) == text


def test_frame_from_anywhere_is_marked_as_without_a_vantage():
    text = '{"vehicle":2,"t_s":31.25,"vantage":null,"votes":[],"kind":"frame_seen"}'
    assert from_json(text) == FrameSeen(2, 31.25, None, ())
    assert to_json(FrameSeen(2, 31.25, None, ())) == text
    with pytest.raises(ValueError, match="vantage"):  # a missing vantage is an error
        from_json(text.replace('"vantage":null,', ""))


def test_cells_and_points_come_back_with_their_types():
    seen = from_json(to_json(FrameSeen(1, 0.0, Cell(1, 2), (Vote(Cell(1, 2), True, 1.0),))))
    assert isinstance(seen, FrameSeen)
    assert isinstance(seen.vantage, Cell)
    assert isinstance(seen.votes[0], Vote)
    assert isinstance(seen.votes[0].cell, Cell)
    tracked = from_json(to_json(Tracked(1, 2.0, GridPoint(1.5, -2.5), 12.0, 30.0)))
    assert isinstance(tracked, Tracked)
    assert isinstance(tracked.position, GridPoint)


@given(anything, wild)
def test_a_time_that_is_none_is_refused(event, value):
    with pytest.raises(EventError, match=f"{event.kind}: t_s = "):
        to_json(dataclasses.replace(event, t_s=value))


@given(wild)
def test_a_number_deep_inside_is_refused(value):
    place = GridPoint(0.0, value)
    vote = Vote(Cell(0, 0), True, value)
    for event in (
        Tracked(1, 0.0, place, 1.0, 1.0),
        FrameSeen(1, 0.0, Cell(0, 0), (vote,)),
    ):
        with pytest.raises(EventError, match=event.kind):
            to_json(event)


def test_a_text_that_is_no_unicode_is_refused():
    with pytest.raises(EventError, match="frame_lost"):
        to_json(FrameLost(1, 0.0, "\ud800"))
    assert issubclass(EventError, ValueError)
    assert issubclass(EventError, UavmapError)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "null",
        "[]",
        "{}",
        '{"vehicle":1,"t_s":2.5}',
        '{"vehicle":1,"t_s":2.5,"kind":"teleported"}',
        '{"vehicle":1,"kind":"airborne"}',
        '{"vehicle":"one","t_s":2.5,"kind":"airborne"}',
        '{"vehicle":1,"t_s":null,"kind":"airborne"}',
        '{"vehicle":1,"t_s":NaN,"kind":"airborne"}',
        '{"vehicle":1,"t_s":1e999,"kind":"airborne"}',
        '{"vehicle":"1","t_s":0.0,"kind":"airborne"}',
        '{"vehicle":1,"t_s":2.5,"kind":"airborne"',
        "[" * 10_000,
        '{"vehicle":1,"t_s":2.5,"vantage":[1],"votes":[],"kind":"frame_seen"}',
    ],
)
def test_text_that_is_no_event_is_an_error_and_not_a_guess(text):
    with pytest.raises(ValueError):  # noqa: PT011 - pydantic's, whose words are its own
        from_json(text)


def test_an_event_cut_short_anywhere_is_an_error():
    text = to_json(FrameSeen(1, 3.0, Cell(0, 0), (Vote(Cell(0, 0), True, 0.5),)))
    for end in range(len(text)):
        with pytest.raises(ValueError):  # noqa: PT011
            from_json(text[:end])


def test_the_shortest_event():
    assert to_json(Airborne(1, 2.5)) == '{"vehicle":1,"t_s":2.5,"kind":"airborne"}'
