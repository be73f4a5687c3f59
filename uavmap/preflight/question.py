"""A question to whoever sits at the terminal, without holding up the links meanwhile."""

from __future__ import annotations

import asyncio
import contextlib
import sys
import termios
from collections.abc import Callable
from typing import TextIO


class Operator:
    """Who can answer a question: somebody at a terminal, or nobody."""

    def __init__(self, say: Callable[[str], None], stream: TextIO | None = None) -> None:
        self._say = say
        self._stream: TextIO | None = stream or sys.stdin

    @property
    def absent(self) -> bool:
        """Whether nobody will ever answer."""
        return self._stream is None or not self._stream.isatty()

    async def agrees(self, question: str) -> bool:
        """Ask, and wait for a line; whether it is a yes."""
        if self._stream is None:
            return False
        loop, file = asyncio.get_running_loop(), self._stream.fileno()
        readable = asyncio.Event()
        with contextlib.suppress(termios.error):
            termios.tcflush(file, termios.TCIFLUSH)  # what was typed before is no answer
        self._say(question)
        loop.add_reader(file, readable.set)
        try:
            await readable.wait()
            return self._stream.readline().strip().lower() in ("y", "yes")
        except OSError:
            return False
        finally:
            loop.remove_reader(file)
