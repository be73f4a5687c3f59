"""The terminal while a mission is flown: keys are heard as they are pressed, and not shown.

Enter goes to the crew (`uavmap.runner.operator.ground_crew`), every other key to
`uavmap.runner.operator.flight_keys`; Ctrl-C stays a signal. The terminal's settings are restored
however the flight ends. It is touched only while the program is in its foreground: a background
program is stopped for that, with aircraft in the air.
"""

from __future__ import annotations

import asyncio
import atexit
import contextlib
import logging
import os
import re
import signal
import sys
import termios
from collections.abc import Iterator
from typing import Any, Final, TextIO

from uavmap.runner.operator.flight_keys import HELP, Keys
from uavmap.runner.operator.ground_crew import EnterKey

_LOG: Final = logging.getLogger("uavmap.flight")
LOOK_S: Final = 1.0
"""A program in the background looks so often, in seconds of the loop, whether it is back."""
_ENTER: Final = ("\r", "\n")
_SEQUENCE: Final = re.compile(rb"\x1b(?:\[[0-?]*[ -/]*[@-~]?|O.|.)?", re.DOTALL)
"""What an arrow or a function key sends: several characters that are no keys."""
_LOCAL, _CONTROL = 3, 6


@contextlib.contextmanager
def keyboard(keys: Keys, enter: EnterKey, stream: TextIO | None = None) -> Iterator[None]:
    """Hear the operator's keys in the context, if there is a terminal; names the keys first."""
    source = stream or sys.stdin
    if source is None or source.closed or not source.isatty():
        yield
        return
    terminal = _Terminal(source.fileno(), keys, enter)
    _LOG.info(HELP)
    try:
        terminal.open()
        yield
    finally:
        terminal.close()


class _Terminal:
    """One terminal, in the foreground or not."""

    def __init__(self, file: int, keys: Keys, enter: EnterKey) -> None:
        self._file = file
        self._keys = keys
        self._enter = enter
        self._loop = asyncio.get_running_loop()
        self._saved: list[Any] | None = None
        self._reading = False
        self._gone = False
        self._looking: asyncio.TimerHandle | None = None

    def open(self) -> None:
        """Begin to read; after a stop (Ctrl-Z) and `fg` again."""
        self._loop.add_signal_handler(signal.SIGCONT, self._listen)
        atexit.register(self._restore)
        self._listen()

    def close(self) -> None:
        """Put everything back."""
        self._loop.remove_signal_handler(signal.SIGCONT)
        if self._looking is not None:
            self._looking.cancel()
        self._deaf()
        self._restore()
        atexit.unregister(self._restore)

    # --- the terminal's settings -----------------------------------------------------------------
    def _in_front(self) -> bool:
        """Whether the terminal is ours to read: no other program is in its foreground."""
        try:
            return os.tcgetpgrp(self._file) == os.getpgrp()
        except OSError:  # not the terminal that this program was started from, or gone
            return not self._gone

    def _listen(self) -> None:
        """Hear every key from now on, as soon as the terminal is ours."""
        if self._gone:
            return
        if not self._in_front():
            self._wait()
            return
        try:
            settings = termios.tcgetattr(self._file)
            self._saved = self._saved or termios.tcgetattr(self._file)
            settings[_LOCAL] &= ~(termios.ICANON | termios.ECHO)
            settings[_CONTROL][termios.VMIN], settings[_CONTROL][termios.VTIME] = 1, 0
            _set(self._file, settings)
            termios.tcflush(self._file, termios.TCIFLUSH)  # what was typed before is no answer
        except termios.error:
            self._lost()
            return
        if not self._reading:
            self._reading = True
            self._loop.add_reader(self._file, self._read)

    def _wait(self) -> None:
        self._deaf()
        self._looking = self._loop.call_later(LOOK_S, self._listen)

    def _deaf(self) -> None:
        if self._reading:
            self._reading = False
            self._loop.remove_reader(self._file)

    def _restore(self) -> None:
        if self._saved is not None and self._in_front():
            with contextlib.suppress(termios.error):
                _set(self._file, self._saved)

    def _lost(self) -> None:
        """The terminal is gone, which is no consent."""
        self._gone = True
        self._deaf()
        self._enter.lose()

    # --- keys ------------------------------------------------------------------------------------
    def _read(self) -> None:
        if not self._in_front():
            self._wait()
            return
        try:
            data = os.read(self._file, 64)
        except OSError:
            data = b""
        if not data:
            self._lost()
            return
        for key in _SEQUENCE.sub(b"", data).decode("ascii", "ignore"):
            self._pressed(key)

    def _pressed(self, key: str) -> None:
        if not self._keys.press(key) and key in _ENTER:
            self._enter.press()


def _set(file: int, settings: list[Any]) -> None:
    """Change a terminal's settings, also if it has just been taken from us: no signal stops us."""
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTTOU})
    try:
        termios.tcsetattr(file, termios.TCSANOW, settings)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
