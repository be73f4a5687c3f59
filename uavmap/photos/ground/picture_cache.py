"""Pictures that were decoded lately, for as long as they have room."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Pixels = NDArray[np.uint8]


@dataclass(slots=True)
class Recent:
    """Pictures by number, at most so many bytes of them; the ones asked for last stay.

    For any thread. Two threads that ask for the same picture at once both make it.

    >>> recent, made = Recent(most_bytes=8), []
    >>> def picture():
    ...     made.append(1)
    ...     return np.zeros((2, 2), np.uint8)
    >>> for number in (1, 2, 1, 3, 2, 1):
    ...     _ = recent.get(number, picture)
    >>> len(made)
    5
    """

    most_bytes: int
    _kept: OrderedDict[int, Pixels] = field(default_factory=OrderedDict)
    _bytes: int = 0
    _one_at_a_time: threading.Lock = field(default_factory=threading.Lock)

    def get(self, number: int, make: Callable[[], Pixels | None]) -> Pixels | None:
        """The picture of a number, made if it is not there; None, and asked again, if it cannot."""
        with self._one_at_a_time:
            found = self._kept.get(number)
            if found is not None:
                self._kept.move_to_end(number)
                return found
        made = make()
        if made is not None:
            self._keep(number, made)
        return made

    def forget(self, numbers: Iterable[int]) -> None:
        """Let go of pictures that nobody will ask for again."""
        with self._one_at_a_time:
            for number in numbers:
                gone = self._kept.pop(number, None)
                self._bytes -= 0 if gone is None else gone.nbytes

    def _keep(self, number: int, made: Pixels) -> None:
        with self._one_at_a_time:
            if number not in self._kept:
                self._bytes += made.nbytes
            self._kept[number] = made
            while self._bytes > self.most_bytes:
                _, oldest = self._kept.popitem(last=False)
                self._bytes -= oldest.nbytes
