"""The contents of a folder, and the commands that run in it."""

from __future__ import annotations

import json
import sqlite3
from pathlib import Path

import cv2
import numpy as np
import pytest

from missions.errors import OutputError, UavmapError
from uavmap.journal.flight_plan import JOURNAL
from uavmap.load.mbtiles import Tiles
from uavmap.ui.app.jobs import MAX_RUNNING, Jobs
from uavmap.ui.app.workspace import Workspace, verdict


def test_missions_pictures_detectors_and_results_are_listed(tmp_path: Path) -> None:
    (tmp_path / "field.toml").write_text("")
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "DJI_1.JPG").write_bytes(b"")
    (tmp_path / "grass").mkdir()
    (tmp_path / "grass" / "detector.toml").write_text("")
    for name, summary in (("old", {"completed": True, "patches": [{"area_m2": 1200.4}]}),
                          ("new", None)):  # fmt: skip
        folder = tmp_path / "results" / name
        folder.mkdir(parents=True)
        (folder / JOURNAL).write_bytes(b"")
        if summary is not None:
            (folder / "summary.json").write_text(json.dumps(summary))
    workspace = Workspace(tmp_path)
    assert workspace.missions() == ["field.toml"]
    assert workspace.picture_folders() == ["photos"]
    assert workspace.detectors() == ["grass"]
    verdicts = {flown.name: verdict(flown.summary()) for flown in workspace.results()}
    assert verdicts == {
        "results/old": "complete, 1,200 m2",
        "results/new": "under way, or interrupted",
    }


@pytest.mark.parametrize("name", ["../x", "/etc/passwd", "a/../../x"])
def test_file_elsewhere_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(UavmapError, match="choose a file of this folder"):
        Workspace(tmp_path).path_of(name)


def test_link_out_of_the_folder_is_refused(tmp_path: Path) -> None:
    inside = tmp_path / "inside"
    inside.mkdir()
    (inside / "out").symlink_to(tmp_path)
    with pytest.raises(UavmapError):
        Workspace(inside).path_of("out/secret")


def test_files_from_a_browser_stay_in_the_folder(tmp_path: Path) -> None:
    workspace = Workspace(tmp_path)
    assert workspace.place_for("photos", "DJI (1).JPG") == tmp_path / "photos" / "DJI (1).JPG"
    for folder, name in (("", "-rf.kml"), ("", ".hidden"), ("", "a/b.kml"), ("..", "x.kml"),
                         ("-x", "a.jpg"), ("", ""), ("", "a\nb.kml")):  # fmt: skip
        with pytest.raises(UavmapError):
            workspace.place_for(folder, name)
    (tmp_path / "field.kml").write_text("")
    with pytest.raises(UavmapError, match="already exists"):
        workspace.place_for("", "field.kml")


def test_names_of_new_missions_are_checked(tmp_path: Path) -> None:
    workspace = Workspace(tmp_path)
    assert workspace.new_name("Fläche 1", ".toml") == "Fläche 1.toml"
    assert workspace.new_name("field.toml", ".toml") == "field.toml"
    for bad in ("", "../x", "-x", ".x", "a/b", "x" * 61):
        with pytest.raises(UavmapError, match="use letters"):
            workspace.new_name(bad, ".toml")
    (tmp_path / "field.toml").write_text("")
    with pytest.raises(UavmapError, match="already exists"):
        workspace.new_name("field", ".toml")


def test_command_runs_in_the_folder_and_its_lines_are_kept(tmp_path: Path) -> None:
    (tmp_path / "bad mission.toml").write_text("grid.cell_m = 0")
    jobs = Jobs(tmp_path)
    job = jobs.begin(["check", "bad mission.toml"])
    assert job.shown == "uavmap check 'bad mission.toml'"
    assert job.process.wait() == 2
    assert "bad mission.toml: start: missing" in "\n".join(job.lines())
    assert job.state == "refused (exit code 2)"
    assert job.page(steers=True) is None
    job.interrupt()  # it has ended: no signal is sent
    assert jobs.running == []


def test_commands_beyond_the_maximum_are_refused(tmp_path: Path) -> None:
    jobs = Jobs(tmp_path)
    begun = [jobs.begin(["--version"]) for _ in range(MAX_RUNNING)]
    for job in begun:
        job.process.wait()
    jobs.begin(["--version"]).process.wait()  # they have ended

    class Runs:
        runs = True

    jobs.all = [Runs()] * MAX_RUNNING  # type: ignore[list-item]
    with pytest.raises(UavmapError, match="end one of them first"):
        jobs.begin(["--version"])


def test_tiles_of_a_file_are_served(tmp_path: Path) -> None:
    path = tmp_path / "area.mbtiles"
    png = cv2.imencode(".png", np.zeros((8, 8, 3), np.uint8))[1].tobytes()
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE metadata (name TEXT, value TEXT)")
        database.execute(
            "CREATE TABLE tiles (zoom_level INT, tile_column INT, tile_row INT, tile_data BLOB)"
        )
        database.execute("INSERT INTO tiles VALUES (1, 1, 1, ?)", (png,))
        database.execute("INSERT INTO tiles VALUES (1, 0, 1, 'no bytes')")
    tiles = Tiles(path)
    assert tiles.tile(1, 1, 0) == png  # rows of the file count from the south
    assert tiles.tile(1, 0, 0) is None
    assert tiles.tile(9, 0, 0) is None
    assert tiles.zooms == range(1, 2)
    assert tiles.middle == pytest.approx((66.513, 0.0), abs=1e-3)
    (tmp_path / "none.mbtiles").write_bytes(b"no database")
    with pytest.raises(OutputError, match="cannot be read as MBTiles"):
        Tiles(tmp_path / "none.mbtiles")
