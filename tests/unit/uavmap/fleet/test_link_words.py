"""The words of --comms: in flight, in metres and seconds, and on the grid, in cells and steps."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from missions.lab.arena.arena_run import Comms
from missions.lab.arena.radio import Links
from missions.partition import Partition
from uavmap.fleet.simulated_radio import LinkModel, link_model
from uavmap.lab.simulated_links import simulated_links

in_flight: Callable[[str], object] = link_model


def on_the_grid(text: str) -> Comms | Links:
    return simulated_links(text, 4, 7)


@pytest.mark.parametrize(
    ("text", "model"),
    [
        ("free", LinkModel()),
        ("meeting,delay:0", LinkModel(range_m=20.0, delay_s=0.0)),
        (
            "range:200,loss:0.1,delay:0.1,jitter:0.05,rate:300",
            LinkModel(200.0, 0.1, 0.1, 0.05, bytes_per_s=300.0),
        ),
    ],
)
def test_in_flight(text: str, model: LinkModel) -> None:
    assert link_model(text) == model


@pytest.mark.parametrize(
    ("text", "links"),
    [
        ("shared", Comms.SHARED),
        ("free", Comms.SHARED),
        ("meeting", Comms.MEETING),
        ("range:8", Links(8.0, seed=7)),
        ("range:inf", Links(seed=7)),
        ("shared,loss:1", Links(loss=1.0, seed=7)),
        ("range:2.5,loss:0.1,delay:3,rate:0.5", Links(2.5, 0.1, 3.0, 0.5, seed=7)),
        (
            "free,apart:0-4,apart:6.5-9:1+2/4",
            Links(
                apart=(
                    Partition(0.0, 4.0),
                    Partition(6.5, 9.0, (frozenset({0, 1}), frozenset({3}))),
                ),
                seed=7,
            ),
        ),
    ],
)
def test_on_the_grid(text: str, links: Comms | Links) -> None:
    assert on_the_grid(text) == links


@pytest.mark.parametrize("read", [in_flight, on_the_grid])
@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "'' is none of"),
        ("near", "'near' is none of"),
        ("free:3", "'free:3' is none of"),
        ("range", "range: is not a number; it is a distance in"),
        ("range:x", "range:x is not a number"),
        ("range:nan", "range:nan is not a number"),
        ("range:-1", "range:-1 has to be 0 or more"),
        ("free,", "'' is not known; after a comma stands one of loss, delay"),
        ("free,colour:1", "'colour' is not known"),
        ("free,loss:1.5", "loss:1.5 is above 1; it is the share that is lost"),
        ("free,delay:inf", "delay:inf is not a number; it is a time"),
        ("free,rate:0", "rate:0 has to be above 0"),
        ("free,loss:0.1,loss:0.2", "loss stands there twice"),
    ],
)
def test_what_is_no_radio_is_said(read: Callable[[str], object], text: str, said: str) -> None:
    with pytest.raises(ValueError, match=re.escape(said)):
        read(text)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("meeting,loss:0.1", "write meeting alone"),
        ("meeting,apart:1-2", "write meeting alone"),
        ("free,jitter:1", "one of loss, delay, rate, apart"),
        ("free,apart:5", "write apart:BEGIN-END"),
        ("free,apart:9-3", "ends before it begins"),
        ("free,apart:3-3", "ends before it begins"),
        ("free,apart:1-2:", "write apart:BEGIN-END"),
        ("free,apart:1-2:1++2", "write apart:BEGIN-END"),
        ("free,apart:1-2:0+1", "robot 0 is none of 1 to 4"),
        ("free,apart:1-2:1+5", "robot 5 is none of 1 to 4"),
        ("free,apart:1-2:1+2/2", "robot 2 stands there twice"),
    ],
)
def test_what_is_no_radio_on_the_grid_is_said(text: str, said: str) -> None:
    with pytest.raises(ValueError, match=re.escape(said)):
        on_the_grid(text)


@given(
    st.sampled_from(["", "range:5,", "free,apart:"]),
    st.text("rangefloosdtyp:,.+-/0123456789 einfx", max_size=30),
)
def test_any_text_is_a_radio_or_a_value_error(start: str, text: str) -> None:
    for read in (in_flight, on_the_grid):
        with contextlib.suppress(ValueError):
            read(start + text)
