"""The operator's terminal: lines go to standard error, answers come from standard input."""

from __future__ import annotations

import asyncio
import contextlib
import sys
from collections.abc import Callable
from typing import Final, TextIO

from rich.console import Console

from uavmap.base.printable import printable

LINE_LIMIT: Final = 4000
"""Maximum length of a line, characters."""


class PipeConsole(Console):
    """A console whose reader may disappear: it raises `BrokenPipeError` instead of an exit."""

    def on_broken_pipe(self) -> None:
        """Raise `BrokenPipeError`."""
        raise BrokenPipeError


class Terminal:
    """Standard error, or another stream, as a `Display`.

    It stops writing once its terminal has disappeared: no flight depends on a reader.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        file = stream or sys.stderr
        # by the stream alone: a notebook, and FORCE_COLOR, make no terminal that can redraw a table
        self.console = PipeConsole(
            file=file, highlight=False, force_jupyter=False, force_terminal=_is_terminal(file)
        )
        self._gone = False

    def show(self, text: str) -> None:
        """Print a line, or several, made safe for a terminal."""
        lines = "\n".join(printable(line, LINE_LIMIT) for line in text.split("\n"))
        self.write(lambda: self.console.print(lines, soft_wrap=True, markup=False))

    def write(self, act: Callable[[], None]) -> None:
        """Call a function that writes to the console; without a terminal, do nothing."""
        if self._gone:
            return
        try:
            act()
        except (OSError, ValueError):  # a stream that we have closed is a ValueError
            self._gone = True


def _is_terminal(stream: TextIO) -> bool:
    try:
        return stream.isatty()
    except ValueError:  # we have closed it
        return False


def forget_typed(stream: TextIO | None) -> None:
    """Drop text that was typed before a question: it is no answer."""
    if stream is not None:
        import termios  # noqa: PLC0415 - questions are asked before flights, which need POSIX

        with contextlib.suppress(termios.error):
            termios.tcflush(stream.fileno(), termios.TCIFLUSH)


async def read_line(stream: TextIO | None) -> str:
    """Wait for a line; empty if the terminal has disappeared."""
    if stream is None:
        return ""
    loop, file = asyncio.get_running_loop(), stream.fileno()
    readable = asyncio.Event()
    loop.add_reader(file, readable.set)
    try:
        await readable.wait()
        return stream.readline()
    except OSError:
        return ""
    finally:
        loop.remove_reader(file)
