"""Measurements of a vehicle at every call: progress, path, fence, height, and since when."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Final

import shapely
from shapely.geometry import LineString, Point
from shapely.ops import substring

from missions.guardian.guardian_state import Guard, Limits, Snapshot, Task
from missions.guardian.thresholds import (
    BEHIND_S,
    BEHIND_STEP_S,
    CARRIED_AWAY_M_S,
    CARRIED_AWAY_SHARE,
    FALLING_M_S,
    FENCE_LOOK_AHEAD_S,
    HEIGHT_LOST_M,
    HEIGHT_LOST_SHARE,
    MAX_CALL_GAP_S,
    OFF_PATH_M,
    OFF_PLAN_M,
    OFF_PLAN_WIND_S,
    PROGRESS_M,
    REACH_M,
    REACH_M_S,
    RECEDING_M_S,
    UP_M,
)
from missions.units import GridPoint

_REMEMBERED: Final = 32
"""Number of remembered paths of vehicles: each is needed many times during its flight."""


def near_height(task: Task, seen: Snapshot) -> bool:
    """Return whether a vehicle on a leg or in a hover has reached the height of its task."""
    return (
        task.doing in ("leg", "path", "hold") and seen.height_m >= task.height_m - HEIGHT_LOST_M / 2
    )


def falling(guard: Guard, seen: Snapshot) -> Guard:
    """Return the guard with the height, and with whether the vehicle falls."""
    fell = guard.fell
    if guard.last_s is not None and seen.t_s > guard.last_s:
        sink_m_s = (guard.amsl_m - seen.amsl_m) / (seen.t_s - guard.last_s)
        climbs = guard.task.doing == "climb" and not guard.hurries
        limit_m_s = FALLING_M_S / 2 if climbs else FALLING_M_S
        # above the sea: a home that moves makes no fall
        in_air = guard.was_up or seen.airborne
        fell = in_air and (sink_m_s > limit_m_s or (fell and sink_m_s > -UP_M))
    return replace(guard, amsl_m=seen.amsl_m, fell=fell)


def _goal(guard: Guard, seen: Snapshot, place: GridPoint | None) -> tuple[GridPoint, ...]:
    """Return the path that it should be on, its goal last; empty in a landing or on ground."""
    if guard.action == "rtl":
        return (seen.position, seen.home)
    if guard.action == "land" or guard.task.doing in ("land", "ground"):
        return ()
    return guard.task.path if place is None else (place,)


def planned(task: Task, seen: Snapshot) -> GridPoint | None:
    """Return the planned position by its course; None without a course."""
    return None if task.course is None else task.course.at(seen.t_s).place


def is_behind(guard: Guard, seen: Snapshot) -> bool:
    """Return whether a vehicle is where its path was a while ago, inside the fence.

    It is slower than planned against the wind, or got no setpoints for some seconds.
    """
    course = guard.task.course
    if course is None or guard.outside_m > 0.0:
        return False
    now_m = seen.position.distance_to(course.at(seen.t_s).place)
    allowed_m = off_plan_m(seen)
    steps = round(BEHIND_S / BEHIND_STEP_S)
    before_m = (
        seen.position.distance_to(course.at(seen.t_s - k * BEHIND_STEP_S).place)
        for k in range(1, steps + 1)
    )
    return any(gap_m <= min(allowed_m, now_m / 2.0) for gap_m in before_m)


def off_plan_m(seen: Snapshot) -> float:
    """Return the maximum distance from its planned position, m."""
    return OFF_PLAN_M + OFF_PLAN_WIND_S * (seen.wind_m_s or 0.0)


def measured(limits: Limits, guard: Guard, seen: Snapshot) -> Guard:
    """Return the guard with new distances to the goal, the path and the fence."""
    task = guard.task
    place = None if guard.action else planned(task, seen)
    path = _goal(guard, seen, place)
    fence, here = limits.fence, seen.position
    outside_m = 0.0 if fence.contains(here) else float(fence.outer.distance(Point(here)))
    guard = replace(
        guard,
        outside_m=outside_m,
        leaves_fence=outside_m > 0.0 or not fence.contains(_soon(guard, seen)),
        outside_since_s=since(guard.outside_since_s, outside_m > 0.0, seen.t_s),
    )
    swept_m_s = max(CARRIED_AWAY_M_S, CARRIED_AWAY_SHARE * limits.energy.speed_m_s)
    if guard.landing:  # straight down: any motion is away
        swept = _speed_m_s(guard, seen) > swept_m_s and not seen.slews
        guard = replace(guard, swept_since_s=since(guard.swept_since_s, swept, seen.t_s))
    if not path:
        return replace(guard, last_gap_m=None, receding_since_s=None, off_since_s=None)
    along_m = 0.0 if guard.action == "rtl" else _along_m(guard, seen, path)
    gap_m = _left_m(seen.position, path, along_m)
    if place is not None and guard.last_position is not None:
        # the place moves on: only the vehicle's own motion counts
        guard = replace(guard, last_gap_m=guard.last_position.distance_to(place))
    # a new order does not stop it; after a long gap its motion is unknown
    recent = guard.last_s is None or seen.t_s - guard.last_s <= MAX_CALL_GAP_S
    receding = guard.receding_since_s is not None and recent
    swept = guard.swept_since_s is not None and recent
    away_m_s = _away_m_s(guard, seen, guard.last_gap_m, gap_m)
    if away_m_s is not None:
        receding = away_m_s > RECEDING_M_S
        swept = away_m_s > swept_m_s
    elif guard.last_position is not None and guard.action is None:
        # orders may follow faster than calls: the motion before the new one counts
        before_m = _left_m(guard.last_position, path, 0.0)
        swept = swept or (_away_m_s(guard, seen, before_m, gap_m) or 0.0) > swept_m_s
    swept = swept and not seen.slews
    progressed = gap_m <= guard.best_m - PROGRESS_M or guard.best_m == float("inf")
    drifted_m = task.drift_m_s * (seen.t_s - task.since_s)
    allowed_m = OFF_PATH_M + drifted_m if place is None else off_plan_m(seen)
    off = guard.action is None and off_path_m(seen.position, path) > allowed_m
    sunk = seen.height_m < task.height_m - max(HEIGHT_LOST_M, HEIGHT_LOST_SHARE * task.height_m)
    return replace(
        guard,
        along_m=along_m,
        best_m=gap_m if progressed else guard.best_m,
        best_s=seen.t_s if progressed else guard.best_s,
        last_gap_m=gap_m,
        receding_since_s=since(guard.receding_since_s, receding, seen.t_s),
        swept_since_s=since(guard.swept_since_s, swept, seen.t_s),
        off_since_s=since(guard.off_since_s, off, seen.t_s),
        sunk_since_s=since(
            guard.sunk_since_s, guard.action is None and guard.at_height and sunk, seen.t_s
        ),
    )


def _soon(guard: Guard, seen: Snapshot) -> GridPoint:
    """Return its position in `FENCE_LOOK_AHEAD_S` at its motion since the last call."""
    before = guard.last_position
    if before is None or guard.last_s is None or seen.t_s <= guard.last_s:
        return seen.position
    share = FENCE_LOOK_AHEAD_S / (seen.t_s - guard.last_s)
    east_m, north_m = seen.position
    return GridPoint(
        east_m + share * (east_m - before.east_m), north_m + share * (north_m - before.north_m)
    )


def _away_m_s(guard: Guard, seen: Snapshot, before_m: float | None, gap_m: float) -> float | None:
    """Return the growth of the way to the goal since the last call, m/s; None if not known."""
    if before_m is None or guard.last_s is None or seen.t_s <= guard.last_s:
        return None
    return (gap_m - before_m) / (seen.t_s - guard.last_s)


def _speed_m_s(guard: Guard, seen: Snapshot) -> float:
    """Return its speed over ground since the last call, m/s; 0 at the first."""
    if guard.last_position is None:
        return 0.0
    moved_m = guard.last_position.distance_to(seen.position)
    return _away_m_s(guard, seen, 0.0, moved_m) or 0.0


def since(since_s: float | None, holds: bool, t_s: float) -> float | None:
    """Return the time since which something holds, mission seconds; None while it does not.

    >>> since(None, True, 7.0), since(5.0, True, 7.0), since(5.0, False, 7.0)
    (7.0, 5.0, None)
    """
    if not holds:
        return None
    return t_s if since_s is None else since_s


def lasted(limits: Limits, since_s: float | None, t_s: float, limit_s: float) -> bool:
    """Return whether something has held for `limit_s` seconds and the slack of a fast clock."""
    return since_s is not None and t_s - since_s >= limit_s + limits.slack_s


@lru_cache(maxsize=_REMEMBERED)
def _line(path: tuple[GridPoint, ...]) -> LineString | None:
    return LineString(path) if len(set(path)) > 1 else None


def _along_m(guard: Guard, seen: Snapshot, path: Sequence[GridPoint]) -> float:
    """Return the distance along its path, m, near the last one: a path may cross itself."""
    line = _line(tuple(path))
    if line is None:
        return 0.0
    elapsed_s = seen.t_s - (guard.last_s if guard.last_s is not None else guard.task.since_s)
    begin_m = max(guard.along_m - REACH_M, 0.0)
    end_m = min(guard.along_m + REACH_M + REACH_M_S * max(elapsed_s, 0.0), float(line.length))
    here = Point(seen.position)
    near = begin_m + float(substring(line, begin_m, end_m).project(here))
    within_m = float(line.interpolate(near).distance(here)) + REACH_M / 2
    # where the path turns back on itself, the farther of two places is more likely
    places, ahead, step_m = [], near, REACH_M / 5
    while ahead + step_m <= end_m:
        ahead += step_m
        places.append(ahead)
    if not places:
        return near
    reached = shapely.distance(shapely.line_interpolate_point(line, places), here) <= within_m
    return next((place for place, ok in zip(places[::-1], reached[::-1], strict=True) if ok), near)


def _left_m(position: GridPoint, path: Sequence[GridPoint], along_m: float) -> float:
    """Return the distance to the end of a path, m: back to it, then along the rest."""
    line = _line(tuple(path))
    if line is None:
        return position.distance_to(path[-1])
    return float(line.length) - along_m + float(line.interpolate(along_m).distance(Point(position)))


def off_path_m(position: GridPoint, path: Sequence[GridPoint]) -> float:
    """Return the distance of a place from a path of one or more points, on the ground, m.

    >>> off_path_m(GridPoint(5.0, 3.0), (GridPoint(0.0, 0.0), GridPoint(10.0, 0.0)))
    3.0
    """
    line = _line(tuple(path))
    way = Point(path[0]) if line is None else line
    return float(way.distance(Point(position)))
