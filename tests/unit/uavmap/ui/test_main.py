"""The door of the command."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest

from missions.planning.stepwise import EXPLORERS
from tests.e2e.rig import command, environment
from uavmap import __main__ as door
from uavmap.ui import cli
from uavmap.ui.cli.commands import strategies


def test_the_exit_code_is_that_of_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cli, "main", lambda: 3)
    assert door.main() == 3


def test_ctrl_c_while_it_loads_is_a_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted() -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(cli, "main", interrupted)
    assert door.main() == 130
    assert capsys.readouterr().err == "uavmap: interrupted\n"


@pytest.mark.parametrize(("fates", "code"), [([], 2), (["vehicle 1: left to its autopilot"], 4)])
def test_a_computer_without_memory_is_a_line(
    fates: list[str],
    code: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def too_much(options: object) -> int:
        try:
            return len(np.zeros(1 << 58))
        except MemoryError as error:
            failed = ExceptionGroup("tasks", [error])
            for fate in fates:  # as of a flight that has failed
                failed.add_note(fate)
            raise failed from None

    monkeypatch.setattr(strategies, "run", too_much)
    assert cli.main(["strategies"]) == code
    first, *rest = capsys.readouterr().err.splitlines()
    assert first.startswith("uavmap: the memory of this computer does not suffice")
    assert rest == [f"uavmap: {fate}" for fate in fates]


@pytest.mark.parametrize("columns", [30, 40, 60, 75, 80, 120])
def test_strategies_are_told_in_whole_words(
    columns: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    assert cli.main(["strategies"]) == 0
    told = capsys.readouterr().out
    assert max(map(len, told.splitlines())) <= columns
    words = {word for line in told.splitlines() for word in line.replace("│", " ").split()}
    for name, explorer in EXPLORERS.items():
        assert name in words
        assert set(explorer.when.split()) <= words


def test_a_module_of_that_name_where_somebody_works_is_not_ours(tmp_path: Path) -> None:
    (tmp_path / "vision.py").write_text("raise SystemExit('this is not ours')")
    (tmp_path / "missions").mkdir()
    done = subprocess.run(
        command("check", "runway"), cwd=tmp_path, env=environment(), capture_output=True,
        text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
