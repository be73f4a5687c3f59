"""Over which cell of its own map an aircraft is, by the verdicts of its frames alone.

For ground without texture, where only the region's boundary is to be seen: each frame says of the
cell below and of its neighbours whether they are region. What fits the cells decided so far, look
after look, is where the aircraft can be.

    belief = anywhere(decided, told, reach=4)
    belief = looked(belief, verdicts, told, Noise(0.05, 0.05))
    belief = looked(belief.moved(1, 0, slip=0.05), verdicts, told, Noise(0.05, 0.05))
    off_by(belief, told)
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from missions.errors import LocalizationError
from missions.lab.localization.belief import Belief, Noise
from missions.lab.localization.grid_map import GridMap
from missions.lab.localization.neighbourhood import RING
from missions.units import Cell


def anywhere(decided: Mapping[Cell, bool], told: Cell, reach: int) -> Belief:
    """It may be over any cell within reach of the told one whose neighbours are decided.

    Args:
        decided: Of each decided cell, whether it is region.
        told: The cell over which the told position is.
        reach: By how many cells that may be off, east or north, at least 1.

    Raises:
        LocalizationError: nothing near is decided.
    """
    near = {
        cell
        for cell in decided
        if all(Cell(cell.east + e, cell.north + n) in decided for e, n in RING)
    }
    begin = {c for c in near if max(abs(c.east - told.east), abs(c.north - told.north)) <= reach}
    if not begin:
        raise LocalizationError(
            f"nothing is decided within {reach} cells of cell ({told.east}, {told.north}): there "
            "is no map to be found on"
        )
    # it may fly on from where it can be now to all that hangs together with that
    places = _together(near, begin)
    known = GridMap.of({cell for cell, region in decided.items() if region}, places)
    mass = np.array([float(cell in begin) for cell in known.cells])
    return Belief(known, mass / mass.sum())


def _together(places: Collection[Cell], begin: Collection[Cell]) -> set[Cell]:
    """Of the parts that hang together by edges, the one with most of the beginnings."""
    left, best = set(places), set[Cell]()
    while left:
        part = {min(left)}
        edge = set(part)
        while edge:
            edge = {n for cell in edge for n in cell.neighbours() if n in left} - part
            part |= edge
        left -= part
        best = max(best, part, key=lambda p: len(p.intersection(begin)))
    return best


def looked(belief: Belief, verdicts: Mapping[Cell, bool], told: Cell, noise: Noise) -> Belief:
    """The belief after a frame.

    Args:
        belief: Before it.
        verdicts: Of the frame, on cells as the told position has them.
        told: The cell over which the told position is.
        noise: How often a verdict is wrong.

    Raises:
        LocalizationError: no place fits.
    """
    ring = [Cell(told.east + de, told.north + dn) for de, dn in RING]
    seen = sum(1 << i for i, cell in enumerate(ring) if verdicts.get(cell, False))
    judged = sum(1 << i for i, cell in enumerate(ring) if cell in verdicts)
    return belief.saw(seen, noise, judged=judged, own=verdicts.get(told))


def off_by(belief: Belief, told: Cell, confidence: float = 0.95) -> tuple[int, int] | None:
    """By how many cells the told one is too far east and north; None where that is uncertain.

    >>> row = {Cell(e, n): e >= 2 for e in range(6) for n in range(3)}
    >>> off_by(anywhere(row, Cell(2, 1), 3), Cell(2, 1)) is None
    True
    """
    if belief.confidence < confidence:
        return None
    return told.east - belief.best.east, told.north - belief.best.north
