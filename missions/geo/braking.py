"""Braking on paths that are flown without stopping, and the replacement of plans."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

from missions.geo.trajectory import Motion, Piece, Trajectory

ARC_BRAKE_M_S2: Final = 1.0
"""Maximum braking on an arc, m/s^2: the turn needs most of the acceleration."""
_TINY_S: Final = 1e-6


def braked(path: Trajectory, t_s: float, brake_m_s2: float) -> Trajectory:
    """Return the path from `t_s` on that comes to rest along `path`, never faster than it."""
    pieces: list[Piece] = []
    now_s, speed = max(t_s, path.begin_s), -1.0
    for piece in path.pieces:
        into_s = max(0.0, max(t_s, path.begin_s) - piece.begin_s)
        if into_s >= piece.duration_s:
            continue
        if speed < 0.0:
            speed = max(0.0, piece.speed_m_s + piece.accel_m_s2 * into_s)
        here = piece.after(into_s)
        heading = piece.heading_rad + piece.curvature_1_m * piece.distance_m(into_s)
        left_m = piece.length_m - piece.distance_m(into_s)
        slows = ARC_BRAKE_M_S2 if piece.curvature_1_m else brake_m_s2
        stop_m = speed * speed / (2.0 * slows)
        end = 0.0 if stop_m <= left_m else math.sqrt(speed * speed - 2.0 * slows * left_m)
        duration_s = (speed - end) / slows
        if duration_s > _TINY_S:
            pieces.append(
                Piece(
                    now_s, duration_s, here.east_m, here.north_m, heading,
                    piece.curvature_1_m, speed, -slows,
                )
            )  # fmt: skip
            now_s += duration_s
        speed = end
        if end == 0.0:
            break
    if not pieces:
        at = path.at(max(t_s, path.begin_s))
        drift_east, drift_north = path.drift_m_s
        east_m, north_m = at.east_m - drift_east * t_s, at.north_m - drift_north * t_s
        pieces.append(Piece(now_s, 0.0, east_m, north_m, 0.0, 0.0, 0.0, 0.0))
    return Trajectory(pieces[0].begin_s, now_s, tuple(pieces), path.drift_m_s)


def cut_short(path: Trajectory, t_s: float, brake_m_s2: float) -> Trajectory:
    """Return the path to where it comes to rest if it begins to brake at `t_s` (`braked`).

    `t_s` lies after the beginning.

    >>> from missions.geo.trajectory import rounded_path
    >>> from missions.units import GridPoint
    >>> path = rounded_path([GridPoint(0, 0), GridPoint(90, 0)], 0.0, speed_m_s=6.0)
    >>> short = cut_short(path, 6.0, brake_m_s2=2.0)
    >>> short.begin_s, round(short.end_s, 3), round(short.at(short.end_s).east_m, 3)
    (0.0, 9.0, 36.0)
    >>> short.at(5.0) == path.at(5.0)
    True
    """
    stop = braked(path, t_s, brake_m_s2)
    before = [
        replace(piece, duration_s=min(piece.duration_s, t_s - piece.begin_s))
        for piece in path.pieces
        if piece.begin_s < t_s
    ]
    return Trajectory(path.begin_s, stop.end_s, (*before, *stop.pieces), path.drift_m_s)


KEPT_PAST_S: Final = 2.0
"""Kept part of the past, s: telemetry is older than now, and the stream is smoothed."""


@dataclass(frozen=True, slots=True)
class Course:
    """The trajectory of a vehicle while plans replace one another, without a gap.

    Trajectories, each of which is flown from its own beginning on, until the next begins.

    >>> from missions.geo.trajectory import rounded_path
    >>> from missions.units import GridPoint
    >>> first = rounded_path([GridPoint(0, 0), GridPoint(60, 0)], 0.0, speed_m_s=6.0)
    >>> here = first.at(5.0)
    >>> turned = [here.place, GridPoint(40, 0), GridPoint(40, 30)]
    >>> second = rounded_path(turned, 5.0, speed_m_s=6.0, begin_speed_m_s=here.v_east_m_s)
    >>> course = Course((first,)).then(second, now_s=4.0)
    >>> course.at(4.5) == first.at(4.5), course.at(5.5) == second.at(5.5)
    (True, True)
    """

    parts: tuple[Trajectory, ...]
    """Trajectories, at least one, in the order of their beginnings."""

    @property
    def end_s(self) -> float:
        """Time when it is at rest, mission seconds."""
        return self.parts[-1].end_s

    def at(self, t_s: float) -> Motion:
        """Return the motion at mission time `t_s`, fixed frame."""
        for part in reversed(self.parts):
            if part.begin_s <= t_s:
                return part.at(t_s)
        return self.parts[0].at(t_s)

    def then(self, plan: Trajectory, now_s: float) -> Course:
        """Return this course with a new plan from its beginning on.

        Parts that were to begin later are dropped, and those that ended `KEPT_PAST_S` ago.
        """
        parts = [part for part in self.parts if part.begin_s < plan.begin_s]
        while len(parts) > 1 and parts[1].begin_s <= now_s - KEPT_PAST_S:
            del parts[0]
        if plan.begin_s <= now_s - KEPT_PAST_S:
            parts.clear()
        return Course((*parts, plan))
