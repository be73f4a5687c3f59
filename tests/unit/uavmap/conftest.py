"""Commands that must fail, in process."""

from __future__ import annotations

import pytest

from uavmap.ui.cli import main


class Refusals:
    """Run commands that must end with code 2 and a reason."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys

    def lines(self, *arguments: object) -> list[str]:
        """Return the lines of uavmap on standard error; standard output is empty."""
        code = main([str(argument) for argument in arguments])
        streams = self._capsys.readouterr()
        assert code == 2, streams.err
        assert "Traceback" not in streams.err
        assert streams.out == ""
        lines = [line for line in streams.err.splitlines() if line.startswith("uavmap: ")]
        assert lines
        return lines

    def __call__(self, *arguments: object) -> str:
        """Return the only line."""
        (line,) = self.lines(*arguments)
        return line


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Refusals:
    """Run a command that must fail; return its line."""
    return Refusals(capsys)
