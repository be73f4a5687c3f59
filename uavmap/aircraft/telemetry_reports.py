"""Reports of vehicles beside events, for onlookers: sent after their positions, in no journal."""

from __future__ import annotations

import asyncio
from collections import defaultdict, deque
from collections.abc import Callable, Mapping
from typing import Final

from missions.events import Event, Tracked
from uavmap.aircraft.process.messages import Telemetry
from uavmap.mavlink.session import Session

REPORT_INTERVAL_S: Final = 1.0
"""Minimum time between two reports of a vehicle, mission seconds."""
LOSS_REPORTS: Final = 10
"""Number of reports over which the loss of a link is measured."""


class TelemetryReports:
    """Reports of vehicles, each after an event that its process sends anyway.

    So no timer of its own changes a simulated flight.
    """

    def __init__(self, sessions: Mapping[int, Session], send: Callable[[Telemetry], None]) -> None:
        self._sessions = sessions
        self._send = send
        self._due_s: dict[int, float] = {}
        self._counts: dict[int, deque[tuple[int, int]]] = defaultdict(
            lambda: deque(maxlen=LOSS_REPORTS + 1)
        )

    def follow(self, event: Event) -> None:
        """Send a report after a position of a vehicle, if the last one is old enough."""
        if not isinstance(event, Tracked) or event.t_s < self._due_s.get(event.vehicle, 0.0):
            return
        self._due_s[event.vehicle] = event.t_s + REPORT_INTERVAL_S
        session = self._sessions.get(event.vehicle)
        if session is not None:
            self._send(self._report(event.vehicle, session))

    def _report(self, vehicle: int, session: Session) -> Telemetry:
        view = session.view
        counts = self._counts[vehicle]
        counts.append(session.losses.counts((view.system_id, view.autopilot_component)))
        received, missing = (
            now - before for now, before in zip(counts[-1], counts[0], strict=True)
        )
        return Telemetry(
            vehicle=vehicle,
            mode=view.mode_name,
            satellites=view.satellites,
            hdop=view.hdop,
            volts=view.volts,
            loss_percent=round(100.0 * max(missing, 0) / (received + missing))
            if received > 0
            else None,
            late_s=round(view.age_s(asyncio.get_running_loop().time()), 1),
        )
