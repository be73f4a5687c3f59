"""`uavmap animate` of missions that have little to show, and the options for other commands."""

from __future__ import annotations

import argparse
from pathlib import Path

import pytest

from missions.errors import OutputError
from missions.events import Connected, Event, FrameSeen, Vote
from missions.units import Cell, GridPoint
from tests.support.plans import named_text, plan_of
from tests.unit.uavmap.output.film.runs import explored, small_roi
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import JOURNAL
from uavmap.lab.run_film import film_of_run
from uavmap.ui.cli import main
from uavmap.ui.cli.picture_options import (
    add_picture_options,
    check_pictures,
    wants_pictures,
    write_pictures,
)

HOME = GridPoint(0.0, 0.0)
STARTED = Connected(1, 0.0, HOME, HOME, 0.0, False, True, 60.0)
NOTHING_SEEN = FrameSeen(1, 9.0, Cell(1, 0), (Vote(Cell(1, 0), False, 0.0),))


def journal(folder: Path, *events: Event, replay: bool = False) -> Path:
    source = named_text("runway")
    meta = {
        "plan": plan_of(source.source, source.text).as_json(),
        **({"replay": "photos"} if replay else {}),
    }
    with Journal.create(folder / JOURNAL, meta) as opened:
        for event in events:
            opened.append(event)
    return folder


def test_a_mission_that_judged_nothing_is_refused(tmp_path, capsys):
    folder = journal(tmp_path / "out", STARTED)
    assert main(["animate", str(folder)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "no picture was judged" in line
    assert [path.name for path in folder.iterdir()] == [JOURNAL]


def test_a_search_in_vain_has_a_film_and_no_tree(tmp_path, capsys):
    folder = journal(tmp_path / "out", STARTED, NOTHING_SEEN)
    assert main(["animate", str(folder)]) == 0
    assert "there is no tree to draw" in capsys.readouterr().err
    assert sorted(path.name for path in folder.iterdir()) == ["flight.gif", JOURNAL]
    assert main(["animate", str(folder), "--tree", str(tmp_path / "tree.png")]) == 2
    assert "there is no tree to draw" in capsys.readouterr().err


def test_photographs_have_a_film(tmp_path, capsys):
    seen = [FrameSeen(1, 0.1 * i, Cell(1, 0), (Vote(Cell(1, 0), True, 1.0),)) for i in range(5)]
    folder = journal(tmp_path / "out", *seen, replay=True)
    assert main(["animate", str(folder), "--animate", str(tmp_path / "film.gif")]) == 0
    assert (tmp_path / "film.gif").exists()


def picture_options(*arguments: str, several: bool = False) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_picture_options(parser, several=several)
    return parser.parse_args(arguments)


def test_a_simulated_run_is_written_by_the_same_options(tmp_path):
    roi = small_roi(9)
    run = explored(roi)
    film, tree = tmp_path / "film.gif", tmp_path / "tree.svg"
    options = picture_options("--animate", str(film), "--tree", str(tree), several=True)
    assert options.index == 0
    check_pictures(options)
    said: list[str] = []
    write_pictures(options, film_of_run(run, roi, "a run"), run.tree, said.append)
    assert film.exists()
    assert tree.exists()
    assert [line.split()[0] for line in said if "frame" not in line] == ["animation", "tree"]


def test_names_are_checked_before_anything_is_computed():
    assert not wants_pictures(picture_options())
    for arguments in (["--animate", "film.mov"], ["--tree", "tree.pdf"]):
        options = picture_options(*arguments)
        assert wants_pictures(options)
        with pytest.raises(OutputError):
            check_pictures(options)


@pytest.mark.parametrize("index", ["-1", "first", "1.5"])
def test_an_index_is_a_place_in_a_list(index, capsys):
    with pytest.raises(SystemExit):
        picture_options(f"--index={index}", several=True)
    assert "--index" in capsys.readouterr().err
