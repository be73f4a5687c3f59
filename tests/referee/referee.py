"""The referee of all worlds: it judges their records by its rules.

It imports only units of the product that it judges (a contract in `pyproject.toml` holds that).
"""

from __future__ import annotations

import math
from collections import Counter, deque
from dataclasses import dataclass, field
from typing import Final

from .forgiveness import BY_KIND
from .memory import Memory
from .motion import LONGEST_LEG_S, Leg, least_distance_m
from .rules import RULES, WITHOUT_ORDERS, flight_faults, vehicle_faults
from .track import Bounds, Charge, Holder, ProductReport, Sample

LEGS_KEPT: Final = 64
"""Number of legs of a vehicle that are kept for legs of others that arrive later."""


@dataclass(slots=True)
class Referee:
    bounds: Bounds
    found: list[tuple[str, str]] = field(default_factory=list)
    """Broken rules: kind and text."""
    forgiven: Counter[str] = field(default_factory=Counter)
    """Number of uses of each rule of forgiveness."""
    nearest_m: float = math.inf
    memories: dict[int, Memory] = field(default_factory=dict)
    _legs: dict[int, deque[Leg]] = field(default_factory=dict)
    _nearest: dict[tuple[int, int], tuple[int | None, float]] = field(default_factory=dict)
    """The place in `found` and the least distance of each pair that is too near."""
    _open: dict[tuple[str, object], set[str]] = field(default_factory=dict)
    """Faults that last, each with its notes."""

    # --- in flight -------------------------------------------------------------------------------
    def see(self, number: int, sample: Sample) -> None:
        """Judge a vehicle at its next moment."""
        memory = self.memories.get(number)
        if memory is None:
            memory = self.memories[number] = Memory(sample, self.bounds)
            self._legs[number] = deque(maxlen=LEGS_KEPT)
        before = memory.now
        memory.learn(sample)
        for rule in RULES:
            self._note(rule.kind, number, rule.look(memory, before), number)
        if before.flying and sample.flying and 0.0 < sample.t_s - before.t_s <= LONGEST_LEG_S:
            self._separate(number, (before, sample))

    def ordered(self, number: int, t_s: float, order: str, charge: Charge, holder: Holder) -> None:
        """Judge an order that is given to a vehicle, which counts as `charge`; `holder` has it."""
        memory = self.memories.get(number)
        foreign = holder != "service" and memory is not None and memory.is_known_foreign
        if order != "StandDown" and (charge in WITHOUT_ORDERS or foreign):
            state = f"in {memory.now.mode} by others" if memory is not None and foreign else charge
            self.note(t_s, "hands off", f"{order} for vehicle {number}, which is {state}")

    def _separate(self, number: int, leg: Leg) -> None:
        for other, legs in self._legs.items():
            if other == number:
                continue
            pair = (min(number, other), max(number, other))
            for others in reversed(legs):
                if others[1].t_s <= leg[0].t_s:
                    break
                apart_m = least_distance_m(leg, others)
                near = apart_m < self.bounds.separation_m - 1e-6
                text = f"and {max(pair)} are {apart_m:.2f} m apart" if near else ""
                if self._note("near", pair, text, *pair):
                    self.nearest_m = min(self.nearest_m, apart_m)
                    self._come_nearer(pair, apart_m)
        self._legs[number].append(leg)

    def _come_nearer(self, pair: tuple[int, int], apart_m: float) -> None:
        """Keep the least distance of a pair in its fault."""
        place, least_m = self._nearest.get(pair, (None, math.inf))
        if ("near", pair) not in self._open:
            self._nearest.pop(pair, None)
        elif apart_m < least_m:
            place = len(self.found) - 1 if place is None else place
            self._nearest[pair] = (place, apart_m)
            kind, text = self.found[place]
            self.found[place] = kind, f"{text.partition(' are ')[0]} are {apart_m:.2f} m apart"

    def _note(self, kind: str, key: object, text: str, *numbers: int) -> bool:
        """Note a fault once for as long as it lasts; return False if it is forgiven now."""
        episode = (kind, key)
        if not text:
            self._open.pop(episode, None)
            return True
        noted = self._open.setdefault(episode, set())
        if kind in noted:
            return True
        for rule in BY_KIND.get(kind, ()):
            if any(rule.holds(self.memories[number]) for number in numbers):
                if rule.name not in noted:
                    noted.add(rule.name)
                    self.forgiven[rule.name] += 1
                return False
        noted.add(kind)
        number = min(numbers)
        self.note(self.memories[number].now.t_s, kind, f"vehicle {number} {text}")
        return True

    def note(self, t_s: float, kind: str, text: str) -> None:
        self.found.append((kind, f"{t_s:.2f} s: {text}"))

    # --- at the end ------------------------------------------------------------------------------
    def conclude(self, report: ProductReport) -> None:
        """Judge what must hold once a flight is over."""
        for number, memory in self.memories.items():
            for kind, text in vehicle_faults(memory, number, report):
                self._note(kind, (number, text), text, number)
        seen = not any("blind" in memory.ever for memory in self.memories.values())
        for kind, text in flight_faults(report, home=self.all_at_home and seen):
            self.note(report.t_s, kind, text)

    @property
    def in_the_air(self) -> list[int]:
        return [number for number, memory in self.memories.items() if memory.now.flying]

    def from_pad_m(self, number: int) -> float:
        """Return how far a vehicle is from its pad, over ground."""
        return self.memories[number].now.place.distance_to(self.bounds.pads[number])

    @property
    def crashed(self) -> list[int]:
        return [number for number, memory in self.memories.items() if memory.now.crashed]

    @property
    def all_at_home(self) -> bool:
        """All vehicles stand at their pads, and none has fallen or struck the ground."""
        away = any(self.from_pad_m(number) > self.bounds.home_m for number in self.memories)
        struck = any(memory.struck for memory in self.memories.values())
        return not (self.in_the_air or self.crashed or away or struck)
