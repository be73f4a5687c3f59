"""Runs of a simulation as they are done."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from uavmap.lab.commands import runs
from uavmap.lab.commands.runs import run_all
from uavmap.ui.cli.endings import INTERRUPTED


def test_ctrl_c_leaves_the_runs_that_are_done(capsys: pytest.CaptureFixture[str]) -> None:
    def trials() -> Iterator[int]:
        yield from (1, 2)
        raise KeyboardInterrupt

    assert run_all(trials(), 5) == ([1, 2], INTERRUPTED)
    assert capsys.readouterr().err == "uavmap: interrupted after 2 of 5 runs\n"


def test_how_far_they_are_is_told_where_they_take_long(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(runs, "_REPORT_S", -1.0)
    assert run_all(iter("ab"), 2) == (["a", "b"], 0)
    assert capsys.readouterr().err == "1 of 2 runs\n2 of 2 runs\n"
