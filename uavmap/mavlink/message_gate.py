"""The one place that every message of a vehicle passes before anything else sees it.

What a kind of message may say is in `uavmap.mavlink.message_rules`, what has to fit the messages
before it in `uavmap.mavlink.continuity`. What fails is refused: it changes nothing, is counted by
kind and reason, and is told, but not more than once in ten seconds a kind.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from missions.units import LatLon
from uavmap.mavlink.continuity import OLDER, BootClock, CameraClock, Fix, Track, distance_m
from uavmap.mavlink.message_rules import NO_FIX, RULES, Message, Sender, place_fault

TELL_EVERY_S: Final = 10.0
AREA_M: Final = 100_000.0
"""Farther from the mission nothing is a position of one of its vehicles."""
HOME_M: Final = 50_000.0
OVERTAKEN_S: Final = 2.0
"""Time after which a frame with a lower number is of a vehicle that restarted, s."""
OVERTAKEN: Final = "overtaken on its way"
_STATES: Final = frozenset({"HEARTBEAT", "CURRENT_MODE", "EXTENDED_SYS_STATE"})
"""Messages without a time of their own whose latest one counts."""
_EXPECTED: Final = (NO_FIX, OLDER, OVERTAKEN)
"""What is counted, but no news to anybody."""


def _to_nobody(text: str) -> None:
    pass


@dataclass(slots=True)
class Gate:
    """Refuses what cannot be; `say` is told of it."""

    say: Callable[[str], None] = _to_nobody
    refused: Counter[tuple[str, str]] = field(default_factory=Counter)
    """How often by (kind of message, reason). Reasons are of this program: there are few."""
    area: LatLon | None = None
    """Where the mission is, if that is known."""
    clock: BootClock = field(default_factory=BootClock)
    camera_clock: CameraClock = field(default_factory=CameraClock)
    track: Track = field(default_factory=Track)
    _told_s: dict[str, float] = field(default_factory=dict)
    _numbers: dict[tuple[int, str], tuple[int, float]] = field(default_factory=dict)
    """Number of the latest frame, and when it was heard, by component and kind."""

    def admits(self, message: Message, sender: frozenset[Sender], now_s: float) -> bool:
        """Whether a message of our vehicle, said by such a component, may be believed."""
        kind = message.get_type()
        rule = RULES.get(kind)
        if rule is None:
            return True
        fault = rule.fault(message) if rule.sender in sender else f"not said by {rule.sender.value}"
        if fault is None and kind == "GLOBAL_POSITION_INT":
            fault = self._position_fault(message, now_s)
        elif fault is None and kind in _STATES and self._is_overtaken(message, now_s):
            fault = OVERTAKEN
        elif fault is None and kind == "HOME_POSITION":
            fault = self._home_fault(message)
        if fault is None:
            return True
        self.refuse(kind, fault, now_s)
        return False

    def refuse(self, kind: str, reason: str, now_s: float) -> None:
        """Count what was not believed, and tell it. `reason` holds no value of the message."""
        self.refused[kind, reason] += 1
        told_s = self._told_s.get(kind, float("-inf"))
        if reason in _EXPECTED or now_s - told_s < TELL_EVERY_S:
            return
        self._told_s[kind] = now_s
        count = self.refused[kind, reason]
        self.say(f"{kind} refused: {reason}" + (f" ({count} times by now)" if count > 1 else ""))

    def refuse_once(self, kind: str, reason: str) -> None:
        """Count what was not believed, and tell it the first time only."""
        self.refused[kind, reason] += 1
        if self.refused[kind, reason] == 1:
            self.say(f"{kind} refused: {reason}; further ones are counted, and not told")

    def figures(self) -> dict[str, int]:
        """What was refused, for a summary: "KIND: reason" and how often."""
        return {f"{kind}: {why}": count for (kind, why), count in sorted(self.refused.items())}

    def _position_fault(self, message: Message, now_s: float) -> str | None:
        boot_s = message.time_boot_ms / 1000.0
        reboots = self.clock.reboots
        fault = self.clock.take(boot_s, now_s) or place_fault(message)
        if self.clock.reboots != reboots:
            self.say("the vehicle's clock has begun anew: it has restarted")
        if fault is not None:
            return fault
        position = LatLon(message.lat / 1e7, message.lon / 1e7)
        if self.area is not None and distance_m(position, self.area) > AREA_M:
            return f"more than {AREA_M / 1000.0:g} km from the mission"
        jumps = self.track.jumps
        fault = self.track.take(
            Fix(
                position,
                message.alt / 1000.0,
                (message.alt - message.relative_alt) / 1000.0,
                now_s,
                boot_s,
            )
        )
        if self.track.jumps != jumps:
            self.say(
                f"the vehicle's position or height has jumped by {self.track.jumped_m:.0f} m and "
                "stays there: it is believed now"
            )
        return fault

    def _is_overtaken(self, message: Message, now_s: float) -> bool:
        """Whether a later one of its kind has come before: what it says was before that."""
        key, number = (message.get_srcComponent(), message.get_type()), message.get_seq()
        last, heard_s = self._numbers.get(key, (number, now_s))
        if now_s - heard_s < OVERTAKEN_S and (number - last) % 256 >= 128:
            return True
        self._numbers[key] = number, now_s
        return False

    def _home_fault(self, message: Message) -> str | None:
        home = LatLon(message.latitude / 1e7, message.longitude / 1e7)
        near = self.track.last.position if self.track.last is not None else self.area
        if near is not None and distance_m(home, near) > HOME_M:
            return f"more than {HOME_M / 1000.0:g} km from the vehicle"
        return None
