"""The door of the command."""

from __future__ import annotations

import pytest

from uavmap import __main__ as door
from uavmap import cli


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
