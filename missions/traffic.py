"""Aircraft of others near the team: when it holds, and when it comes home.

The team holds while a track is near. It comes home while a track leads close to one of its
vehicles, or may do so because its velocity is unknown. A track that is silent expires.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Final, NamedTuple

from missions.units import GridPoint

MAX_TRACK_AGE_S: Final = 30.0
"""Age of a position from which a track counts no more, s."""
LOOK_AHEAD_S: Final = 60.0
"""Time for which a track is followed straight ahead, s."""
CLOSE_SHARE: Final = 0.5
"""Share of the distance, within which a track must not lead if the team is to stay out."""
CLEAR_AFTER_S: Final = 10.0
"""Time without the cause after which the team goes on, s."""
MAX_TRACKS: Final = 50
"""Maximum number of tracks that are remembered: the nearest to the start."""


class Track(NamedTuple):
    """An aircraft of others, as a receiver reports it."""

    ident: str
    name: str
    """Its call sign, or else `ident`, for people."""
    seen_s: float
    """Mission time of its position."""
    place: GridPoint
    height_m: float | None
    """Above the start; None where it is unknown."""
    error_m: float
    """Largest error of the height, m."""
    velocity_m_s: GridPoint | None
    """Along the grid's axes; None where it is unknown."""

    def at(self, t_s: float) -> GridPoint:
        """Return where it is at a time if it flies straight on."""
        if self.velocity_m_s is None:
            return self.place
        flown_s = max(t_s - self.seen_s, 0.0)
        east_m, north_m = self.place
        return GridPoint(
            east_m + flown_s * self.velocity_m_s.east_m,
            north_m + flown_s * self.velocity_m_s.north_m,
        )


class Rule(NamedTuple):
    """The distance and height that count as near: `traffic` of a mission file."""

    distance_m: float
    """Over ground; 0: tracks are shown, and nothing else."""
    height_m: float
    """In height, beside what heights may be off."""


class Place(NamedTuple):
    """Position of a vehicle of the team: over ground, and above the start."""

    point: GridPoint
    level_m: float


class Answer(IntEnum):
    """The team's response to traffic; the larger counts."""

    GO_ON = 0
    HOLD = 1
    COME_HOME = 2


@dataclass(frozen=True, slots=True)
class Traffic:
    """The tracks that are known, and what the team does about them.

    >>> rule, team = Rule(1000.0, 300.0), [Place(GridPoint(0.0, 0.0), 12.0)]
    >>> away, near = GridPoint(0.0, 50.0), GridPoint(0.0, 900.0)
    >>> track = Track("3C6444", "DLH1", 5.0, near, 100.0, 0.0, away)
    >>> Traffic().with_tracks([track]).with_answer(rule, team, 6.0).answer
    <Answer.HOLD: 1>
    """

    tracks: tuple[Track, ...] = ()
    answer: Answer = Answer.GO_ON
    because: str = ""
    """The name of the track that the team answers to."""
    hold_until_s: float = -math.inf
    home_until_s: float = -math.inf
    ignored: frozenset[str] = frozenset()
    """Tracks in spite of which the operator lets the team go on."""

    def with_tracks(self, tracks: Iterable[Track]) -> Traffic:
        """Return this traffic with what a receiver has reported."""
        known = {track.ident: track for track in self.tracks}
        for track in tracks:
            if track.ident not in known or track.seen_s >= known[track.ident].seen_s:
                known[track.ident] = track
        start = GridPoint(0.0, 0.0)
        nearest = sorted(known.values(), key=lambda track: track.place.distance_to(start))
        return replace(self, tracks=tuple(nearest[:MAX_TRACKS]))

    def ignoring(self) -> Traffic:
        """Return this traffic after the operator has let the team go on in spite of it."""
        if self.answer is Answer.GO_ON:
            return self
        names = frozenset(track.ident for track in self.tracks)
        return Traffic(self.tracks, ignored=self.ignored | names)

    def with_answer(self, rule: Rule, team: Iterable[Place], t_s: float) -> Traffic:
        """Return this traffic at a time, with what the team does; itself where nothing changes."""
        if not self.tracks and self.answer is Answer.GO_ON:
            return self
        fresh = tuple(track for track in self.tracks if t_s - track.seen_s <= MAX_TRACK_AGE_S)
        counts = rule.distance_m > 0.0
        counted = [track for track in fresh if counts and track.ident not in self.ignored]
        places = list(team)
        answers = [(_answer(rule, track, places, t_s), track.name) for track in counted]
        worst, name = max(answers, default=(Answer.GO_ON, ""))
        until_s = t_s + CLEAR_AFTER_S
        hold_until_s = until_s if worst >= Answer.HOLD else self.hold_until_s
        home_until_s = until_s if worst >= Answer.COME_HOME else self.home_until_s
        answer = Answer.HOLD if t_s < hold_until_s else Answer.GO_ON
        answer = Answer.COME_HOME if t_s < home_until_s else answer
        because = (name or self.because) if answer else ""
        ignored = self.ignored & {track.ident for track in fresh}
        return Traffic(fresh, answer, because, hold_until_s, home_until_s, ignored)


NO_TRAFFIC: Final = Traffic()


def _answer(rule: Rule, track: Track, team: Iterable[Place], t_s: float) -> Answer:
    """Return what a track asks of the team."""
    worst, now, ahead = Answer.GO_ON, track.at(t_s), track.at(t_s + LOOK_AHEAD_S)
    for vehicle in team:
        if track.height_m is not None:
            apart_m = abs(track.height_m - vehicle.level_m)
            if apart_m > rule.height_m + track.error_m:
                continue
        if _passes_m(vehicle.point, track.place, now) > rule.distance_m:
            continue
        passes_m = _passes_m(vehicle.point, now, ahead)
        if track.velocity_m_s is None or passes_m <= CLOSE_SHARE * rule.distance_m:
            return Answer.COME_HOME
        worst = Answer.HOLD
    return worst


def _passes_m(point: GridPoint, start: GridPoint, end: GridPoint) -> float:
    """Return how near a straight line comes to a point, m.

    >>> _passes_m(GridPoint(0, 3), GridPoint(-10, 0), GridPoint(10, 0))
    3.0
    """
    east_m, north_m = end.east_m - start.east_m, end.north_m - start.north_m
    length_2 = east_m * east_m + north_m * north_m
    if length_2 <= 0.0:
        return point.distance_to(start)
    along = (point.east_m - start.east_m) * east_m + (point.north_m - start.north_m) * north_m
    share = min(max(along / length_2, 0.0), 1.0)
    nearest = GridPoint(start.east_m + share * east_m, start.north_m + share * north_m)
    return point.distance_to(nearest)
