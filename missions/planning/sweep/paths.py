"""Paths as the kernels take them and as trajectories, one made of the other."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.geo.trajectory import Piece, Trajectory
from missions.planning.kernels import swath as kernels

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Route:
    """The waypoints of a path: (east, north, how far its corner may be cut); the last ends it."""

    waypoints: tuple[tuple[float, float, float], ...]
    passed_m: tuple[float, ...] = ()
    """How far along its path each is behind the vehicle."""


def path_of(
    team: kernels.Team, ways: kernels.Ways, k: int, begin_s: float
) -> tuple[Trajectory, Route]:
    """The path through the waypoints of vehicle `k`, and its route with the ways passed."""
    room, way, count = kernels.new_room(), ways.points[k], int(ways.counts[k])
    n, segments, _ = kernels.fly(team, k, ways.choices[k], way, count, room)
    path = trajectory_of(room.segs[:segments], begin_s, team.starts[k, kernels.LEADS - 1])
    ends_m = np.cumsum(room.pieces[:n, kernels.P_LENGTH])
    passed = tuple(float(ends_m[min(int(i), n - 1)]) if n else 0.0 for i in room.reached[:count])
    return path, Route(tuple((float(x), float(y), float(c)) for x, y, c in way[:count]), passed)


@dataclass(frozen=True, slots=True)
class Now:
    """The place of a vehicle on its path."""

    piece: int
    into_m: float
    along_m: float
    speed_m_s: float
    x_m: float
    y_m: float


def within(path: Trajectory, t_s: float) -> Now | None:
    """The place of a vehicle on its path at a time; None after its end."""
    if t_s >= path.end_s or not path.pieces:
        return None
    along_m = 0.0
    for index, piece in enumerate(path.pieces):
        ends_s = piece.begin_s + piece.duration_s
        if t_s < ends_s or index == len(path.pieces) - 1:
            dt_s = min(max(t_s - piece.begin_s, 0.0), piece.duration_s)
            into_m = piece.way_m(dt_s)
            found = piece.after(dt_s)
            speed = piece.speed_m_s + piece.accel_m_s2 * dt_s
            return Now(
                index, into_m, along_m + into_m, max(0.0, speed), found.east_m, found.north_m
            )
        along_m += piece.length_m
    return None


def ahead(route: Route, along_m: float) -> list[tuple[float, float, float]]:
    """The waypoints from `along_m` on, without the end."""
    pairs = zip(route.waypoints[:-1], route.passed_m[:-1], strict=True)
    return [point for point, passed_m in pairs if passed_m >= along_m]


def geometry(path: Trajectory, speed_m_s: float) -> Floats:
    """The pieces of a path as rows of the kernels; lines may be flown at full speed."""
    rows = [
        (
            p.east_m, p.north_m, p.heading_rad, p.curvature_1_m, p.length_m,
            p.speed_m_s if p.curvature_1_m else speed_m_s, speed_m_s,
        )
        for p in path.pieces
    ]  # fmt: skip
    return np.array(rows, dtype=np.float64).reshape(-1, kernels.PIECE)


def segments_of(path: Trajectory) -> Floats:
    """The profile of a path as rows of the kernels, times from its beginning."""
    rows = [
        (
            p.begin_s - path.begin_s, p.east_m, p.north_m, p.heading_rad, p.curvature_1_m,
            p.speed_m_s, p.accel_m_s2, math.cos(p.heading_rad), math.sin(p.heading_rad),
        )
        for p in path.pieces
    ]  # fmt: skip
    return np.array(rows, dtype=np.float64).reshape(-1, kernels.SEGMENT)


def trajectory_of(segments: Floats, begin_s: float, place: Floats) -> Trajectory:
    """A path from its profile; one without any motion stays at `place`."""
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
