"""Cells at the rim of the region that the map adds to those that votes have elected.

The first few votes on a cell decide where the exploration goes on. They come within a second from
one vehicle, so they all err alike by the error of its pose, and a cell of which half is region may
be voted down. When a flight is over, all frames that were taken in passing have shown their shares
of the cell: from other sides, at other times, by other vehicles. Their mean decides about cells
beside the region, and allows for what an error of the pose hides.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from missions.events import Event, FrameSeen
from missions.mapping.belief import Belief
from missions.units import Cell

_STEPS: Final = 1000  # shares have three digits; whole numbers add up alike in any order


def rim_cells(events: Iterable[Event], belief: Belief, share: float) -> list[Cell]:
    """Return the cells that a belief decided against, and that all frames show to be region.

    Such a cell lies beside a cell of the region, and all four beside it are decided, so that the
    region is as explored with it as without. Frames from the height of a search do not count.

    Args:
        events: The journal of a flight.
        belief: What its votes have decided.
        share: Least mean of the shares of a cell that frames in passing showed, 0 to 1.
    """
    asked = {near for cell in belief.roi for near in cell.neighbours()}
    asked = {cell for cell in asked if belief.verdict(cell) is False and _is_enclosed(belief, cell)}
    shown: dict[Cell, dict[tuple[int, float], int]] = {}
    for event in events:
        if isinstance(event, FrameSeen) and event.vantage is None and not event.overview:
            for vote in event.votes:
                if vote.cell in asked:
                    frames = shown.setdefault(vote.cell, {})
                    frames[event.vehicle, event.t_s] = round(vote.share * _STEPS)
    return sorted(
        cell
        for cell, shares in shown.items()
        if len(shares) >= belief.frames and sum(shares.values()) >= share * _STEPS * len(shares)
    )


def _is_enclosed(belief: Belief, cell: Cell) -> bool:
    """Return whether all four cells beside a cell are decided."""
    return all(belief.verdict(near) is not None for near in cell.neighbours())
