"""Commands that must fail, in process."""

from __future__ import annotations

import pytest

from uavmap.ui.cli import main


class Refusals:
    """Runs commands that must end with code 2, and say why."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys

    def lines(self, *arguments: object) -> list[str]:
        """The lines of ours on standard error; there is nothing on standard output."""
        code = main([str(argument) for argument in arguments])
        streams = self._capsys.readouterr()
        assert code == 2, streams.err
        assert "Traceback" not in streams.err
        assert streams.out == ""
        lines = [line for line in streams.err.splitlines() if line.startswith("uavmap: ")]
        assert lines
        return lines

    def __call__(self, *arguments: object) -> str:
        """The one line."""
        (line,) = self.lines(*arguments)
        return line


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Refusals:
    """Runs a command that must fail; its line."""
    return Refusals(capsys)
