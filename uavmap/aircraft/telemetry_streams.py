"""The streams of telemetry that a mission needs: requested, and seen to come."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import CommandRefusedError, LinkError
from uavmap.mavlink.session import Session

SILENT_S: Final = 5.0
"""Silence of a stream after which it is requested, and interval to request it again, s."""
TRIES: Final = 10
"""Maximum number of requests: an autopilot may not have the stream."""
ONLOOKER_STREAMS: Final = {mav.MAVLINK_MSG_ID_GPS_RAW_INT: 1.0}
"""Streams for onlookers only, Hz by message id: requested in flight, without waiting."""
MAX_REQUEST_S: Final = 120.0
"""Maximum time for all streams to be acknowledged, s."""


class Streams:
    """The streams of one vehicle: those of a mission, and others (`also`)."""

    def __init__(self, name: str, session: Session, *also: Mapping[int, float]) -> None:
        self._name = name
        self._also = also
        self._session = session
        self._view = session.view
        self._reboots = 0
        """Number of restarts of the vehicle at the last request."""
        self._asked_s = 0.0
        self._tried: dict[int, int] = {}
        self._refused: set[int] = set()
        """Streams that the autopilot does not have, or sends at its own rate."""

    async def ask(self, receives: Callable[[], bool]) -> None:
        """Request every stream until it is acknowledged, while the vehicle is received.

        A refused stream may come anyway. Raises `LinkError`.
        """
        begin_s = asyncio.get_running_loop().time()
        self._reboots = self._view.gate.clock.reboots
        for message_id, rate_hz in self._rates.items():
            while True:
                try:
                    await self._session.message_interval(message_id, rate_hz)
                    break
                except CommandRefusedError:
                    self._refused.add(message_id)
                    break
                except LinkError as error:
                    waited_s = asyncio.get_running_loop().time() - begin_s
                    if not receives() or waited_s > MAX_REQUEST_S:
                        raise LinkError(
                            f"{self._name}: {error} in {waited_s:.0f} s: the link loses too much, "
                            "or it carries nothing towards the vehicle"
                        ) from None

    @property
    def _rates(self) -> Mapping[int, float]:
        """Rates, Hz, by message id."""
        every = (self._view.kind.streams, *self._also)
        return {message_id: hz for rates in every for message_id, hz in rates.items()}

    @property
    def go_on(self) -> bool:
        """Return whether a vehicle that is back still sends all requested streams.

        New requests take a minute over a link that loses much.
        """
        return self._view.gate.clock.reboots == self._reboots and all(
            self._silent_s(message_id) < SILENT_S
            for message_id in self._rates.keys() - self._refused
        )

    def keep(self) -> None:
        """Request missing streams again, without waiting; call it about once a second.

        An acknowledgement names no stream: on a link that delays or doubles frames one may have
        been taken for another's.
        """
        loop_s = asyncio.get_running_loop().time()
        if loop_s - self._asked_s < SILENT_S:
            return
        self._asked_s = loop_s
        for message_id, rate_hz in {**ONLOOKER_STREAMS, **self._rates}.items():
            if self._silent_s(message_id) < SILENT_S:
                self._tried[message_id] = 0
            elif (tried := self._tried.get(message_id, 0)) < TRIES:
                self._tried[message_id] = tried + 1
                self._session.request_interval(message_id, rate_hz)

    def _silent_s(self, message_id: int) -> float:
        received_s = self._session.received_s.get(message_id, float("-inf"))
        return asyncio.get_running_loop().time() - received_s
