"""Commands that fly no vehicle work on a computer with Windows."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from tests.e2e import rig
from tests.support.photographs import write_photo

FIELD = """{"type": "Polygon", "coordinates": [[[8.5, 47.3], [8.501, 47.3], [8.501, 47.301],
[8.5, 47.301], [8.5, 47.3]]]}"""


def ran(*words, cwd):
    done = rig.python("-m", "tests.unit.uavmap.ui.cli.without_posix", *map(str, words), cwd=cwd)
    assert done.code == 0, done.err
    return done.out + done.err


@pytest.mark.parametrize("command", ["", "app", "new", "tune", "export"])
def test_help_of_any_command_is_shown(tmp_path, command):
    assert "usage: uavmap" in ran(*command.split(), "--help", cwd=tmp_path)


def test_mission_is_made_and_checked(tmp_path):
    (tmp_path / "field.geojson").write_text(FIELD)
    ran("new", "field.geojson", "--drone", "sim", "--detector", "threshold", cwd=tmp_path)
    assert "no fault" in ran("check", "field.toml", cwd=tmp_path)


def test_strategies_are_compared(tmp_path):
    ran("simulate", "--generate", "eden", "--cells", 20, cwd=tmp_path)


def test_photographs_are_mapped_and_reported(tmp_path):
    (tmp_path / "photos").mkdir()
    noise = np.random.default_rng(1).normal((10, 120, 240), 4.0, (360, 640, 3))
    image = Image.fromarray(noise.clip(0, 255).astype(np.uint8))
    write_photo(tmp_path / "photos" / "a.jpg", image=image)
    ran("replay", "photos", "--detector", "paved", "--out", "out", "--workers", 1, cwd=tmp_path)
    ran("report", "out", "--out", "again.html", cwd=tmp_path)
    assert (tmp_path / "again.html").is_file()
