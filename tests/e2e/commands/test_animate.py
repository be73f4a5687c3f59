"""`uavmap animate`: from the folder of a flight to its film and its tree."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest
from PIL import Image

from tests.e2e.rig import Flight, python, uavmap
from uavmap.journal.flight_plan import JOURNAL
from uavmap.output.drawing.palette import STATES, track_colour
from uavmap.output.film.film import FPS, LONGEST_S
from uavmap.ui.cli import main


@pytest.fixture
def folder(tiny: Flight, tmp_path: Path) -> Path:
    place = tmp_path / "flight"
    place.mkdir()
    shutil.copy(tiny.folder / JOURNAL, place)
    return place


def colours(path: Path, frame: int = 0) -> set[tuple[int, int, int]]:
    with Image.open(path) as picture:
        picture.seek(frame)
        found = picture.convert("RGB").getcolors(maxcolors=1 << 20)
    assert found is not None
    return {colour for _, colour in found if isinstance(colour, tuple)}


def test_flight_becomes_a_film_and_a_tree(folder, tiny):
    done = uavmap("animate", folder)
    assert (done.code, done.out) == (0, "")
    assert sorted(path.name for path in folder.iterdir()) == ["flight.gif", JOURNAL, "tree.png"]
    with Image.open(folder / "flight.gif") as film:
        frames = film.n_frames
    assert 20 < frames <= LONGEST_S * FPS
    shown = colours(folder / "flight.gif", frame=frames - 1)
    assert STATES["explored"] in shown
    assert STATES["unexplored"] not in colours(folder / "tree.png") - shown
    assert track_colour(1) in colours(folder / "flight.gif", frame=frames // 2)
    before = (folder / "flight.gif").read_bytes(), (folder / "tree.png").read_bytes()
    assert main(["animate", str(folder)]) == 0  # and the same again, byte for byte
    assert before == ((folder / "flight.gif").read_bytes(), (folder / "tree.png").read_bytes())


def test_requested_files_and_no_others_are_written(folder, tmp_path, tiny, capsys):
    film, tree = tmp_path / "film.mp4", tmp_path / "tree.svg"
    assert main(["animate", str(folder), "--animate", str(film), "--tree", str(tree)]) == 0
    assert film.stat().st_size > 10_000
    text = tree.read_text("utf-8")
    assert f"{tiny.summary['vertices']} vertices" in text
    assert f"depth_T = {tiny.summary['tree_depth']}" in text
    assert [path.name for path in folder.iterdir()] == [JOURNAL]
    err = capsys.readouterr().err
    assert str(film) in err
    assert str(tree) in err


def test_names_without_a_folder_go_to_the_working_folder(folder, tmp_path, monkeypatch, capsys):
    """By default in the working folder, as with any program; with -o elsewhere."""
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    there.mkdir()
    monkeypatch.chdir(here)
    assert main(["animate", str(folder), "--tree", "a.svg"]) == 0
    assert main(["animate", str(folder), "--tree", "b.svg", "-o", str(there)]) == 0
    assert main(["animate", str(folder), "--tree", "./c.svg", "--out", str(folder)]) == 0
    assert [path.name for path in here.iterdir()] == ["a.svg"]
    assert [path.name for path in there.iterdir()] == ["b.svg"]
    assert sorted(path.name for path in folder.iterdir()) == ["c.svg", JOURNAL]
    assert f"tree in {there / 'b.svg'}" in capsys.readouterr().err
    assert main(["animate", str(folder), "-o", str(tmp_path / "none")]) == 2
    assert "no such folder" in capsys.readouterr().err


def test_folder_without_a_journal_is_refused(tmp_path, capsys):
    assert main(["animate", str(tmp_path / "nothing")]) == 2
    assert main(["animate", str(tmp_path)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2
    assert all("there is no journal here" in line for line in lines)


def test_recording_for_rerun_has_cells_tree_vehicles_and_frames(folder, tiny, tmp_path):
    pytest.importorskip("rerun", reason="rerun-sdk is not installed (the extra rerun)")
    recording = tmp_path / "flight.rrd"
    assert main(["animate", str(folder), "--rerun", str(recording)]) == 0
    assert [path.name for path in folder.iterdir()] == [JOURNAL]
    printed = python("-m", "rerun_cli", "rrd", "print", recording).out
    for entity in ("/region/cells", "/region/tree", "/vehicles/1", "/vehicles/1/battery_wh"):
        assert f"{entity} " in printed.replace(chr(10), " ").replace("'", " ")


def test_animate_without_rerun_names_the_package(folder, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert main(["animate", str(folder), "--rerun", str(tmp_path / "flight.rrd")]) == 2
    assert "pip install 'rerun-sdk>=" in capsys.readouterr().err
    assert main(["animate", str(folder), "--rerun", str(tmp_path / "flight.gif")]) == 2
    assert "must end in .rrd" in capsys.readouterr().err
