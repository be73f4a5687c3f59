"""Whoever looks on while a mission is flown, and may pass the operator's orders on."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from uavmap.fly.interrupts import Recallable
from uavmap.fly.keys import Hand
from uavmap.record.frames import FrameKeeper, Keeper, KeptFrame


class Steered(Hand, Recallable, Protocol):
    """What is needed of a service."""


class Onlooker(Protocol):
    """Looks on. Nothing of it may raise, or take long: it is called while aircraft are steered."""

    def keep(self, frame: KeptFrame, picture: bytes | NDArray[np.uint8]) -> None:
        """A picture is about to be judged."""
        ...

    def hand(self, service: Steered, say: Callable[[str], None]) -> AbstractContextManager[None]:
        """Pass orders on to the service for as long as the context lasts."""
        ...


class Both:
    """A keeper of pictures, and somebody who looks on."""

    def __init__(self, keeper: FrameKeeper, onlooker: Onlooker) -> None:
        self._keepers: tuple[Keeper, ...] = (keeper, onlooker)

    def keep(self, frame: KeptFrame, picture: bytes | NDArray[np.uint8]) -> None:
        """Give it to both."""
        for keeper in self._keepers:
            keeper.keep(frame, picture)
