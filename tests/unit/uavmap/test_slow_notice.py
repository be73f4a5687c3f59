"""Whoever flies, resumes or simulates is told where the strategy runs uncompiled."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from missions.kernels import jit
from uavmap.cli import main
from uavmap.fly import flight

TINY = Path(__file__).parents[2] / "data" / "tiny.toml"


@pytest.mark.parametrize(
    ("strategy", "compiled", "told"),
    [("horizon", False, 1), ("horizon", True, 0), ("rdfs", False, 0)],
)
def test_fly_and_resume_tell_it_once(
    strategy: str,
    compiled: bool,
    told: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def flown(self: flight._Flight) -> dict[str, Any]:
        return {"completed": False}

    monkeypatch.setattr(flight._Flight, "run", flown)
    monkeypatch.setattr(jit, "COMPILED", compiled)
    out = str(tmp_path / "out")
    for command in (["fly", str(TINY), "--sim", "--strategy", strategy], ["resume"]):
        place = ["--out", out] if command[0] == "fly" else [out]
        assert main([*command, *place, "--json"]) == 3
        assert capsys.readouterr().err.count("slowly without numba") == told


@pytest.mark.parametrize(("strategies", "told"), [("rdfs,horizon", 1), ("rdfs", 0)])
def test_simulate_tells_it(
    strategies: str,
    told: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(jit, "COMPILED", False)
    command = ["simulate", "--roi", "rectangle:6:1", "--strategy", strategies, "--robots", "2"]
    assert main(command) == 0
    assert capsys.readouterr().err.count("slowly without numba") == told
