"""Whoever reads standard output and error may be gone: nothing depends on it."""

from __future__ import annotations

import errno
from pathlib import Path
from typing import Any

import pytest

from missions.events import GivenUp
from missions.flight.setting_of import setting_of
from missions.flight.state import State
from tests.support.said import Gone
from tests.support.small_missions import mission, square
from uavmap.base.terminal import Terminal
from uavmap.runner.operator.progress import ProgressTable
from uavmap.ui.cli import AIRCRAFT_DOWN, INCOMPLETE, complain
from uavmap.ui.cli.common import report

SUMMARY: dict[str, Any] = {"mission": "field", "strategy": "rdfs", "completed": True, "finding": ""}


FAILURES = (BrokenPipeError(), OSError(errno.EIO, "gone"), ValueError("closed file"))


@pytest.mark.parametrize("terminal", [False, True])
@pytest.mark.parametrize("failure", FAILURES, ids=repr)
def test_progress_goes_on_in_silence(failure: Exception, terminal: bool) -> None:
    setting = setting_of(mission(square(-10, 16, 40, 30), square(-60, -60, 160, 160)))
    state, stream = State.initial(setting), Gone(failure, terminal=terminal)
    terminal_ = Terminal(stream)
    progress = ProgressTable(terminal_)
    progress.begin(setting, again=False)
    terminal_.show("vehicle 1: it returns by its autopilot")
    for second in range(3):
        progress.update(GivenUp(1, float(second), "silent"), state, 0)
    progress.end()
    assert stream.tried == 1


@pytest.mark.parametrize("as_json", [False, True])
@pytest.mark.parametrize("failure", FAILURES[:2], ids=repr)
def test_the_exit_code_is_that_of_the_flight(
    failure: Exception, as_json: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdout", Gone(failure))
    monkeypatch.setattr("sys.stderr", Gone(failure))
    folder = Path("results/field-1")
    assert report(SUMMARY, folder, as_json=as_json) == 0
    assert report({**SUMMARY, "completed": False}, folder, as_json=as_json) == INCOMPLETE
    down = {**SUMMARY, "completed": False, "aircraft_down": ["vehicle 1 near 1, 2: down"]}
    assert report(down, folder, as_json=as_json) == AIRCRAFT_DOWN
    complain("interrupted")
