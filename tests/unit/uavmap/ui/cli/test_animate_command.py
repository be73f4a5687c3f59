"""`uavmap animate` of missions with little content."""

import pytest

from missions.events import Connected, FrameSeen, Vote
from missions.units import Cell, GridPoint
from tests.support.journals import begun
from tests.support.plans import named_text, plan_of
from uavmap.journal.flight_plan import JOURNAL
from uavmap.ui.cli import main

HOME = GridPoint(0.0, 0.0)
STARTED = Connected(1, 0.0, HOME, HOME, 0.0, False, True, 60.0)
NOTHING_SEEN = FrameSeen(1, 9.0, Cell(1, 0), (Vote(Cell(1, 0), False, 0.0),))


RUNWAY = named_text("runway")
PLAN = plan_of(RUNWAY.source, RUNWAY.text)


def test_mission_that_judged_nothing_is_refused(tmp_path, refused):
    folder = begun(tmp_path / "out", PLAN, [STARTED])
    assert "no picture was judged" in refused("animate", folder)
    assert [path.name for path in folder.iterdir()] == [JOURNAL]


def test_search_without_a_region_has_a_film_and_no_tree(tmp_path, capsys, refused):
    folder = begun(tmp_path / "out", PLAN, [STARTED, NOTHING_SEEN])
    assert main(["animate", str(folder)]) == 0
    assert "there is no tree to draw" in capsys.readouterr().err
    assert sorted(path.name for path in folder.iterdir()) == ["flight.gif", JOURNAL]
    line = refused("animate", folder, "--tree", tmp_path / "tree.png")
    assert "there is no tree to draw" in line


def test_photographs_have_a_film(tmp_path, capsys):
    seen = [FrameSeen(1, 0.1 * i, Cell(1, 0), (Vote(Cell(1, 0), True, 1.0),)) for i in range(5)]
    folder = begun(tmp_path / "out", PLAN, seen, replay="photos")
    assert main(["animate", str(folder), "--animate", str(tmp_path / "film.gif")]) == 0
    assert (tmp_path / "film.gif").exists()


@pytest.mark.parametrize("index", ["-1", "first", "1.5"])
def test_index_that_is_no_place_in_a_list_is_refused(index, capsys):
    with pytest.raises(SystemExit):
        main(["simulate", "--roi", "eden:4:1", f"--index={index}"])
    assert "--index" in capsys.readouterr().err
