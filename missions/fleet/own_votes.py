"""Which votes of our own frames the others have to know.

The map is decided by the first `frames` votes on a cell, in the order of exposure, whoever cast
them (`missions.mapping.belief`). Once our own votes alone decide a cell, no later vote of ours can
matter, whatever others have seen: of the first five of all, those of others that come before ours
only push ours out from behind, and ours up to the one that decided it decide it in any company.
So only votes up to there are told: three of six to nine frames on most cells.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from missions.events import FrameSeen, SharedFrame
from missions.mapping.belief import Belief, FrameId
from missions.units import Cell


@dataclass(frozen=True, slots=True)
class OwnVotes:
    """The votes of our own frames so far, from the map's height and from that of a search."""

    low: Belief
    high: Belief

    @classmethod
    def none(cls, frames: int, positive: int) -> OwnVotes:
        """Before the first frame; the vote is `positive` of `frames`."""
        return cls(Belief(frames, positive), Belief(frames, positive))

    def with_frame(self, event: FrameSeen) -> tuple[OwnVotes, SharedFrame | None]:
        """These votes and a frame's, and what of it can count; None where nothing can.

        Raises ValueError for a frame of a look from a vantage, which a fleet does not fly.

        >>> from missions.events import Vote
        >>> own = OwnVotes.none(5, 3)
        >>> told = []
        >>> for t_s in range(6):
        ...     seen = FrameSeen(1, float(t_s), None, (Vote(Cell(0, 0), True, 1.0),))
        ...     own, fact = own.with_frame(seen)
        ...     told.append(fact is not None)
        >>> told
        [True, True, True, False, False, False]
        """
        if event.vantage is not None:
            raise ValueError("a frame from a vantage is no fact of a fleet")
        belief = self.high if event.overview else self.low
        frame = FrameId(event.vehicle, event.t_s)
        said = {vote.cell: vote.positive for vote in event.votes}
        counts = {cell: says for cell, says in said.items() if _may_count(belief, frame, cell)}
        if not counts:
            return self, None
        belief = belief.with_frame(None, frame, counts)
        after = replace(self, high=belief) if event.overview else replace(self, low=belief)
        return after, SharedFrame(event.t_s, tuple(sorted(counts.items())), bool(event.overview))


def _may_count(belief: Belief, frame: FrameId, cell: Cell) -> bool:
    if belief.verdict(cell) is None:
        return True
    return frame.exposed < belief.open_ballots[cell][-1][0].exposed
