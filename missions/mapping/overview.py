"""Plain cells: those that frames of a search decide for good from their height.

A frame from search height (an *overview*) is coarse, so its votes are kept apart. A cell is *plain*
when the overview has decided it and all eight around it alike. Then its votes count like others,
and no vehicle flies there again. Other cells, such as those along outlines, are observed from
below. If each vote is wrong with probability e, independently, three of five are wrong with 10 e^3
at most. This is the chance to miss a patch or a hole of a single cell, and the chance of any wrong
verdict. Amid nine cells that are alike, all nine have to be wrong at once.

A heading error moves them alike: one of 5 degrees moves an outline 60 m away by 5 m, so that it
lies in plain ground. From map height the same error moves it by 1 m. So when a flight is over, the
frames from below that show a plain cell decide on it in place of the overview (`from_below`).
"""

from __future__ import annotations

from collections.abc import Collection, Container, Mapping

from missions.mapping.belief import Belief, FrameId
from missions.mapping.persistent import PersistentMap
from missions.units import Cell


def with_plain(
    belief: Belief,
    overview: Belief,
    box: Container[Cell],
    fresh: Collection[Cell],
) -> Belief:
    """Return `belief` with the votes on cells that are plain since `fresh` ones got votes.

    Decisions from below stay. No vehicle searches beyond the `box`: there a cell that no overview
    shows only prevents region, which may continue there.
    """
    found: dict[FrameId, dict[Cell, bool]] = {}
    verdicts, ballots = overview.verdicts, overview.open_ballots
    decided = (cell for cell in fresh if verdicts.get(cell) is not None)
    for cell in belief.undecided(sorted({near for one in decided for near in _around(one)})):
        if _is_plain(verdicts, box, cell):
            for frame, vote in ballots[cell]:
                found.setdefault(frame, {})[cell] = vote
    return belief.with_frames(None, dict(sorted(found.items()))) if found else belief


def from_below(belief: Belief, overview: Belief) -> dict[Cell, bool]:
    """Return the verdicts of frames from below on plain cells, where they differ from `belief`.

    A cell is added to the region only if the four cells beside it are decided: then the region is
    as explored as without it.

    Args:
        belief: The verdicts by all votes, including those on plain cells.
        overview: The verdicts by frames from search height.
    """
    high = overview.looks.get(None, PersistentMap()).as_dict()
    ballots = belief.open_ballots.items()
    plain = {cell for cell, votes in ballots if any(frame in high for frame, _ in votes)}
    below = Belief(belief.frames, belief.positive)
    if plain:
        low = {
            frame: {cell: says for cell, says in seen.items() if cell in plain}
            for frame, seen in belief.looks[None].items()
            if frame not in high
        }
        below = below.with_frames(None, low)
    found: dict[Cell, bool] = {}
    for cell, verdict in sorted(below.verdicts.items()):
        if verdict is None or verdict is belief.verdict(cell):
            continue
        if not verdict or not belief.undecided(cell.neighbours()):
            found[cell] = verdict
    return found


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
    """Return a cell and the eight around it."""
    steps = (-1, 0, 1)
    return [Cell(cell.east + east, cell.north + north) for east in steps for north in steps]
