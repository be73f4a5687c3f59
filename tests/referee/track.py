"""The records of worlds: the truth of each vehicle, and the view of the product."""

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

- blind: positions, compass or wind are beyond the limits of monitoring or flight
- misled: positions and velocities agree and are wrong
- unheard: no telemetry arrives; deaf: no command arrives
- straight: it obeys no target; helpless: it obeys no target, landing or return
- stormy: the wind is stronger than in the estimates
- drained: charge was lost at once; emptied: more than 30 % of it
- falling: its motors have failed; by hand: sticks fly it
- idle: it hovers, and no return or landing that was begun continues
- unserved: no program runs; unasked: its autopilot returns without an order or a failsafe
- pads outside: a pad of the team lies outside of the fence
"""
Charge = Literal[
    "", "ground", "home", "mission", "guardian", "others", "silent", "over", "down", "lost"
]
"""State of a vehicle by the last report of the product; "" where it is not recorded."""
FINE: frozenset[Ail] = frozenset()


@dataclass(frozen=True, slots=True)
class Sample:
    """One vehicle at one moment. Between two samples it moves on a straight line."""

    t_s: float
    place: GridPoint
    up_m: float
    """Height above a level that all vehicles share."""
    flying: bool
    """The vehicle is in the air, under any control."""
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
    """The product knows the present mode of a pilot or a failsafe."""
    down_m_s: float | None = None
    """Speed of descent, where the world records it; else that between samples counts."""

    @property
    def returns(self) -> bool:
        return self.mode.upper().endswith(("RTL", "LAND", "RETURN"))


@dataclass(frozen=True, slots=True)
class Bounds:
    """The promises of a mission, and the precision of its world."""

    fence: Polygon | MultiPolygon
    pads: Mapping[int, GridPoint]
    separation_m: float
    reserve_wh: float
    waver_m: float = 0.01
    """Distance outside of the fence that is no breach."""
    race_s: float = 0.0
    """Maximum age of the data behind a command, s."""
    fall_m: float = 2.0
    """Least fall that the product can notice, m."""
    fall_at_pad_m: float = 5.0
    """Least fall that the product can notice over a pad, where a hard landing looks the same, m."""
    crash_is_known: bool = False
    """The product notices each crash from any height: no flight with one is complete."""
    home_m: float = 5.0
    """Distance from its pad within which a vehicle is at home."""
    ends_with_program: bool = False
    """The truth ends with the program, before the end of a return that is under way."""


@dataclass(frozen=True, slots=True)
class ProductReport:
    """The report of the product at its end, with the truth about the ground."""

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
    """Maximum number of owed cells that a complete map may miss."""
    misjudged: bool = False
    """A frame was judged while its pose was wrong."""
    forbidden: bool = False
    """The fence forbids a part of the region, so that no map is complete."""
    lanes: Sequence[tuple[GridPoint, GridPoint]] = ()
    """Lanes that count as searched."""
    frames: Sequence[tuple[GridPoint, float]] = ()
    """Judged frames: true place, and the reach of each over the ground, m."""
    step_m: float = 1.0
    """Distance between the points at which lanes are examined."""
    lost: Sequence[str] = ()
    """Confirmed frames that the map or the journal's text lacks."""
    owners: str = ""
    """Settings of the owner that were not given back."""
    faults: Sequence[tuple[str, str]] = field(default=())
    """A traceback, or no end: kind and text."""
