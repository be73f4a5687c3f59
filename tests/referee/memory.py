"""The referee's memory of one vehicle."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from .motion import Inside
from .track import Ail, Bounds, Sample

FORGIVEN_S: Final = 60.0
"""Time within which a vehicle that could not be controlled lands or returns, s."""
FALLS_M_S: Final = 2.0
"""Speed of descent from which a crashing vehicle counts as falling, m/s."""
REPORTED_S: Final = 5.0
"""Time within which the product reports a mode of others, s."""
STRUCK_M_S: Final = 2.5
"""Speed of descent at which a landing counts as a strike, m/s."""


@dataclass(slots=True)
class Memory:
    now: Sample
    bounds: Bounds
    last_s: dict[Ail | str, float] = field(default_factory=dict)
    """Time of the last moment in each condition; "hands": a pilot or a failsafe had it."""
    sortie: set[Ail | str] = field(default_factory=set)
    """Conditions in the air since its take-off."""
    ours_s: float = -math.inf
    """Time when the program last had it, or it could not report its holder."""
    left_s: float | None = None
    """Time when it left the fence under our control."""
    out_m: float = 0.0
    unknown_s: float = -math.inf
    """Time when its mode was last unknown, or changed."""
    unguarded_s: float = -math.inf
    """Time when its guardian last did not act."""
    alone_s: float | None = None
    pilot_chose: bool = False
    pilots_mode: str = ""
    turned_s: float = -math.inf
    """Time of the pilot's last choice of a mode."""
    pilots_s: float = -math.inf
    """Time of the pilot's last choice before the present sample."""
    fell_m: float = 0.0
    fell_silent: bool = False
    """Telemetry does not show all of its fall."""
    struck: bool = False
    landed_blind: bool = False
    highest_m: float = -math.inf
    ever: set[Ail | str] = field(default_factory=set)
    """Conditions in the air at any time."""
    inside: Inside = field(init=False)
    _slow_up_m: float = field(init=False)

    def __post_init__(self) -> None:
        self.inside = Inside(self.bounds.fence)
        self._slow_up_m = self.now.up_m

    def learn(self, sample: Sample) -> None:
        """Update the memory by the next sample."""
        before, self.now = self.now, sample
        t_s = sample.t_s
        for ail in sample.ails:
            self.last_s[ail] = t_s
        hands = sample.holder != "service"
        if hands:
            self.last_s["hands"] = t_s
        if not hands or sample.ails & {"unheard", "unserved"} or not sample.flying:
            self.ours_s = t_s
        if sample.flying and not before.flying:
            self.sortie.clear()
            self.fell_m = 0.0
        if sample.flying:
            self.sortie |= sample.ails
            if hands:
                self.sortie.add("hands")
            self.highest_m = max(self.highest_m, sample.up_m)
            self.ever |= self.sortie
        if not sample.known or sample.mode != before.mode:
            self.unknown_s = t_s
        if sample.charge != "guardian":
            self.unguarded_s = t_s
        if before.flying:
            self._fall(before, sample)
            if not sample.flying:
                self.landed_blind = self.within("blind")

    def _fall(self, before: Sample, now: Sample) -> None:
        dt_s = now.t_s - before.t_s
        down_m_s = (before.up_m - now.up_m) / dt_s if dt_s > 0.0 else 0.0
        if down_m_s < FALLS_M_S and now.flying:
            self._slow_up_m = now.up_m
        strikes_m_s = down_m_s if now.down_m_s is None else now.down_m_s
        self.struck = self.struck or (not now.flying and strikes_m_s > STRUCK_M_S)
        if now.crashed:
            self.fell_m = max(self.fell_m, self._slow_up_m - now.up_m)
            silent = bool(now.ails & {"unheard", "unserved"})
            self.fell_silent = self.fell_silent or silent

    def within(self, ail: Ail | str, span_s: float = FORGIVEN_S) -> bool:
        """Return whether it was in a condition less than `span_s` ago."""
        return self.now.t_s - self.last_s.get(ail, -math.inf) < span_s

    @property
    def is_known_foreign(self) -> bool:
        """A pilot or a failsafe has it in the air for longer than a report takes."""
        return self.now.flying and self.now.t_s - self.ours_s > REPORTED_S

    @property
    def is_uncontrolled(self) -> bool:
        """It left the fence soon after a time without control, and not long ago."""
        left_s = self.now.t_s if self.left_s is None else self.left_s
        last_s = max(self.last_s.get(ail, -math.inf) for ail in ("blind", "hands"))
        recent = self.now.t_s - left_s <= FORGIVEN_S or self.within("deaf")
        return last_s >= left_s - FORGIVEN_S and recent

    def is_down(self, away_m: float) -> bool:
        """Return whether it has crashed from a height that the product can notice."""
        at_pad = away_m < self.bounds.home_m
        least_m = self.bounds.fall_at_pad_m if at_pad else self.bounds.fall_m
        return self.now.crashed and self.fell_m > least_m
