"""Checks of a path without a stop against the fence, at the time when it is flown."""

from __future__ import annotations

import itertools
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import LineString, Point

from missions.geo.braking import cut_short
from missions.geo.fence import Fence
from missions.geo.trajectory import Trajectory
from missions.units import GridPoint

ROUNDING_M: Final = 0.02
"""Distance by which a path along the edge of the margin may miss it, m."""
OUTSIDE_M: Final = 1.0
"""Distance outside the margin at which a path may begin, m: a gust may move a vehicle."""
INSIDE_S: Final = 4.0
"""Time in which such a path has to lead inside, on its way no farther out, s."""
BEFORE_S: Final = (4.0, 6.0, 9.0, 13.0)
"""Times before a path would leave the fence at which it may be braked, s; shortest first."""
WORTH_S: Final = 5.0
"""Minimum duration of a path, s."""
_STEP_S: Final = 0.25


def as_far_as_allowed(fence: Fence, path: Trajectory, accel_m_s2: float) -> Trajectory | None:
    """Return a path that is not allowed as a whole, braked before it would lead outside.

    New plans follow every other second, so only the next part of a path matters. Its last part is
    the planner's return path, past the columns around the pads: that is no reason to refuse the
    first part. None if the allowed part is too short.
    """
    places = _places(path)
    inside = _inside(fence, places)
    first = int(inside.argmax())
    if not inside[first] or inside[first:].all():
        return None
    step_s = (path.end_s - path.begin_s) / (len(places) - 1)
    leaves_s = path.begin_s + step_s * (first + int((~inside[first:]).argmax()))
    for before_s in BEFORE_S:
        if leaves_s - before_s < path.begin_s + WORTH_S:
            break
        short = cut_short(path, leaves_s - before_s, accel_m_s2)
        if allowed(fence, short):
            return short
    return None


def allowed(fence: Fence, path: Trajectory) -> bool:
    """Return whether the margin of the fence holds all of a path, at the time when it is flown.

    A vehicle may begin a little outside it if it goes inside from there, and no farther out.
    """
    places = _places(path)
    inside = _inside(fence, places)
    if not inside.any():
        return False
    first = int(inside.argmax())
    if first and not _comes_in(fence, places[: first + 1]):
        return False
    if not bool(inside[first:].all()):
        return False
    if first + 1 == len(places):
        return True
    line = LineString(places[first:])
    return bool(shapely.covers(fence.shrunk(-ROUNDING_M), line))


def _places(path: Trajectory) -> list[GridPoint]:
    steps = max(1, round((path.end_s - path.begin_s) / _STEP_S))
    return path.places(path.begin_s, path.end_s, steps)


def _inside(fence: Fence, places: list[GridPoint]) -> NDArray[np.bool_]:
    rim = fence.shrunk(-ROUNDING_M)
    return np.asarray(shapely.intersects_xy(rim, np.array(places)), dtype=np.bool_)


def _comes_in(fence: Fence, places: list[GridPoint]) -> bool:
    """Return whether a path that begins outside the margin goes straight in, inside the fence."""
    if len(places) * _STEP_S > INSIDE_S or not all(map(fence.contains, places)):
        return False
    out_m = [float(fence.inner.distance(Point(place))) for place in places]
    return out_m[0] <= OUTSIDE_M and all(
        after <= before + ROUNDING_M for before, after in itertools.pairwise(out_m)
    )


def is_outside(fence: Fence, place: GridPoint) -> bool:
    """Return whether a place is too far outside the margin for a path to begin there."""
    return not fence.inner.dwithin(Point(place), OUTSIDE_M)
