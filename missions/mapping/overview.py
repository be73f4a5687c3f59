"""What is plain from on high: cells that frames of a search decide for good.

What a frame from the height of a search (an *overview*) shows is coarse, so its votes are kept
apart. A cell is *plain* when the overview has decided it and all eight around it alike: then its
votes count as any others, and no vehicle flies there again. All else, which is what lies along
outlines, is observed from below. If each vote is wrong with probability e, independently of the
others, three of five are with 10 e^3 at most: a patch or a hole of a single cell is taken for plain
ground so often, which is the chance of any verdict. Amid nine cells that are alike in truth, all
nine have to be wrong at once.
"""

from __future__ import annotations

from collections.abc import Collection, Container, Mapping

from missions.mapping.belief import Belief, FrameId
from missions.units import Cell


def with_plain(
    belief: Belief,
    overview: Belief,
    box: Container[Cell],
    fresh: Collection[Cell],
) -> Belief:
    """Return `belief` with the votes on cells that are plain since `fresh` ones got votes.

    What was decided from below stays as it is. Beyond the
    `box` nobody searches: there a cell that no overview shows stands in the way of region only,
    which may go on there.
    """
    found: dict[FrameId, dict[Cell, bool]] = {}
    verdicts, ballots = overview.verdicts, overview.open_ballots
    decided = (cell for cell in fresh if verdicts.get(cell) is not None)
    for cell in belief.undecided(sorted({near for one in decided for near in _around(one)})):
        if _is_plain(verdicts, box, cell):
            for frame, vote in ballots[cell]:
                found.setdefault(frame, {})[cell] = vote
    return belief.with_frames(None, dict(sorted(found.items()))) if found else belief


def _is_plain(verdicts: Mapping[Cell, bool | None], box: Container[Cell], cell: Cell) -> bool:
    verdict = verdicts.get(cell)
    if verdict is None:
        return False
    for near in _around(cell):
        other = verdicts.get(near)
        unseen = near not in verdicts and near not in box
        if other is not verdict and not (unseen and not verdict):
            return False
    return True


def _around(cell: Cell) -> list[Cell]:
    """A cell and the eight around it."""
    steps = (-1, 0, 1)
    return [Cell(cell.east + east, cell.north + north) for east in steps for north in steps]
