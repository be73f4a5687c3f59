"""Airspace that members reserve among each other: requests, agreements, reservations.

A vehicle that changes height in others' layers requests the column for it. The others close the
column to themselves, leave it, and agree; the vehicle starts once all active ones have.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Final

from missions.events import Event
from missions.fleet_events import AirLeased, AirRequested
from missions.flight.airspace.airspace import Airspace
from missions.flight.state import Setting, State
from missions.flight.vehicle_state import Column
from missions.units import GridPoint
from uavmap.fleet.codec import AirRequest
from uavmap.fleet.peer import Peer

MAX_REQUEST_S: Final = 600.0
"""Maximum time for which airspace is requested, or kept clear, s."""


class AirspaceLeases:
    """The requests of one member, and its agreements to its `peers`.

    `hurry` sends the next message soon.
    """

    def __init__(
        self,
        setting: Setting,
        number: int,
        peers: Mapping[int, Peer],
        now_s: Callable[[], float],
        post: Callable[[Event], None],
        hurry: Callable[[], None],
    ) -> None:
        self._setting = setting
        self._number = number
        self._peers = peers
        self._now_s = now_s
        self._post = post
        self._hurry = hurry
        self._column: Column | None = None
        """Air that our vehicle requests."""
        self._question = 0
        """Number of that request."""
        self._leased = -1
        """Number of the request to which all have agreed."""

    def ask_for(self, column: Column | None) -> None:
        """Request the air that our vehicle needs, or end the request."""
        if column == self._column:
            return
        self._column = column
        # by the time, so that an agreement with an earlier start is no answer to this one
        self._question = max(self._question + 1, round(1_000 * self._now_s()))
        self._hurry()

    @property
    def question(self) -> AirRequest | None:
        """Return the present request."""
        column = self._column
        if column is None:
            return None
        return AirRequest(
            self._question, column.place, column.low_m, column.high_m, math.floor(column.until_s)
        )

    def receive_request(
        self, sender: int, ask: AirRequest | None, its_s: float, now_s: float
    ) -> None:
        """Close the air that another requests to our vehicles, for its time by its own clock."""
        peer = self._peers[sender]
        if ask == peer.ask:
            return
        peer.ask = ask
        t_s = round(now_s, 3)
        # (the message's delay adds to that: the air is closed longer here, never shorter)
        for_s = 0.0 if ask is None else ask.until_s - its_s
        if ask is None or not 0.0 < for_s <= MAX_REQUEST_S:
            self._post(AirRequested(sender, t_s, GridPoint(0.0, 0.0), 0.0, 0.0, t_s))
            return
        until_s = round(now_s + for_s, 3)
        self._post(AirRequested(sender, t_s, ask.place, ask.low_m, ask.high_m, until_s))
        self._hurry()

    def promises(self, state: State | None) -> dict[int, int]:
        """Return the requests that we agree to, by vehicle: those that meet no request of ours.

        The reducer closed the air when the request came; the agreement follows once we are out of
        it. If two want the same airspace, the lower number has it first, unless the other has it
        already.
        """
        found: dict[int, int] = {}
        if state is None:
            return found
        for number, peer in self._peers.items():
            column = state.closed.get(number)
            if peer.ask is None or column is None or peer.ask.place != column.place:
                continue
            ours, air = self._column, Airspace(state)
            first = self._leased == self._question or self._number < number
            wanted = ours is not None and air.columns_meet(ours, column) and first
            if not wanted and air.can_promise(column):
                found[number] = peer.ask.number
        return found

    def receive_promise(self, sender: int, question: int) -> None:
        """Note that another agreed to this request of ours, -1 for none.

        Our service gets the reservation once all members that could be in that airspace have
        agreed.
        """
        self._peers[sender].promised = question
        column = self._column
        if column is None or self._leased == self._question:
            return
        others = set(range(1, len(self._setting.mission.vehicles) + 1)) - {self._number}
        peers = [self._peers.get(number) for number in others]
        if all(p is not None and (p.done or p.promised == self._question) for p in peers):
            self._leased = self._question
            t_s = round(self._now_s(), 3)
            self._post(AirLeased(self._number, t_s, column.place, column.until_s))
