"""A strategy in a file of its own, found by an entry point, flies a simulated mission."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from missions.errors import StrategyError
from missions.flight.setting_of import setting_of
from missions.flight.strategies import CHOICES, register
from missions.flight.strategy.every_patch import Survey
from missions.planning.sweep.strategies import ON_PATHS, SURVEY, StrategyInfo
from tests.e2e.rig import MISSIONS, ROOT, command, environment
from tests.support.small_missions import mission, square

SPIRAL = '''
"""Search a box along a spiral: the outermost lanes first, by turns from both sides."""

from missions.flight.strategy.work import Lanes
from missions.flight.strategy.sweep import Sweep
from missions.planning.sweep.strategies import StrategyInfo


class Spiral(Sweep):
    about = StrategyInfo(
        "spiral",
        "as swath",
        "a test",
        "the region is expected at the rim of the box",
    )

    def lay(self, area):
        laid = super().lay(area)
        inwards = list(laid.lanes)
        spiral = []
        while inwards:
            start, end = inwards.pop(0)
            spiral.append((start, end))
            inwards = [(b, a) for a, b in reversed(inwards)]
        return Lanes(tuple(spiral), laid.east_ahead, laid.rows)


SPIRAL = Spiral()
'''


def with_path(folder: Path) -> dict[str, str]:
    """Return the environment of a process that also finds packages in a folder."""
    return environment() | {"PYTHONPATH": f"{ROOT}{os.pathsep}{folder}"}


def test_an_entry_point_is_all_that_a_strategy_needs(tmp_path: Path) -> None:
    (tmp_path / "spiral.py").write_text(SPIRAL, "utf-8")
    assert len(SPIRAL.strip().splitlines()) <= 30
    info = tmp_path / "spiral-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: spiral\nVersion: 1.0\n", "utf-8")
    (info / "entry_points.txt").write_text("[uavmap.strategies]\nspiral = spiral:SPIRAL\n", "utf-8")
    out, beside = tmp_path / "out", with_path(tmp_path)

    def run(*words: object) -> str:
        done = subprocess.run(
            command(*words), cwd=tmp_path, env=beside, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert "spiral" in [one["name"] for one in json.loads(run("strategies", "--json"))]
    run(
        "fly",
        MISSIONS / "speck.toml",
        "--sim",
        "--strategy",
        "spiral",
        "--all-strategies",
        "--out",
        out,
    )
    summary = json.loads((out / "summary.json").read_text("utf-8"))
    assert summary["completed"]
    assert summary["strategy"] == "spiral"
    assert summary["cells_missed"] == summary["false_positives"] == 0


def test_plug_in_that_cannot_be_loaded_is_reported(tmp_path: Path) -> None:
    info = tmp_path / "broken-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 1.0\n", "utf-8")
    (info / "entry_points.txt").write_text("[uavmap.strategies]\nbroken = nothere:X\n", "utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "uavmap", "strategies", "--json"],
        env=with_path(tmp_path),
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0
    assert "strategy broken: the plug-in nothere:X: it cannot be loaded" in done.stderr
    json.loads(done.stdout)


def test_a_registered_strategy_flies_by_its_name_and_may_be_taken_out_again() -> None:
    box, fence = square(0.0, 0.0, 40.0, 40.0), square(-20.0, -20.0, 90.0, 90.0)

    class Mine(Survey):
        about = StrategyInfo("mine", "none", "a test", "never")

    mine = Mine()
    register(mine)
    try:
        assert setting_of(mission(box, fence, strategy="mine")).strategy is mine
    finally:
        del CHOICES["mine"], ON_PATHS["mine"]

    class Other(Survey):
        about = StrategyInfo(SURVEY.name, "none", "a test", "never")

    with pytest.raises(StrategyError, match="survey: another strategy has this name"):
        register(Other())
