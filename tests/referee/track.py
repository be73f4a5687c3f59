"""What worlds record: the truth of each vehicle, and what the product made of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from shapely.geometry import MultiPolygon, Polygon

from missions.units import Cell, GridPoint

Holder = Literal["service", "pilot", "failsafe"]
Ail = Literal[
    "blind", "misled", "unheard", "deaf", "straight", "helpless", "stormy", "drained", "emptied",
    "falling", "by hand", "idle", "unserved", "unasked", "pads outside",
]  # fmt: skip
"""Conditions of a vehicle in truth.

blind: positions, compass or wind are beyond what can be noticed or flown; misled: positions and
velocities agree and are wrong; unheard, deaf: no telemetry, no command arrives; straight: it obeys
no target; helpless: nor a landing or a return; stormy: more wind than reckoned with; drained,
emptied: charge was lost at once, emptied for more than 30 %; falling: its motors have failed;
by hand: sticks fly it; idle: it hovers, and nothing that was begun goes on; unserved: no program
runs; unasked: its autopilot returns without an order or a failsafe; pads outside: a pad of the team
lies outside of the fence.
"""
Charge = Literal[
    "", "ground", "home", "mission", "guardian", "others", "silent", "over", "down", "lost"
]
"""What a vehicle counts as, by what the product reported last; "" where it is not recorded."""
FINE: frozenset[Ail] = frozenset()


@dataclass(frozen=True, slots=True)
class Sample:
    """One vehicle at one moment. Between two samples it moves on a straight line."""

    t_s: float
    place: GridPoint
    up_m: float
    """Height above a level that all vehicles share."""
    flying: bool
    """Off the ground, under any control."""
    crashed: bool = False
    wh: float = float("inf")
    mode: str = ""
    holder: Holder = "service"
    changes: tuple[tuple[Holder, str], ...] = ()
    """Modes set since the sample before, each with its author; "" by a pilot gives it back."""
    ails: frozenset[Ail] = FINE
    charge: Charge = ""
    order: str = ""
    """Name of its present order; "" for none."""
    known: bool = True
    """Whether the product knows the present mode of a pilot or a failsafe."""
    down_m_s: float | None = None
    """Speed downwards, where the world tells it; else that between samples counts."""

    @property
    def returns(self) -> bool:
        return self.mode.upper().endswith(("RTL", "LAND", "RETURN"))


@dataclass(frozen=True, slots=True)
class Bounds:
    """What a mission promises, and how exactly its world can be measured."""

    fence: Polygon | MultiPolygon
    pads: Mapping[int, GridPoint]
    separation_m: float
    reserve_wh: float
    waver_m: float = 0.01
    """Distance outside of the fence that is no breach."""
    race_s: float = 0.0
    """Age of what a command may have been decided by."""
    fall_m: float = 2.0
    """Least fall that the product can notice..."""
    fall_at_pad_m: float = 5.0
    """... and over a pad, where a hard landing looks the same."""
    crash_is_known: bool = False
    """Whether the product notices each crash, however low: no flight with one is complete."""
    home_m: float = 5.0
    """Distance from its pad within which a vehicle is at home."""
    ends_with_program: bool = False
    """Whether the truth ends with the program, before the end of a return that is under way."""
    forgives: bool = True
    """Whether nearness is forgiven after what takes a vehicle out of its air."""


@dataclass(frozen=True, slots=True)
class Said:
    """What the product reported at its end, with the truth about the ground beside it."""

    t_s: float
    code: int | None = None
    """Exit code; None where there is none."""
    completed: bool = False
    reported: frozenset[int] = frozenset()
    """Vehicles reported as down, lost or away from their pads."""
    region: frozenset[Cell] = frozenset()
    """Cells that are region, in truth."""
    owed: frozenset[Cell] = frozenset()
    """Cells that a complete map has to hold."""
    mapped: frozenset[Cell] = frozenset()
    """Cells that the map is sure are region."""
    missed_cells: int = 0
    """How many owed cells may be missing from a complete map."""
    misjudged: bool = False
    """A frame was judged while its pose was wrong."""
    forbidden: bool = False
    """The fence forbids a part of the region, so that no map is complete."""
    lanes: Sequence[tuple[GridPoint, GridPoint]] = ()
    """Lanes that count as searched..."""
    frames: Sequence[tuple[GridPoint, float]] = ()
    """... and frames that were judged: place in truth, and how far each shows the ground, m."""
    step_m: float = 1.0
    """Distance between the points at which lanes are examined."""
    lost: Sequence[str] = ()
    """What was confirmed, and is not in the map or in the journal's text."""
    owners: str = ""
    """Settings of the owner that were not given back."""
    faults: Sequence[tuple[str, str]] = field(default=())
    """A traceback, or no end: kind and text."""
