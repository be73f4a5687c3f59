"""The people beside a flight: their options, and the onlookers that work for them."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.events import Event
from missions.flight.state import Setting, State
from missions.flight.step import step
from uavmap.aircraft.process.messages import PreflightOptions, Telemetry
from uavmap.journal.kept_frames import KeptFrame
from uavmap.runner.operator.interrupts import Caller
from uavmap.runner.preflight.plan_figures import plan_lines
from uavmap.runner.service import Service


class Onlooker:
    """An observer of a flight that does nothing unless overridden; no method may raise or be
    slow."""

    def see_earlier(self, event: Event, state: State) -> None:
        """See an event from before a resume; `state` is the state after it."""

    def begin(self, setting: Setting, *, again: bool) -> None:
        """See the flight start; with `again` a recorded one is repeated first."""

    def notice(self, event: Event) -> None:
        """See an event as it arrives, before it is in the journal or has an effect."""

    def see_telemetry(self, telemetry: Telemetry) -> None:
        """See a vehicle's report beside events, about once a second."""

    def update(self, event: Event, state: State, again: int) -> None:
        """See an event and the state after it; `again` recorded ones are still to come."""

    def keep(self, frame: KeptFrame, picture: bytes | NDArray[np.uint8]) -> None:
        """See a picture that is about to be judged."""

    def steering(self, service: Service) -> AbstractContextManager[None]:
        """Pass orders on to the service in the context."""
        return contextlib.nullcontext()

    def end(self) -> None:
        """See the flight end."""


@dataclass(frozen=True, slots=True)
class Preflight:
    """The operator's options before a flight."""

    yes: bool = False
    """True to fly without a question."""
    dry_run: bool = False
    """True to do all but arm."""
    keep_fence: bool = False
    """True to keep the autopilot's fence, and to fly no mission that leaves it."""

    def options(self, setting: Setting) -> PreflightOptions:
        """Return it as it is sent to the aircraft."""
        return PreflightOptions(tuple(plan_lines(setting)), self.yes, self.dry_run)


@dataclass(frozen=True, slots=True, kw_only=True)
class Company:
    """The people beside a flight, and the onlookers.

    `onlookers` see the flight, and pass on orders to real aircraft. `preflight` is None for a
    flight that is simulated or resumed. `caller` interrupts a flight outside the main thread. `ask`
    asks the operator, if there is one. With `recall` vehicles in the air only return.
    """

    onlookers: Sequence[Onlooker] = ()
    preflight: Preflight | None = None
    caller: Caller | None = None
    ask: Callable[[str], bool] | None = None
    recall: bool = False


def folded(setting: Setting, events: Iterable[Event], onlookers: Sequence[Onlooker] = ()) -> State:
    """Return the state after the events of a journal; the onlookers see each of them."""
    state = setting.initial_state()
    for event in events:
        state, _ = step(state, event)
        for onlooker in onlookers:
            onlooker.see_earlier(event, state)
    return state
