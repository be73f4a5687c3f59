"""Frames and files, opened again, have the right content in the right places."""

from unittest.mock import MagicMock

import cv2
import numpy as np
import pytest
from PIL import Image, ImageSequence

from missions.errors import OutputError
from missions.units import Cell
from tests.unit.uavmap.output.film.runs import small_film
from uavmap.output import documents
from uavmap.output.drawing.palette import HIDDEN, PAPER, STATES, track_colour
from uavmap.output.film import film_writers as writers
from uavmap.output.film.film import FPS, HOLD_S, Change, Film, Fix, Place, Reel, Unit
from uavmap.output.film.film_writers import Stage, write_film


def at(stage, picture, place):
    x, y = stage.pixel(place)
    found = picture.convert("RGB").getpixel((int(x), int(y)))
    assert isinstance(found, tuple)
    return found


def corner_of(cell):
    return Place(cell.east - 0.4, cell.north + 0.4)


def test_frames_drawn_singly_are_those_drawn_together():
    film = small_film(robots=3)
    times = film.times()
    together = list(Stage(film).frames(times))
    for i in (0, len(times) // 3, len(times) // 2, len(times) - 1):
        (alone,) = Stage(film).frames([times[i]])
        assert np.array_equal(np.asarray(together[i]), np.asarray(alone)), i


def test_cells_have_the_colours_of_their_states_in_every_frame():
    film = small_film(cells=9, robots=1)
    stage, reel, times = Stage(film), Reel(film), film.times()
    for t, frame in zip(times, stage.frames(times), strict=True):
        list(reel.forward(t))
        for cell in film.roi:
            state = reel.states.get(cell)
            assert at(stage, frame, corner_of(cell)) == (STATES[state] if state else HIDDEN)


def test_gif_loops_and_shows_the_robots_where_they_are(tmp_path):
    film, path = small_film(robots=2), tmp_path / "film.gif"
    write_film(film, path, print)
    stage, times = Stage(film), film.times()
    with Image.open(path) as gif:
        assert gif.size == stage.size
        assert gif.info["loop"] == 0
        assert 10 < gif.n_frames <= len(times)  # equal frames are one
        frames, shown_ms = [], 0
        for frame in ImageSequence.Iterator(gif):
            shown_ms += frame.info["duration"]
            frames.append(frame.convert("RGB"))
    assert shown_ms == (len(times) - 1) * 1000 // FPS + HOLD_S * 1000
    for frame, t in ((frames[0], 0.0), (frames[-1], film.end_t)):
        for robot in film.tracks:
            assert at(stage, frame, film.fix(robot, t).place) == track_colour(robot)
        assert frame.getpixel((1, 1)) == PAPER
    assert at(stage, frames[0], corner_of(max(film.roi))) == HIDDEN
    assert at(stage, frames[-1], corner_of(max(film.roi))) == STATES["explored"]


def test_mp4_holds_every_frame_and_then_the_last(tmp_path):
    film, path = small_film(cells=9), tmp_path / "film.MP4"
    write_film(film, path, print)
    stage, video = Stage(film), cv2.VideoCapture(str(path))
    assert video.get(cv2.CAP_PROP_FPS) == FPS
    frames = []
    while True:
        there, frame = video.read()
        if not there:
            break
        frames.append(frame)
    assert len(frames) == len(film.times()) + HOLD_S * FPS
    assert frames[0].shape == (stage.size[1], stage.size[0], 3)
    for frame, t in ((frames[0], 0.0), (frames[-1], film.end_t)):
        picture = Image.fromarray(cv2.cvtColor(frame, cv2.COLOR_BGR2RGB))
        for robot in film.tracks:
            found = np.array(at(stage, picture, film.fix(robot, t).place), float)
            assert np.abs(found - track_colour(robot)).max() < 40  # the codec loses a little


def test_disc_of_a_vehicle_on_the_ground_is_hollow():
    track = (Fix(0.0, Place(1.0, 0.0), False), Fix(1.0, Place(1.0, 0.0), True))
    changes = (Change(0.0, Cell(0, 0), "non-roi"), Change(0.0, Cell(2, 2), "explored"))
    film = Film("", Unit.SECONDS, 2.0, frozenset(), changes, {1: track}, Place(0.0, 0.0))
    stage = Stage(film)
    ground, air = stage.frames([0.0, 2.0])
    assert at(stage, ground, Place(1.0, 0.0)) == PAPER
    assert at(stage, air, Place(1.0, 0.0)) == track_colour(1)
    assert at(stage, air, corner_of(Cell(0, 0))) == STATES["non-roi"]


def test_start_drifts_away_from_the_cells():
    start, drift = Place(0.0, 0.0), Place(2.0, 0.0)
    film = Film("", Unit.SECONDS, 3.0, frozenset({Cell(0, 0)}), (), {}, start, drift)
    stage = Stage(film)
    first, last = stage.frames([0.0, 3.0])
    assert at(stage, last, Place(0.0, 0.0)) == HIDDEN
    assert at(stage, first, Place(6.0, 0.0)) == PAPER
    ring = Place(6.0 - 0.13, 0.0)
    assert at(stage, last, ring) != PAPER


def test_roi_of_one_cell_and_a_very_long_one_are_drawn(tmp_path):
    write_film(small_film(cells=1), tmp_path / "one.gif", print)
    line = frozenset(Cell(east, 0) for east in range(1500))
    film = Film("", Unit.STEPS, 0.0, line, (), {}, Place(0.0, 0.0))
    (frame,) = Stage(film).frames([0.0])
    assert frame.width >= 1500
    longer = Film("", Unit.STEPS, 0.0, frozenset({Cell(0, 9000)}), (), {}, Place(0.0, 0.0))
    with pytest.raises(OutputError, match="1 x 9001 cells are too many"):
        write_film(longer, tmp_path / "longer.gif", print)
    assert not (tmp_path / "longer.gif").exists()


def test_bad_names_are_refused_in_a_line(tmp_path):
    film = small_film(cells=4)
    (tmp_path / "folder.gif").mkdir()
    for name, why in {
        "film.avi": "must end in .gif or .mp4",
        "film": "must end in .gif or .mp4",
        "nowhere/film.gif": "there is no folder",
        "folder.gif": "is a folder",
    }.items():
        with pytest.raises(OutputError, match=why) as error:
            write_film(film, tmp_path / name, print)
        assert "\n" not in str(error.value)
    assert [path.name for path in tmp_path.iterdir()] == ["folder.gif"]


def test_film_that_cannot_be_written_is_an_output_error(tmp_path, monkeypatch):
    monkeypatch.setattr(writers.os, "access", lambda path, mode: False)
    with pytest.raises(OutputError, match="is read-only"):
        write_film(small_film(cells=4), tmp_path / "film.gif", print)
    monkeypatch.undo()

    def full(path, data):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(documents, "write_bytes", full)
    with pytest.raises(OutputError, match=r"film\.gif: cannot be written \(No space left"):
        write_film(small_film(cells=4), tmp_path / "film.gif", print)


def test_missing_codec_is_an_output_error(tmp_path, monkeypatch):
    monkeypatch.setattr(writers.cv2, "VideoWriter", MagicMock())
    writers.cv2.VideoWriter.return_value.isOpened.return_value = False
    with pytest.raises(OutputError, match=r"mp4v is missing.*\.gif"):
        write_film(small_film(cells=4), tmp_path / "film.mp4", print)


def test_film_that_takes_long_reports_its_progress(tmp_path, monkeypatch):
    ticks = iter(range(10_000))
    monkeypatch.setattr(writers.time, "monotonic", lambda: float(next(ticks)))
    lines = []
    write_film(small_film(cells=4), tmp_path / "film.gif", lines.append)
    assert lines
    assert all(line.startswith("film.gif: frame ") for line in lines)
