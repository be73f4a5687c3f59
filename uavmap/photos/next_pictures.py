"""Choice of the pictures to paint next: those that settle most of the unsure ground.

A painted picture settles its own ground, and similar ground elsewhere. So unsure ground is compared
by its features: places within `REACH` of a place in a picture count as settled by it. The choice
goes picture by picture: each is the best one besides those that are chosen already.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from missions.mapping.evidence import CellSums
from missions.mapping.frame_sums import FrameSums
from uavmap.base.atomic_write import write_text
from uavmap.photos.scratch_file import StoredJudgement

NEXT: Final = "next.txt"
REACH: Final = 2.5
"""Distance of standardised features within which ground looks alike."""
MOST: Final = 12
"""Maximum number of pictures that are named."""
LEAST: Final = 0.01
"""Minimum share of the unsure ground that a named picture settles."""
_PLACES: Final = 8000
_PEERS: Final = 3

Array = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class UnsureGround:
    """The unsure ground in a picture: features of some of its places, (places, features), and area.

    Ground that several pictures show is divided among them.
    """

    picture: str
    features: Array
    area_m2: float


class Next(NamedTuple):
    """A picture, and the area that its painting would settle."""

    picture: str
    area_m2: float


def next_pictures(unsure: Sequence[UnsureGround]) -> list[Next]:
    """Return the pictures to paint, the best first; none if no ground is unsure.

    >>> soil, roof = np.zeros((4, 2), np.float32), np.full((4, 2), 9, np.float32)
    >>> ground = [("a", soil, 50.0), ("b", soil + 0.1, 40.0), ("c", roof, 30.0)]
    >>> next_pictures([UnsureGround(*one) for one in ground])
    [Next(picture='a', area_m2=90.0), Next(picture='c', area_m2=30.0)]
    """
    some = [one for one in unsure if len(one.features) and one.area_m2 > 0.0]
    if not some:
        return []
    step = max(1, sum(len(one.features) for one in some) // _PLACES)
    features = [one.features[::step] for one in some]
    places = np.concatenate(features)
    area_m2 = np.concatenate(
        [np.full(len(f), one.area_m2 / len(f)) for one, f in zip(some, features, strict=True)]
    )
    reached = np.stack([_near(mine, places) for mine in features])
    found: list[Next] = []
    least_m2 = LEAST * float(area_m2.sum())
    while len(found) < min(MOST, len(some)):
        gains = reached @ area_m2
        best = int(np.argmax(gains))
        if gains[best] < least_m2:
            break
        found.append(Next(some[best].picture, round(float(gains[best]), 1)))
        area_m2 = np.where(reached[best], 0.0, area_m2)
    return found


def pictures_to_paint(
    judged: Iterable[tuple[str, StoredJudgement]], sums: FrameSums, cell_m2: float
) -> list[Next]:
    """Return the pictures whose painting would settle most of the unsure ground.

    Args:
        judged: The pictures of a map, by name.
        sums: Sums of the frames of the map.
    """
    pictures = [(name, stored) for name, stored in judged if stored.unlike is not None]
    shown = CellSums(1)
    for _, stored in pictures:
        shown.add(stored.cells[stored.unsure], np.ones((int(stored.unsure.sum()), 1), np.int64))
    cells, counts = shown.table()
    parts = np.where(sums.which_unsure(cells), 1.0 / counts[:, 0], 0.0)
    part_of = dict(zip(map(tuple, cells.tolist()), parts.tolist(), strict=True))
    ground = []
    for name, stored in pictures:
        here = sum(part_of[cell] for cell in map(tuple, stored.cells[stored.unsure].tolist()))
        ground.append(UnsureGround(name, np.asarray(stored.unlike), cell_m2 * here))
    return next_pictures(ground)


def _near(mine: Array, places: Array) -> NDArray[np.bool_]:
    """Return for each place whether it resembles several of a picture's own, (places,)."""
    squares = (mine**2).sum(axis=1)[:, None] + (places**2).sum(axis=1) - 2.0 * mine @ places.T
    peers = min(_PEERS, len(mine))
    found: NDArray[np.bool_] = np.partition(squares, peers - 1, axis=0)[peers - 1] <= REACH**2
    return found


def write_next(found: Sequence[Next], folder: Path) -> None:
    """Write `next.txt`: a name and its square metres a line, the best first."""
    lines = [f"{one.picture}\t{one.area_m2:.0f}\n" for one in found]
    write_text(folder / NEXT, "".join(lines))
