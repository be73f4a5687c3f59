"""Lower bounds in seconds for flight without stopping: what no team can beat, whatever it knows.

A vehicle is a point with |velocity| <= v and |acceleration| <= a (as vectors), at rest over the
start at first and at last. A frame shows a rectangle whose sides, F_x and F_y, lie along the grid;
a cell of edge w is seen when all of it is shown. Then the vehicle is within the cell's *view*, a
rectangle with the sides F_x - w and F_y - w around the cell's centre.

*Seconds of a way.* From rest to rest a way of length L takes at least L / v + v / a, and where
L < v^2 / a at least 2 sqrt(L / a): the speed changes by at most a. `least_s` is this.

*Far.* Let d be the distance from the start to the view of a needed cell, and u the direction of
its nearest point. The view is convex, so all of it lies at least d along u. Who sees the cell gets
that far: at the farthest point along u its speed along u is 0, so the way there takes at least
`least_s`(d), and so does the way back: T >= 2 `least_s`(d).

*Area.* The cells that a vehicle sees on a stretch of its way lie wholly in what the rectangle
sweeps on it. Sweeping along a line in the direction (cos, sin) for dL adds at most
(F_y |cos| + F_x |sin|) dL <= D dL with D = sqrt(F_x^2 + F_y^2), so a stretch of length L sweeps at
most F_x F_y + D L. Cells do not overlap. Hence k cells need L >= (k w^2 - F_x F_y) / D. All begin
over the same cell, whose rectangle is counted once: R vehicles that see N cells have together
N w^2 <= F_x F_y + D (L_1 + ... + L_R), and the longest way is at least
(N w^2 - F_x F_y) / (R D).

*Shells.* Of the N_d cells whose views are at least d from the start some vehicle sees
k >= ceil(N_d / R). It flies at least d before the first of them, at least d after the last, and
the stretch between has the length above: L >= 2 d + max(0, k w^2 - F_x F_y) / D.

The bound is the largest of these over all d. It does not use that a frame shows whole cells only at
certain places, nor how many frames a cell needs, so it is far from tight where cells are large.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

from missions.planning.sweep.planned_team import Kinematics
from missions.units import Cell


def least_s(length_m: float, speed_m_s: float, accel_m_s2: float) -> float:
    """The least time of a way from rest to rest, seconds."""
    if length_m < speed_m_s**2 / accel_m_s2:
        return 2.0 * math.sqrt(length_m / accel_m_s2)
    return length_m / speed_m_s + speed_m_s / accel_m_s2


def lower_bound_s(
    needed: Collection[Cell], start: Cell, robots: int, cell_m: float, kinematics: Kinematics
) -> float:
    """The least seconds of the last vehicle; the module has the proof.

    All cells of `needed` are seen whole, by 1 or more vehicles that begin and end over the centre
    of `start`. The camera does not tilt.
    """
    speed, accel = kinematics.speed_m_s, kinematics.accel_m_s2
    frame_x = 2.0 * kinematics.half_east_m + cell_m
    frame_y = 2.0 * kinematics.half_north_m + cell_m
    diagonal = math.hypot(frame_x, frame_y)

    def swept_m(cells: float) -> float:
        return max(0.0, cells * cell_m**2 - frame_x * frame_y) / diagonal

    views_m = view_distances_m(needed, start, cell_m, kinematics)
    if not views_m:
        return 0.0
    length_m = swept_m(len(views_m)) / robots
    for nearer, distance_m in enumerate(views_m):
        share = -(-(len(views_m) - nearer) // robots)
        length_m = max(length_m, 2.0 * distance_m + swept_m(share))
    return max(least_s(length_m, speed, accel), 2.0 * least_s(views_m[-1], speed, accel))


def view_distances_m(
    needed: Collection[Cell], start: Cell, cell_m: float, kinematics: Kinematics
) -> Sequence[float]:
    """Distances from the start to the view of each needed cell, m, ascending.

    >>> kinematics = Kinematics(6.0, 2.0, 0.2, half_east_m=5.0, half_north_m=5.0)
    >>> view_distances_m([Cell(0, 0), Cell(2, 0)], Cell(0, 0), 4.0, kinematics)
    [0.0, 3.0]
    """
    return sorted(
        math.hypot(
            max(0.0, abs(cell.east - start.east) * cell_m - kinematics.half_east_m),
            max(0.0, abs(cell.north - start.north) * cell_m - kinematics.half_north_m),
        )
        for cell in needed
    )
