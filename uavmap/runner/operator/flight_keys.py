"""The operator's keys in flight: pause, go on, home, skip, land.

A key for one vehicle is followed by its number: `r2`, or `r`, then `2`.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from typing import Final

from uavmap.runner.operator.caller import Steered

FORGOTTEN_S: Final = 10.0
"""Real seconds after which a key that waits for a number, or for a second press, is forgotten."""
HELP: Final = """\
keys: p pause, everybody holds   c continue        r home: ra all, r2 vehicle 2
      k skip the cell that a vehicle looks from (k2)   q land where it is (q2; asked twice)
      ? this help                Ctrl-C everybody home, twice: by their autopilots"""
_ENTER: Final = ("\r", "\n")
_ALL: Final = "a"
_LOG: Final = logging.getLogger("uavmap.flight")


class Keys:
    """Turns keys into requests to the service, each answered by a line; `now_s` is real time, s."""

    def __init__(self, service: Steered, now_s: Callable[[], float] = time.monotonic) -> None:
        self._service = service
        self._now_s = now_s
        self._key = ""
        """The key that waits for a number."""
        self._digits = ""
        self._sure: tuple[int, ...] = ()
        """Who will land if `q` is pressed again."""
        self._pressed_s = float("-inf")

    def press(self, key: str) -> bool:
        """Take a key; False for one that means nothing here, as Enter without a question."""
        now_s = self._now_s()
        if now_s - self._pressed_s > FORGOTTEN_S:
            self._forget()
        self._pressed_s = now_s
        sure, self._sure = self._sure, ()
        if sure:
            self._land(sure) if key == "q" else _LOG.info("nobody lands")
            return True
        if self._key and self._number(key):
            return True
        self._forget()
        return self._single(key)

    def _single(self, key: str) -> bool:
        service = self._service
        if key == "p":
            held = service.pause()
            _LOG.info("paused: everybody holds; c goes on" if held else "it is paused already")
        elif key == "c":
            _LOG.info("the mission goes on" if service.go_on() else "it is not paused")
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
        everybody = "" if key == "k" else ", or a for all"
        _LOG.info(f"{_QUESTIONS[key]}: which vehicle? its number{everybody}")

    def _number(self, key: str) -> bool:
        """Take a key after one that waits for a number; False if it is none of that."""
        if key.isascii() and key.isdigit():
            self._digits += key
            number = int(self._digits)
            if 10 * number <= max(self._numbers):  # 1 of 12 vehicles: Enter, or a second digit
                return True
            self._chosen((number,))
        elif key in _ENTER and self._digits:
            self._chosen((int(self._digits),))
        elif self._key != "k" and not self._digits and (key == _ALL or key == self._key == "r"):
            self._chosen(tuple(self._numbers))
        else:  # Enter before a number is no crew's word either: that was not the question
            return key in _ENTER
        return True

    def _chosen(self, numbers: tuple[int, ...]) -> None:
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
        who = _named(numbers)
        if key == "r":
            self._home(numbers)
        elif key == "k":
            skipped = self._service.skip_cell(numbers[0])
            _LOG.info(f"{who} skips its cell" if skipped else f"{who} is at no cell to skip")
        else:
            self._sure = numbers
            _LOG.info(f"press q again to land {who} where it is; any other key: nobody lands")

    def _home(self, numbers: tuple[int, ...]) -> None:
        if numbers == tuple(self._numbers):
            _LOG.info("everybody comes home; the mission can be resumed")
            self._service.recall()
        elif self._service.recall_vehicle(numbers[0]):
            _LOG.info(f"{_named(numbers)} comes home and stays there; the others go on")
        else:
            _LOG.info(f"{_named(numbers)} is called home already")

    def _land(self, numbers: tuple[int, ...]) -> None:
        for number in numbers:
            if not self._service.land_here(number):
                _LOG.info(f"vehicle {number} is not in the air, or not ours to land")


_QUESTIONS: Final = {"r": "home", "k": "skip a cell", "q": "land where it is"}


def _named(numbers: tuple[int, ...]) -> str:
    plural = "s" if len(numbers) > 1 else ""
    return f"vehicle{plural} {', '.join(map(str, numbers))}"
