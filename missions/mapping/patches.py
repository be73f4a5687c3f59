"""The patches of a region: cells that hang together by their edges."""

from __future__ import annotations

from collections.abc import Collection

from missions.units import Cell


def patches(cells: Collection[Cell]) -> tuple[frozenset[Cell], ...]:
    """The patches of some cells, the largest first; of equal ones that with the lowest cell.

    >>> found = patches([Cell(0, 0), Cell(5, 5), Cell(5, 6), Cell(1, 1)])
    >>> [sorted(patch)[0] for patch in found]
    [Cell(east=5, north=5), Cell(east=0, north=0), Cell(east=1, north=1)]
    """
    left = set(cells)
    found: list[frozenset[Cell]] = []
    while left:
        patch, asked = set(), [left.pop()]
        while asked:
            cell = asked.pop()
            patch.add(cell)
            near = [n for n in cell.neighbours() if n in left]
            left.difference_update(near)
            asked.extend(near)
        found.append(frozenset(patch))
    return tuple(sorted(found, key=lambda patch: (-len(patch), min(patch))))
