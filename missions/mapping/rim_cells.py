"""Cells at the edge of the region that the map adds to those that votes have elected.

The first few votes on a cell decide where the exploration continues. They come within a second from
one vehicle, so they all err alike by the error of its pose. A cell of which half is region may be
voted down. When a flight is over, all frames in passing have shown their shares of the cell. They
are from other sides, times and vehicles. Their mean decides on cells beside the region, and allows
for errors of the pose.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from missions.events import Event, FrameSeen
from missions.mapping.belief import Belief
from missions.units import Cell

_STEPS: Final = 1000  # shares have three digits; whole numbers add up alike in any order


def rim_verdicts(events: Iterable[Event], belief: Belief, share: float) -> dict[Cell, bool]:
    """Return the cells at the edge of the region that votes left out although they are region.

    Such a cell lies beside a cell of the region, and votes decided against it. All four cells
    beside it are decided, or frames show them to be no region. In the second case their verdicts
    are returned as well, and the region is as explored with the cell as without. Frames from search
    height do not count.

    Args:
        events: The journal of a flight.
        belief: The verdicts by its votes.
        share: Minimum mean of the shares of a cell that frames in passing showed, 0 to 1.
    """
    asked = {near for cell in belief.roi for near in cell.neighbours()}
    asked = {cell for cell in asked if belief.verdict(cell) is False}
    around = {near for cell in asked for near in cell.neighbours()}
    undecided = {cell for cell in around if belief.verdict(cell) is None}
    shown: dict[Cell, dict[tuple[int, float], int]] = {}
    for event in events:
        if isinstance(event, FrameSeen) and is_in_passing(event):
            for vote in event.votes:
                if vote.cell in asked or vote.cell in undecided:
                    frames = shown.setdefault(vote.cell, {})
                    frames[event.vehicle, event.t_s] = round(vote.share * _STEPS)
    region = {
        cell
        for cell, shares in shown.items()
        if sum(shares.values()) >= share * _STEPS * len(shares)
    }
    ground = undecided & (shown.keys() - region)
    open_ = undecided - ground
    verdicts: dict[Cell, bool] = {}
    for cell in sorted(asked & region):
        beside = cell.neighbours()
        if len(shown[cell]) >= belief.frames and open_.isdisjoint(beside):
            verdicts |= {cell: True} | dict.fromkeys(ground.intersection(beside), False)
    return verdicts


def is_in_passing(event: FrameSeen) -> bool:
    """Return whether a frame was taken without a stop, and not from search height."""
    return event.vantage is None and not event.overview
