"""The cheapest assignment of rows to columns: the Hungarian method.

Shortest augmenting paths with potentials (Kuhn 1955, Munkres 1957; in this form Jonker and
Volgenant 1987): O(rows^2 x columns).
"""

from __future__ import annotations

import math
from collections.abc import Sequence


def assign(costs: Sequence[Sequence[float]]) -> list[int]:
    """For every row a column of its own, so that the sum of the costs is least.

    There are at least as many columns as rows; costs are finite. Raises ValueError otherwise.

    >>> assign([[4.0, 1.0, 3.0], [2.0, 0.0, 5.0], [3.0, 2.0, 2.0]])
    [1, 0, 2]
    """
    rows, columns = len(costs), len(costs[0]) if costs else 0
    if rows > columns or any(len(row) != columns for row in costs):
        raise ValueError(f"{rows} rows need as many columns each at least, not {columns}")
    # row and column 0 are made up: the path to a free column starts there
    u, v = [0.0] * (rows + 1), [0.0] * (columns + 1)
    row_of = [0] * (columns + 1)
    for row in range(1, rows + 1):
        row_of[0] = row
        _augment(costs, u, v, row_of)
    chosen = [0] * rows
    for column in range(1, columns + 1):
        if row_of[column]:
            chosen[row_of[column] - 1] = column - 1
    return chosen


def _augment(
    costs: Sequence[Sequence[float]], u: list[float], v: list[float], row_of: list[int]
) -> None:
    """Give one more row a column, along the shortest path of changes (Dijkstra)."""
    columns = len(v) - 1
    least, before = [math.inf] * (columns + 1), [0] * (columns + 1)
    done = [False] * (columns + 1)
    column = 0
    while row_of[column]:
        done[column] = True
        row, nearest, gap = row_of[column], 0, math.inf
        for j in range(1, columns + 1):
            if done[j]:
                continue
            reduced = costs[row - 1][j - 1] - u[row] - v[j]
            if reduced < least[j]:
                least[j], before[j] = reduced, column
            if least[j] < gap:
                nearest, gap = j, least[j]
        if not nearest:
            raise ValueError("the costs of an assignment must be finite")
        for j in range(columns + 1):
            if done[j]:
                u[row_of[j]] += gap
                v[j] -= gap
            else:
                least[j] -= gap
        column = nearest
    while column:
        row_of[column] = row_of[before[column]]
        column = before[column]
