"""Localization with a map and without errors: the cells that fit all that was sensed (section 9).

Candidates are numbers of cells of a `GridMap`, ascending. There is always one: the true one.
"""

from __future__ import annotations

from missions.lab.localization.grid_map import GridMap

Candidates = tuple[int, ...]


def first_candidates(known: GridMap, pattern: int) -> Candidates:
    """Where a robot may be that senses a pattern.

    >>> from missions.units import Cell
    >>> corridor = GridMap.of({Cell(i, 0) for i in range(5)})
    >>> first_candidates(corridor, corridor.patterns[1])
    (1, 2, 3)
    """
    return known.alike.get(pattern, ())


def candidates_after(
    known: GridMap, candidates: Candidates, direction: int, pattern: int
) -> Candidates:
    """Where it may be after a move, and sensing a pattern there.

    >>> from missions.units import Cell
    >>> corridor = GridMap.of({Cell(i, 0) for i in range(5)})
    >>> candidates_after(corridor, (1, 2, 3), 1, corridor.patterns[0])
    (0,)
    """
    step, patterns = known.steps[direction], known.patterns
    return tuple(
        there for here in candidates if (there := step[here]) >= 0 and patterns[there] == pattern
    )


def split(known: GridMap, candidates: Candidates, direction: int) -> list[Candidates]:
    """What a move makes of candidates: the groups in which the same is sensed afterwards.

    >>> from missions.units import Cell
    >>> corridor = GridMap.of({Cell(i, 0) for i in range(5)})
    >>> split(corridor, (1, 2, 3), 1)
    [(0,), (1, 2)]
    """
    step, patterns = known.steps[direction], known.patterns
    groups: dict[int, list[int]] = {}
    for here in candidates:
        there = step[here]
        groups.setdefault(patterns[there], []).append(there)
    return [tuple(group) for group in groups.values()]
