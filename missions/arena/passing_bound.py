"""What no team that does not stop can beat once the region is found, from the ground it has seen.

The vehicles are anywhere and of any speed up to v when the region is found, and the bound speaks of
the time until the last of them has seen its last cell: nobody comes home in it. A camera that leans
with the airframe shows ground up to `lean_m` beside that of a level one. So all cells of a frame
lie in a rectangle around the vehicle with the sides F_x + 2 lean and F_y + 2 lean. What it sweeps
along a way of length L is at most its area and D L, D its diagonal (`missions.arena.time_bounds`),
so N cells of edge w that were first seen by R vehicles in B stretches each take together

    N w^2 <= (R + B) F_x' F_y' + D' (L_1 + ... + L_R)

and the longest way takes at least (N w^2 - (R + B) F_x' F_y') / (R D' v) seconds.
"""

from __future__ import annotations

import math


def passing_bound_s(
    cells: int,
    robots: int,
    breaks: int,
    cell_m: float,
    footprint_m: tuple[float, float],
    lean_m: float,
    speed_m_s: float,
) -> float:
    """Seconds that the last vehicle needs at least; see the module for the proof.

    Args:
        cells: that were seen for the first time.
        robots: how many vehicles, at least 1.
        breaks: how often one of them left off and came back, at least 0.
        cell_m: the edge of a cell, metres.
        footprint_m: the sides of the ground in a level picture, of the highest vehicle.
        lean_m: how far a lean shifts it at most.
        speed_m_s: of the fastest vehicle, above 0.

    >>> round(passing_bound_s(400, 1, 0, 4.0, (20.0, 15.0), 0.0, 6.0), 1)
    40.7
    """
    east_m, north_m = footprint_m[0] + 2.0 * lean_m, footprint_m[1] + 2.0 * lean_m
    left_m2 = cells * cell_m**2 - (robots + breaks) * east_m * north_m
    return max(0.0, left_m2) / (robots * math.hypot(east_m, north_m) * speed_m_s)
