"""Commands that fly, resume or simulate warn if the strategy runs uncompiled."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from missions.planning.kernels import jit, swath
from missions.planning.sweep import memo
from uavmap.journal import event_log
from uavmap.load.strategy_source import compile_planner
from uavmap.runner import flight
from uavmap.ui.cli import main

TINY = Path(__file__).parents[3] / "data" / "tiny.toml"


@pytest.mark.parametrize(
    ("strategy", "compiled", "told"),
    [("horizon", False, 1), ("horizon", True, 0), ("swath", False, 1), ("rdfs", False, 0)],
)
def test_fly_and_resume_without_numba_warn_once(
    strategy, compiled, told, tmp_path, monkeypatch, capsys
):
    def no_flight(self: flight.Flight) -> dict[str, Any]:
        return {"completed": False}

    monkeypatch.setattr(flight.Flight, "run", no_flight)
    monkeypatch.setattr(jit, "COMPILED", compiled)
    out = str(tmp_path / "out")
    for command in (["fly", str(TINY), "--sim", "--strategy", strategy], ["resume"]):
        place = ["--out", out] if command[0] == "fly" else [out]
        assert main([*command, *place, "--json"]) == 3
        assert capsys.readouterr().err.count("slowly without numba") == told


@pytest.mark.parametrize(
    ("before", "remedy"), [("compiled", "install numba"), ("plain", "remove numba")]
)
@pytest.mark.parametrize(("strategy", "code"), [("swath", 2), ("rdfs", 3)])
def test_resume_refuses_another_planner(
    strategy, code, before, remedy, tmp_path, monkeypatch, capsys
):
    here = {"compiled": "plain", "plain": "compiled"}[before]
    monkeypatch.setattr(flight.Flight, "run", lambda self: {"completed": False})
    monkeypatch.setattr(event_log, "planner", lambda: before)
    monkeypatch.setattr(flight, "planner", lambda: here)
    out = str(tmp_path / "out")
    assert main(["fly", str(TINY), "--sim", "--strategy", strategy, "--out", out, "--json"]) == 3
    assert main(["resume", out, "--json"]) == code
    output = capsys.readouterr().err
    assert (f"the {before} planner, and here it is {here}" in output) == (code == 2)
    assert (remedy in output) == (code == 2)
    assert main(["resume", out, "--from-home", "--json"]) == 3


@pytest.mark.parametrize(("strategies", "told"), [("rdfs,horizon", 1), ("rdfs", 0)])
def test_simulate_without_numba_warns_once(strategies, told, monkeypatch, capsys):
    monkeypatch.setattr(jit, "COMPILED", False)
    command = ["simulate", "--roi", "rectangle:6:1", "--strategy", strategies, "--robots", "2"]
    assert main(command) == 0
    assert capsys.readouterr().err.count("slowly without numba") == told


@pytest.mark.parametrize(
    ("strategy", "kept", "told"),
    [("swath", (), 1), ("survey", (), 1), ("swath", ("swath.improve-1.nbi",), 0), ("rdfs", (), 0)],
)
def test_compilation_of_the_planner_is_announced(strategy, kept, told, tmp_path, monkeypatch):
    for name in kept:
        (tmp_path / name).touch()
    made: list[str] = []
    monkeypatch.setattr(memo, "warm_up", lambda: made.append("plan"))
    planner = SimpleNamespace(stats=SimpleNamespace(cache_path=str(tmp_path)))
    monkeypatch.setattr(swath, "improve", planner)
    lines: list[str] = []
    compile_planner(strategy, lines.append)
    assert len(lines) == told
    assert len(made) == (strategy != "rdfs")


@pytest.mark.skipif(not jit.COMPILED, reason="numba is not installed")
def test_planner_that_is_ready_compiles_nothing_more(tmp_path):
    code = """if True:
        import sys
        from missions.planning.kernels import swath
        from uavmap.ui.cli import main
        from uavmap.load.strategy_source import compile_planner

        def forms():
            kernels = {name: k for name, k in vars(swath).items() if hasattr(k, "signatures")}
            return {name: len(kernel.signatures) for name, kernel in kernels.items()}

        compile_planner("swath", print)
        before = forms()
        assert sum(before.values()) >= 4
        assert main(["fly", *sys.argv[1:]]) == 0
        assert forms() == before
    """
    flight = [str(TINY), "--sim", "--strategy", "swath", "--out", str(tmp_path / "out")]
    done = subprocess.run(
        [sys.executable, "-c", code, *flight],
        cwd=TINY.parents[2],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
