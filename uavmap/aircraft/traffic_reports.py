"""Aircraft of others that vehicles' receivers report, as events of the mission."""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Callable, Iterator, Mapping
from typing import Final

from missions.errors import GeodesyError
from missions.events import Event, Tracked, TrafficSeen
from missions.mission.layout import Layout
from missions.traffic import Track
from missions.units import GridPoint
from uavmap.mavlink.link_traffic import TrafficReport
from uavmap.mavlink.session import Session

REPORT_INTERVAL_S: Final = 1.0
"""Minimum time between two events, mission seconds."""
MAX_TRACKS: Final = 20
"""Maximum number of tracks in an event, the nearest to the start."""


class TrafficReports:
    """New reports of traffic on all links of a service, at each place of a vehicle: without a timer
    that would change a simulated flight."""

    def __init__(
        self,
        sessions: Mapping[int, Session],
        setting: Layout,
        now_s: Callable[[], float],
        report: Callable[[Event], None],
    ) -> None:
        self._sessions = sessions
        self._grid = setting.grid
        self._home_level_m = {number: setting.home_level_m(number) for number in sessions}
        self._now_s = now_s
        self._report = report
        self._due_s = float("-inf")
        self._reported_s: dict[str, float] = {}
        """Time of the last report of each aircraft, on the loop's clock."""

    def follow(self, event: Event) -> None:
        """Report traffic behind a place of a vehicle, if the last report is old enough."""
        if not isinstance(event, Tracked) or event.t_s < self._due_s:
            return
        newest: dict[str, tuple[float, Track]] = {}
        known_s: dict[str, float] = {}
        for received_s, track in self._new_reports(known_s):
            if track.ident not in newest or received_s > newest[track.ident][0]:
                newest[track.ident] = received_s, track
        self._reported_s = known_s
        start = GridPoint(0.0, 0.0)
        tracks = sorted(
            (track for _, track in newest.values()),
            key=lambda track: (track.place.distance_to(start), track.ident),
        )
        if tracks:
            self._due_s = event.t_s + REPORT_INTERVAL_S
            self._report(TrafficSeen(event.t_s, tuple(tracks[:MAX_TRACKS])))

    def _new_reports(self, known_s: dict[str, float]) -> Iterator[tuple[float, Track]]:
        """Yield the reports since the last event, but for our own vehicles; note their times in
        `known_s`."""
        own = {session.view.uid for session in self._sessions.values()}
        for number, session in self._sessions.items():
            for ident, received in session.traffic.aircraft.items():
                known_s[ident] = max(received.received_s, known_s.get(ident, float("-inf")))
                if ident in own or received.received_s <= self._reported_s.get(
                    ident, float("-inf")
                ):
                    continue
                with contextlib.suppress(GeodesyError):
                    yield received.received_s, self._track(number, session, received)

    def _track(self, number: int, session: Session, received: TrafficReport) -> Track:
        grid = self._grid
        place = grid.fixed(received.position)
        age_s = asyncio.get_running_loop().time() - received.received_s
        height_m, velocity_m_s = None, None
        if received.amsl_m is not None:
            above_home_m = received.amsl_m - session.view.home_amsl_m
            height_m = round(above_home_m + self._home_level_m[number], 1)
        if received.velocity_m_s is not None:
            east, north = received.velocity_m_s
            turn = grid.convergence_rad
            cos, sin = math.cos(turn), math.sin(turn)
            velocity_m_s = GridPoint(
                round(east * cos - north * sin, 1), round(east * sin + north * cos, 1)
            )
        return Track(
            received.ident,
            received.name,
            round(self._now_s() - age_s, 1),
            GridPoint(round(place.east_m, 1), round(place.north_m, 1)),
            height_m,
            received.error_m,
            velocity_m_s,
        )
