"""The film on the terminal: the right colours, at the pace of the clock, or nothing."""

from __future__ import annotations

import io
import math

import pytest
from rich.console import Console

from tests.unit.uavmap.animation.runs import small_film
from uavmap.animation import live
from uavmap.animation.film import FPS, Reel
from uavmap.animation.stage import HIDDEN
from uavmap.animation.terminal import grid_of
from uavmap.clock import VirtualClock
from uavmap.results.palette import STATES, track_colour
from uavmap.results.picture import PAPER


def console(terminal: bool) -> tuple[Console, io.StringIO]:
    stream = io.StringIO()
    return Console(
        file=stream,
        force_terminal=terminal,
        width=60,
        height=30,
        color_system="truecolor",
        legacy_windows=False,
        _environ={},
    ), stream


def test_it_plays_on_the_clock_to_the_last_frame():
    film, clock = small_film(), VirtualClock()
    screen, stream = console(terminal=True)
    assert live(film, screen, clock)
    lasts_s = len(film.times()) / FPS
    assert lasts_s <= clock.now_s() < lasts_s + 0.2
    shown = stream.getvalue()
    assert "t = 0 of" in shown
    assert f"t = {film.end_t:g} of {film.end_t:g}" in shown
    assert "24 of 24 cells known, 24 visited" in shown
    assert "▀" in shown


def test_where_there_is_no_terminal_nothing_is_shown():
    clock = VirtualClock()
    screen, stream = console(terminal=False)
    assert not live(small_film(), screen, clock)
    assert stream.getvalue() == ""
    assert clock.now_s() == 0.0


def test_a_pixel_is_a_cell():
    film = small_film(robots=1)
    west, _, east, north = film.bounds()
    reel, t = Reel(film), film.end_t / 2
    list(reel.forward(t))
    pixels = grid_of(film, reel, t, columns=east - west + 1, lines=50)
    robot = film.fix(0, t).place
    at_robot = math.floor(robot.east + 0.5), math.floor(robot.north + 0.5)
    for n, row in enumerate(pixels):
        for e, colour in enumerate(row):
            cell = (west + e, north - n)
            state = next((s for c, s in reel.states.items() if c == cell), None)
            expected = HIDDEN if any(c == cell for c in film.roi) else PAPER
            if state is not None:
                expected = STATES[state]
            assert colour == (track_colour(0) if cell == at_robot else expected)


@pytest.mark.parametrize(("columns", "lines"), [(1, 1), (2, 1), (3, 9), (7, 2), (200, 80)])
def test_it_fits_the_terminal_and_shows_what_is_urgent(columns, lines):
    film = small_film(robots=1, cells=40)
    reel = Reel(film)
    pixels = grid_of(film, reel, 0.0, columns, lines)
    assert len(pixels) % 2 == 0
    assert len(pixels) <= 2 * lines
    assert {len(row) for row in pixels} == {len(pixels[0])}
    assert len(pixels[0]) <= columns
    assert any(track_colour(0) in row for row in pixels)
