"""Colours, line styles and words of a map, the same in every picture, page and file.

Tracks have the colours of Okabe and Ito, which colour-blind readers can distinguish. Their blue and
green are not used for tracks: the truth and the cells have them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

from uavmap.output.facts.map_model import State

Colour = tuple[int, int, int]

PAPER: Final[Colour] = (255, 255, 255)
LAND: Final[Colour] = (247, 247, 243)
INK: Final[Colour] = (35, 39, 43)
FAINT: Final[Colour] = (120, 126, 132)

STATES: Final[Mapping[State, Colour]] = {
    "explored": (116, 178, 122),
    "under exploration": (242, 201, 76),
    "unexplored": (43, 47, 51),
    "skipped": (200, 30, 160),
    "non-roi": (216, 220, 224),
    "provisional": (226, 178, 158),
    "provisional non-roi": (236, 232, 222),
    "unsure": (178, 152, 214),
}
STATE_NAMES: Final[Mapping[State, str]] = {
    "explored": "explored",
    "under exploration": "under exploration",
    "unexplored": "unexplored",
    "skipped": "skipped by the operator",
    "non-roi": "not region",
    "provisional": "region so far",
    "provisional non-roi": "not region so far",
    "unsure": "unsure: unlike what the detector knows",
}
"""Names of the cell states for readers; files hold the states themselves."""
RECORDED_NAMES: Final[Mapping[State, str]] = {**STATE_NAMES, "explored": "region"}
"""Names of the cell states in a map of recorded pictures, which no vehicle explored."""
NONSTOP_NAMES: Final[Mapping[State, str]] = {
    **STATE_NAMES, "explored": "decided", "under exploration": "region so far",
}  # fmt: skip
"""Names of the cell states in a film of a run without stopping."""

CLASSES: Final[tuple[Colour, ...]] = (
    (86, 180, 233),
    (240, 228, 66),
    (230, 120, 40),
    (150, 40, 90),
    (40, 30, 30),
    (0, 158, 115),
    (120, 100, 200),
)
"""Colours of the classes of a region, by their numbers."""
OUTLINE: Final[Colour] = (20, 90, 50)
BOUNDARY: Final[Colour] = (255, 210, 0)
TRUTH: Final[Colour] = (0, 90, 200)
UNSEARCHED: Final[Colour] = (200, 30, 160)
BOX: Final[Colour] = (120, 90, 40)
FENCE: Final[Colour] = (190, 40, 60)
HOLE: Final[Colour] = (246, 214, 218)
SEARCHED: Final[Colour] = (238, 231, 214)
TRAFFIC: Final[Colour] = (120, 0, 140)
"""Colour of aircraft of others."""
HIDDEN: Final[Colour] = (207, 222, 242)
"""Colour of a true cell of the region before a vehicle observes it."""
TRACKS: Final[tuple[Colour, ...]] = (
    (213, 94, 0),
    (150, 60, 130),
    (60, 150, 210),
    (230, 159, 0),
    (110, 60, 20),
    (90, 90, 90),
)


class Style(NamedTuple):
    """The style of a line: `dash_px` is the length of a dash and of the gap after it; 0: solid."""

    colour: Colour
    width_px: float
    dash_px: float = 0.0


LINES: Final[Mapping[str, tuple[str, Style]]] = {
    "outline": ("outline of the cells", Style(OUTLINE, 2.5)),
    "boundary": ("boundary by pixels", Style(BOUNDARY, 1.4)),
    "truth": ("true region", Style(TRUTH, 2.0)),
    "unsearched": ("search lane without a judged frame", Style(UNSEARCHED, 3.0)),
    "box": ("search box", Style(BOX, 1.6, 9.0)),
    "fence": ("geofence", Style(FENCE, 1.6, 4.0)),
}
"""The lines of a map and of a plan, by the key of their layer."""
MARKS: Final[Mapping[str, str]] = {
    "home": "home",
    "track": "track",
    "ahead": "path ahead, by the current order",
    "flying": "vehicle in the air",
    "landed": "vehicle on the ground",
    "traffic": "aircraft of others",
}
"""Names of the other marks of a live map."""

CONTROLS: Final[Mapping[str, str]] = {
    "offline": "no contact",
    "grounded": "uavmap",
    "airborne": "uavmap",
    "yielded": "pilot or failsafe",
    "guarded": "guardian",
    "finished": "uavmap",
    "failed": "its crew",
    "down": "its crew",
    "lost": "no contact",
    "apart": "its own service",
}
"""Names of the person or system that controls a vehicle, by its phase."""

TRACK_PX: Final = 1.3
LANE_PX: Final = 2.0
HOME_DOT: Final = ((7.0, PAPER), (5.5, INK), (2.0, PAPER))
"""Discs of the mark at a home: radius in pixels and colour, the largest first."""


def track_colour(vehicle: int) -> Colour:
    """Return the colour of a vehicle's track by its number; it repeats after six."""
    return TRACKS[vehicle % len(TRACKS)]


def class_colour(number: int) -> Colour:
    """Return the colour of a class by its number, from 1; it repeats after seven."""
    return CLASSES[(number - 1) % len(CLASSES)]


def css(colour: Colour) -> str:
    """Write a colour as style sheets do.

    >>> css((255, 0, 16))
    '#ff0010'
    """
    return "#{:02x}{:02x}{:02x}".format(*colour)
