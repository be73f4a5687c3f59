"""Cells at the rim: the mean of all frames, once the first votes have decided."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from missions.events import FrameSeen, Vote
from missions.mapping.belief import Belief, FrameId, judging_frames
from missions.mapping.rim_cells import rim_verdicts
from missions.units import Cell

RIM, LAST_S = Cell(1, 0), 9.0
SHARE, LEAST = 0.3, 0.15


def frames(rim: Sequence[float], *, unseen: Cell | None = None, overview: bool = False):
    """Return frames of five by three cells; the west is region, `rim` the share of one cell."""
    made = []
    for number, share in enumerate(rim):
        shares = {
            Cell(east, north): float(east < 1) for east in range(-1, 4) for north in (-1, 0, 1)
        }
        shares[RIM] = share
        votes = [Vote(c, s >= SHARE, s) for c, s in shares.items() if c != unseen]
        high = True if overview else None
        made.append(FrameSeen(1, float(number), None, tuple(votes), overview=high))
    return made


def belief_of(events: Sequence[FrameSeen]) -> Belief:
    belief = Belief(frames=5, positive=3)
    for event in events:
        verdicts = {vote.cell: vote.positive for vote in event.votes}
        belief = belief.with_frame(None, FrameId(event.vehicle, event.t_s), verdicts)
    return belief


@pytest.mark.parametrize(
    ("rim", "expected"),
    [
        ([0.2] * 5, {RIM: True}),
        ([0.1] * 5 + [0.4] * 5, {RIM: True}),
        ([0.1] * 5, {}),
        ([0.2] * 5 + [0.0] * 5, {}),
    ],
)
def test_rim_cell_is_region_by_the_mean_of_all_that_frames_showed(
    rim: Sequence[float], expected: dict[Cell, bool]
) -> None:
    events = frames(rim)
    belief = belief_of(events)
    assert belief.verdict(RIM) is False
    assert rim_verdicts(events, belief, LEAST) == expected
    assert rim_verdicts([*reversed(events), *events], belief, LEAST) == expected
    with_rim = belief.with_verdicts(expected)
    assert [cell for cell in with_rim.roi if cell not in belief.roi] == list(expected)
    assert with_rim.verdict(RIM) is bool(expected)


def test_rim_cell_with_an_undecided_cell_beside_it_stays_as_voted() -> None:
    events = frames([0.2] * 5, unseen=Cell(2, 0))
    assert rim_verdicts(events, belief_of(events), LEAST) == {}


@pytest.mark.parametrize(("share", "expected"), [(0.0, {RIM: True, Cell(2, 0): False}), (0.2, {})])
def test_rim_cell_beside_an_undecided_cell_that_frames_show(
    share: float, expected: dict[Cell, bool]
) -> None:
    beside = Cell(2, 0)
    events = frames([0.2] * 5, unseen=beside)
    votes = (Vote(beside, False, share), Vote(RIM, False, 0.2))
    events.append(FrameSeen(1, LAST_S, None, votes))
    belief = belief_of(events)
    assert belief.verdict(beside) is None
    assert rim_verdicts(events, belief, LEAST) == expected
    finished = judging_frames(belief.with_verdicts(expected))
    assert finished.get(beside) == (FrameId(1, LAST_S) if expected else None)


def test_rim_cell_that_frames_of_a_search_showed_stays_as_voted() -> None:
    events = frames([0.2] * 5)
    belief = belief_of(events)
    assert rim_verdicts(frames([0.2] * 5, overview=True), belief, LEAST) == {}


def test_rim_cell_needs_as_many_frames_as_a_ballot() -> None:
    events = frames([0.2] * 5)
    assert rim_verdicts(events[:4], belief_of(events), LEAST) == {}


def test_cell_that_lies_apart_from_the_region_stays_as_voted() -> None:
    events = frames([0.0] * 5)
    apart = [Vote(Cell(2, 0), False, 0.2)]
    seen = [FrameSeen(1, e.t_s, None, (*e.votes[:-1], *apart)) for e in events]
    assert rim_verdicts(seen, belief_of(events), LEAST) == {}
