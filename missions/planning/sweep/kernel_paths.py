"""Conversion between paths of the kernels and trajectories.

Lengths are metres in the frame of the region.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from missions.geo.trajectory import Piece, Trajectory
from missions.planning.kernels import swath as kernels
from missions.planning.sweep.paths import Floats, Kinematics, Route, Tuning

FULL_RATE_S: Final = 20.0
"""Time ahead beyond which frames are counted by twos, s."""


def path_of(
    team: kernels.Team, ways: kernels.Ways, k: int, begin_s: float
) -> tuple[Trajectory, Route]:
    """Return the path through the waypoints of vehicle `k`, and its route with the ways passed."""
    room, way, count = kernels.new_room(), ways.points[k], int(ways.counts[k])
    n, segments, _ = kernels.fly(team, k, ways.choices[k], way, count, room)
    path = trajectory_of(room.segs[:segments], begin_s, team.starts[k, kernels.LEADS - 1])
    ends_m = np.cumsum(room.pieces[:n, kernels.P_LENGTH])
    passed = tuple(float(ends_m[min(int(i), n - 1)]) if n else 0.0 for i in room.reached[:count])
    return path, Route(tuple((float(x), float(y), float(c)) for x, y, c in way[:count]), passed)


@dataclass(frozen=True, slots=True)
class PlaceOnPath:
    """The place of a vehicle on its path."""

    piece: int
    into_m: float
    along_m: float
    speed_m_s: float
    x_m: float
    y_m: float


def within(path: Trajectory, t_s: float) -> PlaceOnPath | None:
    """Return the place of a vehicle on its path at a time; None after its end."""
    if t_s >= path.end_s or not path.pieces:
        return None
    along_m = 0.0
    for index, piece in enumerate(path.pieces):
        ends_s = piece.begin_s + piece.duration_s
        if t_s < ends_s or index == len(path.pieces) - 1:
            dt_s = min(max(t_s - piece.begin_s, 0.0), piece.duration_s)
            into_m = piece.distance_m(dt_s)
            found = piece.after(dt_s)
            speed = piece.speed_m_s + piece.accel_m_s2 * dt_s
            return PlaceOnPath(
                index, into_m, along_m + into_m, max(0.0, speed), found.east_m, found.north_m
            )
        along_m += piece.length_m
    return None


def ahead(route: Route, along_m: float) -> list[tuple[float, float, float]]:
    """Return the waypoints from `along_m` on, without the end."""
    pairs = zip(route.waypoints[:-1], route.passed_m[:-1], strict=True)
    return [point for point, passed_m in pairs if passed_m >= along_m]


def geometry(path: Trajectory, speed_m_s: float) -> Floats:
    """Return the pieces of a path as rows of the kernels; lines may be flown at full speed."""
    rows = [
        (
            p.east_m, p.north_m, p.heading_rad, p.curvature_1_m, p.length_m,
            p.speed_m_s if p.curvature_1_m else speed_m_s, speed_m_s,
        )
        for p in path.pieces
    ]  # fmt: skip
    return np.array(rows, dtype=np.float64).reshape(-1, kernels.PIECE)


def segments_of(path: Trajectory) -> Floats:
    """Return the profile of a path as rows of the kernels, times from its beginning."""
    rows = [
        (
            p.begin_s - path.begin_s, p.east_m, p.north_m, p.heading_rad, p.curvature_1_m,
            p.speed_m_s, p.accel_m_s2, math.cos(p.heading_rad), math.sin(p.heading_rad),
        )
        for p in path.pieces
    ]  # fmt: skip
    return np.array(rows, dtype=np.float64).reshape(-1, kernels.SEGMENT)


def trajectory_of(segments: Floats, begin_s: float, place: Floats) -> Trajectory:
    """Return a path from its profile; without any motion it stays at `place`."""
    if not len(segments):
        here = Piece(begin_s, 0.0, float(place[0]), float(place[1]), 0.0, 0.0, 0.0, 0.0)
        return Trajectory(begin_s, begin_s, (here,))
    starts = [float(s[kernels.S_T]) for s in segments]
    pieces = []
    for s, (t, until) in zip(segments, itertools.pairwise([*starts, math.nan]), strict=True):
        duration = until - t
        if math.isnan(duration):
            duration = _last_s(s)
        pieces.append(
            Piece(
                begin_s + t, duration, float(s[kernels.S_X]), float(s[kernels.S_Y]),
                float(s[kernels.S_HEADING]), float(s[kernels.S_CURVE]), float(s[kernels.S_V]),
                float(s[kernels.S_A]),
            )
        )  # fmt: skip
    last = pieces[-1]
    return Trajectory(begin_s, last.begin_s + last.duration_s, tuple(pieces))


def _last_s(segment: Floats) -> float:
    slows = -float(segment[kernels.S_A])
    return float(segment[kernels.S_V]) / slows if slows > 0.0 else 0.0


def row_of(flown: Kinematics, tuning: Tuning, next_frame_s: float) -> Floats:
    """Return the kinematics and view of a vehicle in the form of the kernels."""
    row = np.zeros(kernels.PARAMETERS)
    row[kernels.FADE_1_S] = tuning.fade_1_s
    row[kernels.SPEED], row[kernels.ACCEL] = flown.speed_m_s, flown.accel_m_s2
    row[kernels.CUT], row[kernels.TURN_V] = tuning.cut_m, tuning.turn_m_s
    row[kernels.FRAME_S], row[kernels.NEXT_FRAME_S] = flown.frame_s, next_frame_s
    row[kernels.FULL_RATE_S] = FULL_RATE_S
    row[kernels.HALF_X], row[kernels.HALF_Y] = flown.half_east_m, flown.half_north_m
    row[kernels.TILT], row[kernels.DRAG] = flown.tilt_m_s2, flown.drag_1_s
    row[kernels.WIND_X], row[kernels.WIND_Y] = flown.wind_east_m_s, flown.wind_north_m_s
    return row
