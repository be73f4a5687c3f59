"""The colours of a map, the same in every format.

Cells follow the idea of the paper's figures: green is explored, black is still to be explored,
pale is known not to be region. Tracks take the colours of Okabe and Ito, which stay apart for
colour-blind eyes; their blue and green are left to the truth and the cells.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from uavmap.results.model import State

Colour = tuple[int, int, int]

STATES: Mapping[State, Colour] = MappingProxyType(
    {
        "explored": (116, 178, 122),
        "under exploration": (242, 201, 76),
        "unexplored": (43, 47, 51),
        "skipped": (200, 30, 160),
        "non-roi": (216, 220, 224),
        "provisional": (226, 178, 158),
        "provisional non-roi": (236, 232, 222),
    }
)
OUTLINE: Colour = (20, 90, 50)
BOUNDARY: Colour = (255, 210, 0)
TRUTH: Colour = (0, 90, 200)
UNSEARCHED: Colour = (200, 30, 160)
TRACKS: tuple[Colour, ...] = (
    (213, 94, 0),
    (150, 60, 130),
    (60, 150, 210),
    (230, 159, 0),
    (110, 60, 20),
    (90, 90, 90),
)


def track_colour(vehicle: int) -> Colour:
    """The colour of a vehicle's track, vehicles counted from 0; repeats after six."""
    return TRACKS[vehicle % len(TRACKS)]
