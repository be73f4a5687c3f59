"""A path that is flown without stopping, as an exact function of mission time.

Lines and arcs with a piecewise constant tangential acceleration. Corners are cut by arcs (fly-by).
An arc that passes its corner at the distance `cut_m` has the radius cut cos(th/2) / (1 -
cos(th/2)), th the angle of the turn. It is flown at sqrt(a r), so the acceleration across never
exceeds that along. A real ArduCopter follows this within 0.6 m.
"""

from __future__ import annotations

import itertools
import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Final, NamedTuple

from missions.units import GridPoint

ACCELERATION_M_S2: Final = 2.0
"""Maximum acceleration along and across, m/s^2; 2.5 (ArduCopter's default) is nearly as good."""
CUT_M: Final = 1.0
LANE_CUTS_M: Final = (2.0, 0.5)
"""Cuts of corners between lanes of a search, m: the first that the fence allows."""
_AHEAD_STEP_S: Final = 0.5
_REMEMBERED: Final = 256
_TINY_M: Final = 1e-9
_STRAIGHT_RAD: Final = 1e-6


class Motion(NamedTuple):
    """Place (m), velocity (m/s) and acceleration (m/s^2) along the grid's axes, fixed frame."""

    east_m: float
    north_m: float
    v_east_m_s: float
    v_north_m_s: float
    a_east_m_s2: float
    a_north_m_s2: float

    @property
    def place(self) -> GridPoint:
        """Position, m."""
        return GridPoint(self.east_m, self.north_m)


@dataclass(frozen=True, slots=True)
class Piece:
    """A line or an arc with a constant tangential acceleration, in the frame of the region.

    `heading_rad` is counted from east towards north, `curvature_1_m` positive to the left.
    """

    begin_s: float
    duration_s: float
    east_m: float
    north_m: float
    heading_rad: float
    curvature_1_m: float
    speed_m_s: float
    accel_m_s2: float

    def distance_m(self, time_s: float) -> float:
        """Return the distance along it `time_s` after its beginning, 0 to `duration_s`, m."""
        return (self.speed_m_s + 0.5 * self.accel_m_s2 * time_s) * time_s

    @property
    def length_m(self) -> float:
        """Length from end to end, along it, m."""
        return self.distance_m(self.duration_s)

    def place_after(self, time_s: float) -> tuple[float, float]:
        """Return the east and north position `time_s` after its beginning, 0 to `duration_s`."""
        way_m = self.distance_m(time_s)
        begin, bend = self.heading_rad, self.curvature_1_m
        if bend == 0.0:
            return self.east_m + way_m * math.cos(begin), self.north_m + way_m * math.sin(begin)
        heading = begin + bend * way_m
        return (
            self.east_m + (math.sin(heading) - math.sin(begin)) / bend,
            self.north_m - (math.cos(heading) - math.cos(begin)) / bend,
        )

    def after(self, time_s: float) -> Motion:
        """Return the motion `time_s` after its beginning, 0 to `duration_s`."""
        speed = max(self.speed_m_s + self.accel_m_s2 * time_s, 0.0)
        bend = self.curvature_1_m
        east, north = self.place_after(time_s)
        heading = self.heading_rad + bend * self.distance_m(time_s)
        cos, sin = math.cos(heading), math.sin(heading)
        along, across = self.accel_m_s2, speed * speed * bend
        return Motion(
            east,
            north,
            speed * cos,
            speed * sin,
            along * cos - across * sin,
            along * sin + across * cos,
        )


_BEGIN_S = attrgetter("begin_s")


@dataclass(frozen=True, slots=True)
class Trajectory:
    """The position of a vehicle at each moment from `begin_s` to `end_s`, mission seconds.

    >>> flown = rounded_path([GridPoint(0, 0), GridPoint(0, 30)], begin_s=10.0, speed_m_s=6.0)
    >>> round(flown.end_s - flown.begin_s, 3)
    8.0
    >>> round(flown.at(14.0).north_m, 3), round(flown.at(14.0).v_north_m_s, 3)
    (15.0, 6.0)
    """

    begin_s: float
    end_s: float
    """Time when it is at rest at its end, s."""
    pieces: tuple[Piece, ...]
    drift_m_s: tuple[float, float] = (0.0, 0.0)
    """Velocity of the region over ground, east and north: pieces are in the region's frame."""

    @property
    def length_m(self) -> float:
        """Length in the frame of the region, m."""
        return sum(piece.length_m for piece in self.pieces)

    def at(self, t_s: float) -> Motion:
        """Return the motion at time `t_s`, fixed frame.

        Before the beginning it is that at the beginning; after the end it is at rest, or drifts.
        """
        t_s = max(t_s, self.begin_s)
        if t_s < self.end_s:
            piece = self._piece(t_s)
            found = piece.after(min(t_s - piece.begin_s, piece.duration_s))
        else:
            last = self.pieces[-1].after(self.pieces[-1].duration_s)
            found = Motion(last.east_m, last.north_m, 0.0, 0.0, 0.0, 0.0)
        drift_east, drift_north = self.drift_m_s
        return Motion(
            found.east_m + drift_east * t_s,
            found.north_m + drift_north * t_s,
            found.v_east_m_s + drift_east,
            found.v_north_m_s + drift_north,
            found.a_east_m_s2,
            found.a_north_m_s2,
        )

    def place_at(self, t_s: float) -> GridPoint:
        """Return the position at time `t_s`: `at(t_s).place`, but faster."""
        t_s = max(t_s, self.begin_s)
        if t_s < self.end_s:
            piece = self._piece(t_s)
            east, north = piece.place_after(min(t_s - piece.begin_s, piece.duration_s))
        else:
            last = self.pieces[-1]
            east, north = last.place_after(last.duration_s)
        drift_east, drift_north = self.drift_m_s
        return GridPoint(east + drift_east * t_s, north + drift_north * t_s)

    def places(self, begin_s: float, end_s: float, steps: int) -> list[GridPoint]:
        """Return `steps` + 1 places at equal intervals from `begin_s` to `end_s`."""
        step_s = (end_s - begin_s) / steps
        return [self.place_at(begin_s + k * step_s) for k in range(steps + 1)]

    def goes_on(self, planned: Trajectory | None, t_s: float) -> bool:
        """Return whether this is the planned path, or the same at a time: a fence may cut it."""
        if planned is None or planned is self:
            return planned is self
        return self.begin_s == planned.begin_s and self.at(t_s) == planned.at(t_s)

    def resting(self, rest_s: float) -> Trajectory:
        """Return this path of the fixed frame with a rest at its end."""
        end = self.at(self.end_s).place
        rest = Piece(self.end_s, rest_s, end.east_m, end.north_m, 0.0, 0.0, 0.0, 0.0)
        return replace(self, end_s=self.end_s + rest_s, pieces=(*self.pieces, rest))

    def in_frame(self, drift_m_s: tuple[float, float], at_s: float) -> Trajectory:
        """Return this path of the fixed frame in one that drifts, its velocity unchanged."""
        if self.drift_m_s == drift_m_s or drift_m_s == (0.0, 0.0):
            return self
        east_m, north_m = drift_m_s[0] * at_s, drift_m_s[1] * at_s
        moved = tuple(
            replace(p, east_m=p.east_m - east_m, north_m=p.north_m - north_m) for p in self.pieces
        )
        return replace(self, pieces=moved, drift_m_s=drift_m_s)

    def _piece(self, t_s: float) -> Piece:
        return self.pieces[max(bisect_right(self.pieces, t_s, key=_BEGIN_S) - 1, 0)]


class _Stretch(NamedTuple):
    """A line or an arc before its speeds are known; `most_m_s` is the limit by its curvature."""

    length_m: float
    east_m: float
    north_m: float
    heading_rad: float
    curvature_1_m: float
    most_m_s: float
    halts: bool = False
    """True if the path comes to rest at its beginning, to turn back."""


_PLACES: Final[dict[tuple[int, float, float], tuple[Trajectory, tuple[GridPoint, ...]]]] = {}
"""Known places of paths. A path is kept with its answer, so that no other can have its id."""


def places_ahead(path: Trajectory, t_s: float, ahead_s: float) -> tuple[GridPoint, ...]:
    """Return places, half a second apart, where a path leads in the next `ahead_s` seconds."""
    question = (id(path), t_s, ahead_s)  # hashing or comparing whole paths would take as long
    known = _PLACES.get(question)
    if known is not None and known[0] is path:
        return known[1]
    begin_s = max(t_s, path.begin_s)
    end_s = max(begin_s, min(begin_s + ahead_s, path.end_s))
    places = tuple(path.places(begin_s, end_s, max(1, round((end_s - begin_s) / _AHEAD_STEP_S))))
    if len(_PLACES) >= _REMEMBERED:
        _PLACES.clear()
    _PLACES[question] = path, places
    return places


def at_rest(place: GridPoint, begin_s: float, duration_s: float) -> Trajectory:
    """Return a path on which a vehicle stays where it is."""
    here = Piece(begin_s, duration_s, place.east_m, place.north_m, 0.0, 0.0, 0.0, 0.0)
    return Trajectory(begin_s, round(begin_s + duration_s, 3), (here,))


def rounded_path(
    points: Sequence[GridPoint],
    begin_s: float,
    *,
    speed_m_s: float,
    cut_m: float | Sequence[float] = CUT_M,
    accel_m_s2: float = ACCELERATION_M_S2,
    begin_speed_m_s: float = 0.0,
    drift_m_s: tuple[float, float] = (0.0, 0.0),
) -> Trajectory:
    """Return a polyline with its corners cut, as fast as the limits allow, to rest at its end.

    It begins at the first of `points` (frame of the region) with `begin_speed_m_s` towards the
    second, and comes to rest where it turns back. `cut_m` is the cut of all corners, or one for
    each point.

    Raises ValueError without points, and for numbers that are not finite or positive. Raises it for
    a first speed too high for the first corner or the end as well.
    """
    cuts_m = [cut_m] * len(points) if isinstance(cut_m, int | float) else list(cut_m)
    if len(cuts_m) != len(points):
        raise ValueError(f"{len(points)} points have {len(cuts_m)} cuts")
    numbers = (begin_s, speed_m_s, *cuts_m, accel_m_s2, begin_speed_m_s, *drift_m_s)
    places = itertools.chain.from_iterable(points)
    if not points or not all(map(math.isfinite, itertools.chain(numbers, places))):
        raise ValueError("a path needs points, and finite numbers")
    if min(speed_m_s, *cuts_m, accel_m_s2) <= 0.0 or begin_speed_m_s < 0.0:
        raise ValueError("speed, cut and acceleration are positive")
    stretches = _stretches(points, speed_m_s, cuts_m, accel_m_s2)
    speeds = _speeds(stretches, accel_m_s2, min(begin_speed_m_s, speed_m_s))
    if speeds[0] < begin_speed_m_s - 1e-6:
        raise ValueError(f"the path cannot be begun at {begin_speed_m_s:g} m/s")
    pieces: list[Piece] = []
    t_s = begin_s
    for stretch, (begin, end) in zip(stretches, itertools.pairwise(speeds), strict=True):
        done_m = 0.0
        for length_m, first, second in _profile(stretch, begin, end, accel_m_s2):
            duration_s = 2.0 * length_m / (first + second)
            accel = (second - first) / duration_s
            pieces.append(_piece(stretch, done_m, t_s, duration_s, first, accel))
            t_s += duration_s
            done_m += length_m
    if not pieces:
        pieces.append(Piece(begin_s, 0.0, *points[-1], 0.0, 0.0, 0.0, 0.0))
    return Trajectory(begin_s, t_s, tuple(pieces), drift_m_s)


def least_s(length_m: float, speed_m_s: float, accel_m_s2: float) -> float:
    """Return the minimum time of a way from rest to rest, s."""
    if length_m < speed_m_s**2 / accel_m_s2:
        return 2.0 * math.sqrt(length_m / accel_m_s2)
    return length_m / speed_m_s + speed_m_s / accel_m_s2


def corner_pause_s(speed_m_s: float, cut_m: float) -> float:
    """Return the extra time of a cut right-angled corner over its arc at full speed, s.

    >>> round(corner_pause_s(6.0, 2.0), 2), corner_pause_s(2.0, 2.0)
    (0.7, 0.0)
    """
    half = math.cos(math.pi / 4.0)
    slow_m_s = min(speed_m_s, math.sqrt(ACCELERATION_M_S2 * cut_m * half / (1.0 - half)))
    return (speed_m_s - slow_m_s) ** 2 / (ACCELERATION_M_S2 * speed_m_s)


def _stretches(
    points: Sequence[GridPoint], speed_m_s: float, cuts_m: Sequence[float], accel_m_s2: float
) -> list[_Stretch]:
    """Return lines and the arcs between them; points that lie on one another count once."""
    # start, length, heading, cut of the corner at its end
    legs: list[tuple[GridPoint, float, float, float]] = []
    for a, b, cut_m in zip(points, points[1:], cuts_m[1:], strict=False):
        if (length_m := a.distance_to(b)) > _TINY_M:
            heading = math.atan2(b.north_m - a.north_m, b.east_m - a.east_m)
            legs.append((a, length_m, heading, cut_m))
    found: list[_Stretch] = []
    used_m, halts = 0.0, False
    for index, (begin, length_m, heading, cut_m) in enumerate(legs):
        cos, sin = math.cos(heading), math.sin(heading)
        turn = tangent_m = 0.0
        if index + 1 < len(legs):
            _, next_m, next_heading, _ = legs[index + 1]
            turn = math.remainder(next_heading - heading, math.tau)
            tangent_m = _tangent_m(abs(turn), cut_m, 0.5 * min(length_m, next_m))
        line_m = max(length_m - used_m - tangent_m, 0.0)
        east, north = begin.east_m + used_m * cos, begin.north_m + used_m * sin
        found.append(_Stretch(line_m, east, north, heading, 0.0, speed_m_s, halts))
        halts = abs(turn) > _STRAIGHT_RAD and tangent_m <= _TINY_M
        if tangent_m > _TINY_M:
            radius_m = tangent_m / math.tan(abs(turn) / 2.0)
            east, north = east + line_m * cos, north + line_m * sin
            most = min(speed_m_s, math.sqrt(accel_m_s2 * radius_m))
            bend = math.copysign(1.0 / radius_m, turn)
            found.append(_Stretch(radius_m * abs(turn), east, north, heading, bend, most))
        used_m = tangent_m
    return found


def _tangent_m(turn_rad: float, cut_m: float, most_m: float) -> float:
    """Return the distance of an arc's beginning from its corner; 0 without an arc, m."""
    cos = math.cos(turn_rad / 2.0)
    if turn_rad < _STRAIGHT_RAD or cos < _STRAIGHT_RAD:
        return 0.0
    radius_m = cut_m * cos / (1.0 - cos)
    return min(radius_m * math.tan(turn_rad / 2.0), most_m)


def _speeds(stretches: Sequence[_Stretch], accel_m_s2: float, begin_m_s: float) -> list[float]:
    """Return the speeds between stretches, at the beginning and the end: forward, then backward
    pass."""
    speeds = [begin_m_s]
    for index, stretch in enumerate(stretches):
        most = stretch.most_m_s
        ends = index + 1 == len(stretches) or stretches[index + 1].halts
        following = 0.0 if ends else stretches[index + 1].most_m_s
        speeds.append(min(_reached(stretch, speeds[-1], accel_m_s2), most, following))
    for index in range(len(stretches) - 1, -1, -1):
        stretch = stretches[index]
        slowed = _reached(stretch, speeds[index + 1], accel_m_s2)
        speeds[index] = min(speeds[index], slowed)
    return speeds


def _reached(stretch: _Stretch, speed_m_s: float, accel_m_s2: float) -> float:
    """Return the speed at the other end of a stretch: an arc is flown at one speed."""
    if stretch.curvature_1_m:
        return speed_m_s
    return math.sqrt(speed_m_s**2 + 2.0 * accel_m_s2 * stretch.length_m)


def _profile(
    stretch: _Stretch, begin_m_s: float, end_m_s: float, accel_m_s2: float
) -> list[tuple[float, float, float]]:
    """Return length, first and last speed of its pieces: faster, level, slower."""
    if stretch.length_m <= _TINY_M:
        return []
    if stretch.curvature_1_m:
        return [(stretch.length_m, begin_m_s, begin_m_s)]
    squares = 0.5 * (begin_m_s**2 + end_m_s**2)
    peak = min(stretch.most_m_s, math.sqrt(squares + accel_m_s2 * stretch.length_m))
    up_m = max((peak**2 - begin_m_s**2) / (2.0 * accel_m_s2), 0.0)
    down_m = max((peak**2 - end_m_s**2) / (2.0 * accel_m_s2), 0.0)
    level_m = stretch.length_m - up_m - down_m
    pieces = ((up_m, begin_m_s, peak), (level_m, peak, peak), (down_m, peak, end_m_s))
    return [piece for piece in pieces if piece[0] > _TINY_M]


def _piece(
    stretch: _Stretch, done_m: float, begin_s: float, duration_s: float, speed: float, accel: float
) -> Piece:
    """Return a part of a stretch that begins `done_m` after it; only lines have several."""
    heading = stretch.heading_rad
    east = stretch.east_m + done_m * math.cos(heading)
    north = stretch.north_m + done_m * math.sin(heading)
    return Piece(begin_s, duration_s, east, north, heading, stretch.curvature_1_m, speed, accel)
