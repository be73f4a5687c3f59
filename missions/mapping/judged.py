"""Which frame judged each cell: the one after which its verdict stood.

It follows from the ballots alone, as verdicts do, so the order in which frames became known does
not change it.
"""

from __future__ import annotations

from missions.mapping.belief import Ballot, Belief, FrameId
from missions.units import Cell


def judging_frames(belief: Belief) -> dict[Cell, FrameId]:
    """The frame that decided each cell; a cell that is not decided is absent.

    A cell of the region is decided when the first of its ballots elects it, any other one when its
    open ballot is decided against it, or a ballot of a look at it is full and does not elect it.

    >>> belief, here, beside = Belief(frames=3, positive=2), Cell(0, 0), Cell(0, 1)
    >>> for t_s in (0.0, 1.0, 2.0):
    ...     said = {here: True, beside: t_s > 1.0}
    ...     belief = belief.with_frame(None, FrameId(1, t_s), said)
    >>> {cell: frame.t_s for cell, frame in judging_frames(belief).items()}
    {Cell(east=0, north=1): 1.0, Cell(east=0, north=0): 1.0}
    """
    region: dict[Cell, FrameId] = {}
    others: dict[Cell, FrameId] = {}
    for vantage, ballots in belief.ballots.items():
        for cell, ballot in ballots.items():
            found = _spoken(belief, ballot, is_open=vantage is None)
            if found is not None:
                elected, frame = found
                told = region if elected else others
                told[cell] = min(frame, told.get(cell, frame), key=lambda each: each.exposed)
    return {**others, **region}


def _spoken(belief: Belief, ballot: Ballot, *, is_open: bool) -> tuple[bool, FrameId] | None:
    """What a ballot says and by which frame; None while it says nothing.

    A look goes on until it has all of its frames, so one against a cell counts when it is full.
    """
    positive = 0
    for count, (frame, vote) in enumerate(ballot, start=1):
        positive += vote
        if positive >= belief.positive:
            return True, frame
        lost = positive + belief.frames - count < belief.positive
        if lost and (is_open or count == belief.frames):
            return False, frame
    return None
