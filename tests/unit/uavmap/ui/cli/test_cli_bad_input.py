"""Every kind of wrong input: exit code 2 and a line with the reason, in process."""

import re
import shutil
import socket

import numpy as np
import pytest
from PIL import Image

from tests.support.photographs import write_photo
from tests.support.plans import named_text
from tests.support.ports import free_port
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import JOURNAL, TLOG
from uavmap.ui.cli import main

RUNWAY = named_text("runway").text


def changed(folder, pattern, replacement):
    text, count = re.subn(pattern, replacement, RUNWAY, count=1, flags=re.DOTALL | re.MULTILINE)
    assert count == 1
    path = folder / "field.toml"
    path.write_text(text)
    return path


MISSION_FAULTS = {
    "a missing key": (r"^position = .*?$", "", "start.position: missing"),
    "a missing table": (r"^\[search\].*?^\[fence\]", "[fence]", "search: missing"),
    "a misspelt key": (r"^cell_m", "cel_m", "grid.cel_m: unknown key; did you mean 'cell_m'?"),
    "no TOML": (r"^name = ", "name ", "not a TOML file"),
    "an unknown strategy": (r'^strategy = "swath"', 'strategy = "dfs"', "strategy"),
    "an unknown detector": (r'^name = "threshold"', 'name = "oracle"', "detector.name"),
}
"""One fault of each kind; all others are in `tests/unit/missions/mission`."""


@pytest.mark.parametrize("command", ["check", "fly", "replay"])
@pytest.mark.parametrize("fault", MISSION_FAULTS)
def test_faulty_mission_file_is_refused_in_a_line(tmp_path, refused, command, fault):
    pattern, replacement, words = MISSION_FAULTS[fault]
    path = changed(tmp_path, pattern, replacement)
    out = tmp_path / "out"
    arguments = {
        "check": ["check", path],
        "fly": ["fly", path, "--sim", "--out", out],
        "replay": ["replay", tmp_path, "--mission", path, "--out", out],
    }[command]
    lines = refused.lines(*arguments)
    assert any(words in line for line in lines), lines
    assert all(str(path) in line for line in lines)
    assert not out.exists()


def test_faults_of_a_file_have_a_line_each(tmp_path, refused):
    path = tmp_path / "field.toml"
    path.write_text(RUNWAY.replace("cell_m = 4.0", "cell_m = 0").replace("[battery]", "[batery]"))
    lines = refused.lines("check", path)
    assert len(lines) == 2
    text = path.read_text().splitlines()
    for line, key in zip(sorted(lines), ("[batery]", "cell_m = 0"), strict=True):
        number = next(n for n, written in enumerate(text, 1) if written.startswith(key))
        assert any(given.startswith(f"uavmap: {path}:{number}: ") for given in lines), line


def test_missing_mission_is_named(tmp_path, refused):
    line = refused("check", tmp_path / "nowhere.toml")
    assert "No such file" in line
    assert "runway" in line
    assert "cannot be read" in refused("check", tmp_path)
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    assert "UTF-8" in refused("check", tmp_path / "binary.toml")


def test_drawing_is_no_mission_and_the_line_names_uavmap_new(tmp_path, refused):
    drawing = tmp_path / "Fläche 1.kml"
    drawing.write_text("<kml/>")
    for command in (["fly", drawing, "--sim"], ["check", drawing]):
        assert f"uavmap new '{drawing}'" in refused(*command)


def test_unknown_strategy_on_the_command_line_is_refused(tmp_path, refused):
    line = refused("fly", "runway", "--sim", "--strategy", "dfs", "--out", tmp_path / "out")
    assert "dfs" in line
    assert "rdfs" in line
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("udpout://0.0.0.0:14550", "listen with udpin"),
        ("14550", "is not a connection URL"),
        ("serial:///dev/no-such-port:57600", "cannot be opened"),
    ],
)
def test_invalid_url_is_refused_with_a_remedy(tmp_path, refused, url, words):
    line = refused("fly", "runway", "--connect", url, "--out", tmp_path / "out")
    assert words in line
    assert url in line
    assert "into" not in line  # no line announces a folder that is removed again
    assert not (tmp_path / "out").exists()


def test_connection_refused_is_named(tmp_path, refused):
    url = f"tcpout://127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    line = refused("fly", "runway", "--connect", url, "--out", tmp_path / "out")
    assert url in line
    assert "cannot be opened" in line


def test_flight_without_a_vehicle_is_refused(tmp_path, refused):
    line = refused("fly", "runway", "--out", tmp_path / "out")
    assert "--connect URL" in line
    assert "--sim" in line


def test_replay_of_missing_or_untagged_photographs_is_refused(tmp_path, capsys, refused):
    images, out = tmp_path / "images", tmp_path / "out"
    replay = ["replay", images, "--mission", "road", "--detector", "paved", "--out", out]
    assert "no such file or folder" in refused(*replay)
    images.mkdir()
    assert "no pictures (*.jpg" in refused(*replay)
    write_photo(images / "a.jpg", gps={})
    assert "a.jpg: no geotag: EXIF GPSLatitude is missing" in refused(*replay)
    (images / "a.jpg").write_bytes(b"not a picture")
    assert "a.jpg: not a readable picture" in refused(*replay)
    noise = np.random.default_rng(1).normal((10, 120, 240), 4.0, (360, 640, 3))
    large = Image.fromarray(np.clip(noise, 0, 255).astype(np.uint8))
    whole = write_photo(images / "a.jpg", image=large).read_bytes()
    (images / "a.jpg").write_bytes(whole[: len(whole) - 200])
    assert "a.jpg: not a readable picture" in refused(*replay)
    assert not (out / JOURNAL).exists()  # after the remedy the same command works
    (images / "a.jpg").write_bytes(whole)
    assert main([str(a) for a in replay]) == 0
    capsys.readouterr()
    assert "holds a mission already" in refused(*replay)
    assert "photographs" in refused("resume", out)


def test_impossible_output_folder_is_refused(tmp_path, refused):
    file = tmp_path / "notes.txt"
    file.write_text("notes")
    assert "is a file" in refused("fly", "runway", "--sim", "--out", file)
    line = refused("fly", "runway", "--sim", "--out", file / "below")
    assert str(file / "below") in line
    assert file.read_text() == "notes"


def test_output_folder_with_a_mission_is_refused(tmp_path, refused):
    out = tmp_path / "out"
    out.mkdir()
    with Journal.create(out / JOURNAL, {"plan": {}}):
        pass
    before = (out / JOURNAL).read_bytes()
    line = refused("fly", "runway", "--sim", "--out", out)
    assert f"uavmap resume {out}" in line
    assert (out / JOURNAL).read_bytes() == before
    assert not (out / TLOG).exists()


def test_resume_without_a_journal_is_refused(tmp_path, refused):
    assert "no journal here" in refused("resume", tmp_path)
    journal = tmp_path / JOURNAL
    with Journal.create(journal, {"plan": {"seed": 1}}):
        pass
    assert "holds no flight plan" in refused("resume", tmp_path)
    data = journal.read_bytes()
    shutil.copy(journal, tmp_path / "kept")
    journal.write_bytes(data[: len(data) // 2])
    assert "damaged in its first line" in refused("resume", tmp_path)
    assert journal.read_bytes() == data[: len(data) // 2]
    journal.write_bytes(b"notes")
    assert "is not a journal of uavmap" in refused("resume", tmp_path)
    assert journal.read_bytes() == b"notes"


@pytest.mark.parametrize(
    "arguments",
    [
        ["fly", "runway", "--sim", "--seed", "-1"],
        ["fly", "runway", "--sim", "--vehicles", "0"],
        ["fly", "runway", "--sim", "--speedup", "nan"],
        ["fly", "runway", "--sim", "--speedup", "-1"],
        ["fly", "runway", "--sim", "--connect", "udp:127.0.0.1:14550"],
        ["sitl", "--port", "70000"],
        ["sitl", "--seed", "-3"],
        ["fly"],
        ["nothing"],
    ],
)
def test_impossible_arguments_exit_with_2(tmp_path, capsys, arguments, monkeypatch):
    monkeypatch.chdir(tmp_path)
    try:
        code = main(arguments)
    except SystemExit as left:
        code = left.code
    assert code == 2
    error = capsys.readouterr().err
    assert "uavmap" in error
    assert "Traceback" not in error
    assert list(tmp_path.iterdir()) == []
