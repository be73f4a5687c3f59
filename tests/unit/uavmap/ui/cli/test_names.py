"""Names of missions and of files: none leads out of the results, none ends in a traceback."""

import os
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from missions.mission.schema import parse_fields
from tests.support.plans import named_text
from uavmap.journal.results_folder import RESULTS, folder_name, results_folder
from uavmap.ui.cli.common import report

RUNWAY = named_text("runway").text
BAD = {
    "/x": "leave out /",
    "../../../up": "leave out /",
    "[/x]": "leave out /",
    "a\\\\b": r"leave out \\",
    "con:": "leave out :",
    "what?": "leave out ?",
    r"\u0000": "control characters",
    r"a\u001b[31mb": "control characters",
    r"a\nb": "control characters",
    r"a\u202eb": "control characters",
    "": "empty",
    ".": "only dots",
    "..": "only dots",
    " a": "begin or end with a space",
    "a.": "end with a dot",
    "x" * 5000: "at most 100 letters; this has 5,000",
}


def named(name):
    return re.sub(r"(?m)^name = .*$", lambda _: f'name = "{name}"', RUNWAY, count=1)


@pytest.mark.parametrize("name", BAD, ids=lambda name: repr(name)[:20])
def test_name_that_is_no_file_name_is_refused(tmp_path, name, refused, monkeypatch):
    below = tmp_path / "a" / "b" / "c"
    below.mkdir(parents=True)
    monkeypatch.chdir(below)
    (below / "field.toml").write_text(named(name))
    line = refused("fly", "field.toml", "--sim")
    assert re.search(BAD[name], line)
    assert line.startswith("uavmap: field.toml:13: name = ")
    assert len(line) < 250
    assert line.isprintable()
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["a", "b", "c", "field.toml"]


@pytest.mark.parametrize("name", ["runway", "field 7", "Übung-2", "[x]", "a.b", "x" * 100])
def test_name_that_is_a_file_name_is_kept(name):
    assert parse_fields(named(name), "field.toml").name == name


@given(st.text(max_size=300))
def test_folder_of_any_name_is_below_results(name):
    made = folder_name(name)
    assert made not in ("", ".", "..")
    assert not set(made) & set('/\\\0:*?"<>|.')
    assert len(f"{made}-9999".encode()) < 255
    assert results_folder(None, name).parent == Path(RESULTS)


def test_markup_in_a_name_is_shown_as_it_is(tmp_path, capsys):
    summary = {"mission": "[/x][red]", "strategy": "rdfs", "completed": True}
    assert report(summary, tmp_path, as_json=False) == 0
    assert "[/x][red] (rdfs)" in capsys.readouterr().out


LONG = "x" * 5000


@pytest.mark.parametrize(
    "arguments",
    [
        ["check", LONG],
        ["check", f"{LONG}.toml"],
        ["fly", LONG, "--sim"],
        ["fly", "runway", "--sim", "--out", LONG],
        ["resume", LONG],
        ["resume", LONG, "--recover"],
        ["animate", LONG],
        ["replay", LONG, "--mission", "road"],
        ["simulate", "--roi", LONG],
        ["simulate", "--generate", "eden", "--cells", "9", "--json", "--animate", f"{LONG}.gif"],
        ["study", "lrv-figure-3", "--quick", "--out", LONG],
        ["sitl", "--mission", LONG],
    ],
    ids=lambda arguments: " ".join(arguments)[:30],
)
def test_argument_of_5000_letters_is_refused(tmp_path, arguments, refused, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert "too long" in refused(*arguments)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("device", ["/dev/zero", "/dev/urandom", "/dev/null"])
@pytest.mark.parametrize(
    "command", [["check"], ["fly", "--sim"], ["simulate", "--roi"], ["replay", "--mission"]]
)
def test_device_without_an_end_is_not_read(refused, device, command):
    line = refused(*command, device, *(["."] if command[0] == "replay" else []))
    assert f"{device}: cannot be read (not an ordinary file)" in line


def test_pipe_is_not_waited_for(tmp_path, refused):
    os.mkfifo(tmp_path / "pipe.toml")
    assert "not an ordinary file" in refused("check", tmp_path / "pipe.toml")


def test_file_that_is_too_large_is_refused(tmp_path, refused):
    path = tmp_path / "large.toml"
    path.write_text(RUNWAY + "#" * 4_000_000)
    assert "larger than 4 MB" in refused("check", path)
