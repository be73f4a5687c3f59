"""The quick commands of the tutorials, run as they stand there."""

from __future__ import annotations

import shlex
import shutil

from tests.unit.test_pages import ROOT, command_lines
from uavmap.ui.cli import main

AREA = ROOT / "tests" / "data" / "areas" / "google_earth_web.kml"


def test_your_area_commands_make_and_check_missions(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(AREA, "field.kml")
    ran = []
    for line in command_lines(ROOT / "docs" / "tutorials" / "your-area.md"):
        words = shlex.split(line)[1:]
        if words[0] in ("new", "check") and "--like" not in words:
            assert main(words) == 0, line
            ran.append(words[0])
    assert ran == ["new", "new", "check"]
    made = {path.name for path in tmp_path.iterdir()}
    assert {"bay-1.toml", "field.toml", "field.png", "field.html"} <= made
