"""Whoever looks on while a mission is flown, and may pass the operator's orders on."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from missions.events import Event
from missions.state import Setting, State
from missions.step import step
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

    def look_back(self, setting: Setting, event: Event, state: State) -> None:
        """What a flight that is gone on with has brought before; `state` is that after `event`."""
        ...

    def hand(self, service: Steered, say: Callable[[str], None]) -> AbstractContextManager[None]:
        """Pass orders on to the service for as long as the context lasts."""
        ...


def folded(setting: Setting, events: Iterable[Event], onlooker: Onlooker | None) -> State:
    """The state after a journal; who looks on is told how it came to be."""
    state = State.initial(setting)
    for event in events:
        state, _ = step(setting, state, event)
        if onlooker is not None:
            onlooker.look_back(setting, event, state)
    return state


class Both:
    """A keeper of pictures, and somebody who looks on."""

    def __init__(self, keeper: FrameKeeper, onlooker: Onlooker) -> None:
        self._keepers: tuple[Keeper, ...] = (keeper, onlooker)

    def keep(self, frame: KeptFrame, picture: bytes | NDArray[np.uint8]) -> None:
        """Give it to both."""
        for keeper in self._keepers:
            keeper.keep(frame, picture)
