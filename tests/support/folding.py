"""The state after a journal, without any observer."""

from __future__ import annotations

from collections.abc import Iterable

from missions.events import Event
from missions.flight.state import Setting, State
from missions.flight.step import step


def fold(setting: Setting, events: Iterable[Event]) -> State:
    """Return the state after some events."""
    state = setting.initial_state()
    for event in events:
        state, _ = step(state, event)
    return state
