"""What a member knows of another one."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from missions.flight.team.codec import Ask
from missions.flight.team.knowledge import Holding


@dataclass(slots=True)
class Peer:
    """Another member, as it was heard; times are those of our clock."""

    heard_s: float
    have: dict[int, Holding] = field(default_factory=dict)
    """Which facts of each member it knows..."""
    have_s: float = -math.inf
    """... as it said then."""
    lacks_since_s: dict[int, float] = field(default_factory=dict)
    """Since when it lacks facts of a member that are known here, and got no later one of it."""
    apart: bool = False
    done: bool = False
    told_all: bool = False
    """Whether it has told what it knows since it was done."""
    begun: bool = False
    """Whether its clock moves no more."""
    ask: Ask | None = None
    promised: int = -1
    """Which of our questions for air it has promised."""
    ahead_s: float = -math.inf
    """By how much its clock is ahead of ours, at least: what comes late seems less."""

    def clock_moved(self, by_s: float) -> None:
        """Our clock was put forward, or back, by so much."""
        self.heard_s += by_s
        self.have_s += by_s
        self.ahead_s -= by_s
        self.lacks_since_s = {o: at_s + by_s for o, at_s in self.lacks_since_s.items()}
