"""What Algorithm 1 promises, in moves and in seconds."""

from __future__ import annotations

import math


def rdfs_bound_moves(cells: int, depth: int, robots: int) -> float:
    """Upper bound on the makespan of Algorithm 1 in moves.

    Lemma 1 of Sung and Tokekar with its equation (5), for unit speed and a resting ROI:
    2 (C - 1 + depth_T floor(log2 R)) / (1 + floor(log2 R)).

    >>> rdfs_bound_moves(cells=120, depth=20, robots=1)
    238.0
    """
    log_robots = math.floor(math.log2(robots))
    return 2.0 * (cells - 1 + depth * log_robots) / (1 + log_robots)


def drift_factor(speed_m_s: float, drift_speed_m_s: float) -> float:
    """By how much a drift lengthens a closed tour, at worst.

    A move and its way back cost 1 / (Sr - Sp) + 1 / (Sr + Sp) = 2 Sr / (Sr^2 - Sp^2) instead of
    2 / Sr: the factor is Sr^2 / (Sr^2 - Sp^2).

    >>> drift_factor(5.0, 0.0)
    1.0
    """
    return speed_m_s**2 / (speed_m_s**2 - drift_speed_m_s**2)
