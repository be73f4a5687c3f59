"""The operator's keys in flight, read from the terminal as they are pressed, and not shown.

The number of a vehicle follows its key: `r2`, or `r`, then `2`. Enter goes to the crew; Ctrl-C
stays a signal. The terminal's settings are restored however the flight ends. The terminal is used
only in the foreground: a background program would be stopped, with aircraft in the air.
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
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final, TextIO

from uavmap.runner.operator.ground_crew import EnterKey
from uavmap.runner.service import Service

KEY_TIMEOUT_S: Final = 10.0
"""Time after which a key that waits for a number, or for a second press, is dropped, real
seconds."""
HELP: Final = """\
keys: p pause, all hold          c continue        r home: ra all, r2 vehicle 2
      k skip the cell that a vehicle observes (k2)     q land where it is (q2; asked twice)
      ? this help                Ctrl-C all home, twice: by their autopilots"""
_ENTER: Final = ("\r", "\n")
_ALL: Final = "a"
_LOG: Final = logging.getLogger("uavmap.flight")


class Keys:
    """Turns keys into requests to the service, each answered by a line; `now_s` is real time, s."""

    def __init__(self, service: Service, now_s: Callable[[], float] = time.monotonic) -> None:
        self._service = service
        self._now_s = now_s
        self._key = ""
        """Key that waits for a number."""
        self._digits = ""
        self._sure: tuple[int, ...] = ()
        """Vehicles that land if `q` is pressed again."""
        self._pressed_s = float("-inf")

    def press(self, key: str) -> bool:
        """Handle a key; return False for one without a meaning here, as Enter without a
        question."""
        now_s = self._now_s()
        if now_s - self._pressed_s > KEY_TIMEOUT_S:
            self._forget()
        self._pressed_s = now_s
        sure, self._sure = self._sure, ()
        if sure:
            self._land(sure) if key == "q" else _LOG.info("no vehicle is commanded to land")
            return True
        if self._key and self._number(key):
            return True
        self._forget()
        return self._single(key)

    def _single(self, key: str) -> bool:
        service = self._service
        if key == "p":
            held = service.pause()
            _LOG.info("paused: all vehicles hold; c continues" if held else "it is paused already")
        elif key == "c":
            _LOG.info("the mission continues" if service.go_on() else "it is not paused")
        elif key == "?":
            _LOG.info(HELP)
        elif key in _QUESTIONS:
            self._ask(key)
        else:
            return False
        return True

    @property
    def _numbers(self) -> list[int]:
        vehicles: Mapping[int, object] = self._service.state.vehicles
        return sorted(vehicles)

    def _ask(self, key: str) -> None:
        if len(self._numbers) == 1:
            self._act(key, tuple(self._numbers))
            return
        self._key = key
        all_of_them = "" if key == "k" else ", or a for all"
        _LOG.info(f"{_QUESTIONS[key]}: which vehicle? its number{all_of_them}")

    def _number(self, key: str) -> bool:
        """Handle a key after one that waits for a number; return False if it is neither digit nor
        Enter."""
        if key.isascii() and key.isdigit():
            self._digits += key
            number = int(self._digits)
            if 10 * number <= max(self._numbers):  # 1 of 12 vehicles: Enter, or a second digit
                return True
            self._order_for((number,))
        elif key in _ENTER and self._digits:
            self._order_for((int(self._digits),))
        elif self._key != "k" and not self._digits and (key == _ALL or key == self._key == "r"):
            self._order_for(tuple(self._numbers))
        else:  # Enter before a number is no answer of the crew either: that was not the question
            return key in _ENTER
        return True

    def _order_for(self, numbers: tuple[int, ...]) -> None:
        key = self._key
        self._forget()
        if not set(numbers) <= set(self._numbers):
            _LOG.info(f"there is no vehicle {numbers[0]}")
            return
        self._act(key, numbers)

    def _forget(self) -> None:
        self._key = self._digits = ""
        self._sure = ()

    def _act(self, key: str, numbers: tuple[int, ...]) -> None:
        named = _numbers_text(numbers)
        if key == "r":
            self._home(numbers)
        elif key == "k":
            skipped = self._service.skip_cell(numbers[0])
            _LOG.info(f"{named} skips its cell" if skipped else f"{named} is at no cell to skip")
        else:
            self._sure = numbers
            _LOG.info(f"press q again to land {named} where it is; any other key: no vehicle lands")

    def _home(self, numbers: tuple[int, ...]) -> None:
        if numbers == tuple(self._numbers):
            _LOG.info("all vehicles return; the mission can be resumed")
            self._service.recall()
        elif self._service.recall_vehicle(numbers[0]):
            _LOG.info(f"{_numbers_text(numbers)} returns and stays there; the others continue")
        else:
            _LOG.info(f"{_numbers_text(numbers)} is recalled already")

    def _land(self, numbers: tuple[int, ...]) -> None:
        for number in numbers:
            if not self._service.land_here(number):
                _LOG.info(f"vehicle {number} is not in the air, or not under our control")


_QUESTIONS: Final = {"r": "home", "k": "skip a cell", "q": "land where it is"}


def _numbers_text(numbers: tuple[int, ...]) -> str:
    plural = "s" if len(numbers) > 1 else ""
    return f"vehicle{plural} {', '.join(map(str, numbers))}"


CHECK_INTERVAL_S: Final = 1.0
"""Time between two checks whether a program in the background is back, s of the loop."""
_SEQUENCE: Final = re.compile(rb"\x1b(?:\[[0-?]*[ -/]*[@-~]?|O.|.)?", re.DOTALL)
"""Codes of an arrow or a function key: several characters that are no keys."""
_LOCAL, _CONTROL = 3, 6


@contextlib.contextmanager
def keyboard(keys: Keys, enter: EnterKey, stream: TextIO | None = None) -> Iterator[None]:
    """Read the operator's keys in the context, if there is a terminal; show the keys first."""
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
        """Begin to read; also after a stop (Ctrl-Z) and `fg`."""
        self._loop.add_signal_handler(signal.SIGCONT, self._listen)
        atexit.register(self._restore)
        self._listen()

    def close(self) -> None:
        """Restore everything."""
        self._loop.remove_signal_handler(signal.SIGCONT)
        if self._looking is not None:
            self._looking.cancel()
        self._deaf()
        self._restore()
        atexit.unregister(self._restore)

    # --- the terminal's settings -----------------------------------------------------------------
    def _in_front(self) -> bool:
        try:
            return os.tcgetpgrp(self._file) == os.getpgrp()
        except OSError:  # not the terminal that started this program, or gone
            return not self._gone

    def _listen(self) -> None:
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
            termios.tcflush(self._file, termios.TCIFLUSH)  # text from before is no answer
        except termios.error:
            self._note_loss()
            return
        if not self._reading:
            self._reading = True
            self._loop.add_reader(self._file, self._read)

    def _wait(self) -> None:
        self._deaf()
        self._looking = self._loop.call_later(CHECK_INTERVAL_S, self._listen)

    def _deaf(self) -> None:
        if self._reading:
            self._reading = False
            self._loop.remove_reader(self._file)

    def _restore(self) -> None:
        if self._saved is not None and self._in_front():
            with contextlib.suppress(termios.error):
                _set(self._file, self._saved)

    def _note_loss(self) -> None:
        """Handle the end of the terminal, which is no consent."""
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
            self._note_loss()
            return
        for key in _SEQUENCE.sub(b"", data).decode("ascii", "ignore"):
            if not self._keys.press(key) and key in _ENTER:
                self._enter.press()


def _set(file: int, settings: list[Any]) -> None:
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTTOU})
    try:
        termios.tcsetattr(file, termios.TCSANOW, settings)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
