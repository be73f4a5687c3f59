"""The reducer: what an event changes, and what everybody is told to do next.

    step(setting, state, event) -> (state, orders)

Pure: the same state and event give the same orders, so a resume, a replay and a test are one
mechanism. `missions.flight.transitions` says what an event changes, `missions.flight.dispatch`
what idle vehicles do.
"""

from __future__ import annotations

from collections.abc import Iterable

from missions.events import Event, Told, Weighed
from missions.flight.dispatch import assign
from missions.flight.operator_orders import explained
from missions.flight.setting import Setting
from missions.flight.state import State
from missions.flight.transitions import apply
from missions.orders import Order

Orders = tuple[tuple[int, Order], ...]


def step(setting: Setting, state: State, event: Event) -> tuple[State, Orders]:
    """The state after an event, and the new orders by vehicle.

    An order holds until it ends or until another replaces it.
    """
    if isinstance(event, Told):  # words move nobody, and no plan depends on when they came
        return explained(state, event), ()
    if isinstance(event, Weighed):  # for maps of recorded pictures; no flight plans by it
        return state, ()
    after = assign(setting, apply(setting, state, event))
    orders = tuple(
        (number, vehicle.order)
        for number, vehicle in after.vehicles.items()
        if vehicle.order is not None
        and vehicle.order is not state.vehicles[number].order
        and number in after.our_numbers
    )
    return after, orders


def fold(setting: Setting, events: Iterable[Event]) -> State:
    """The state after a journal."""
    state = State.initial(setting)
    for event in events:
        state, _ = step(setting, state, event)
    return state
