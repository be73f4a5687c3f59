"""What no team that does not stop can beat once the region is found, from the ground it has seen.

The vehicles are anywhere and of any speed up to v when the region is found, and the bound speaks of
the time until the last of them has seen its last cell: nobody comes home in it. A camera that leans
with the airframe shows ground up to `lean_m` beside that of a level one. So all cells of a frame
lie in a rectangle around the vehicle with the sides F_x + 2 lean and F_y + 2 lean. What it sweeps
along a way of length L is at most its area and D L, D its diagonal (`time_bounds`),
so N cells of edge w that were first seen by R vehicles in B stretches each take together

    N w^2 <= (R + B) F_x' F_y' + D' (L_1 + ... + L_R)

and the longest way takes at least (N w^2 - (R + B) F_x' F_y') / (R D' v) seconds.

Where the picture may lie at any angle to the grid, and turn on the way, all that it shows lies in
the circle of the diameter D' around it, which sweeps no more than its area and D' L, too: then
pi D'^2 / 4 takes the place of F_x' F_y'.
"""

from __future__ import annotations

import math


def passing_bound_s(
    ground_m2: float,
    robots: int,
    breaks: int,
    footprint_m: tuple[float, float],
    lean_m: float,
    speed_m_s: float,
    *,
    turned: bool = False,
) -> float:
    """Seconds that the last vehicle needs at least; see the module for the proof.

    Args:
        ground_m2: what was seen for the first time, N w^2.
        robots: how many vehicles, at least 1.
        breaks: how often one of them left off and came back, at least 0.
        footprint_m: the sides of the ground in a level picture, of the highest vehicle.
        lean_m: how far a lean shifts it at most.
        speed_m_s: of the fastest vehicle, above 0.
        turned: whether pictures lie at any angle to the grid.

    >>> round(passing_bound_s(6400.0, 1, 0, (20.0, 15.0), 0.0, 6.0), 1)
    40.7
    >>> round(passing_bound_s(6400.0, 1, 0, (20.0, 15.0), 0.0, 6.0, turned=True), 1)
    39.4
    """
    east_m, north_m = footprint_m[0] + 2.0 * lean_m, footprint_m[1] + 2.0 * lean_m
    diagonal_m = math.hypot(east_m, north_m)
    at_once_m2 = math.pi * diagonal_m**2 / 4.0 if turned else east_m * north_m
    left_m2 = ground_m2 - (robots + breaks) * at_once_m2
    return max(0.0, left_m2) / (robots * diagonal_m * speed_m_s)
