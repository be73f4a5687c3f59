"""Texts of a vehicle: STATUSTEXT, joined from its chunks and made harmless, and EVENT (410).

A PX4 sends EVENT beside its texts, and alone if it knows no ground station. An event is a number, a
hash of its name, with arguments; its text is in a file of the firmware, which is not here. The
events of failsafes are known here by their names. The text of each is the same, and its cause is an
argument of its event alone. The others are reported by number. QGroundControl or the flight's log
show the event by it.

Source: PX4, `commander/failsafe/framework.cpp` (`notifyUser`), `lib/events/enums.json`,
`commander/HealthAndArmingChecks`.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from uavmap.base.printable import printable
from uavmap.mavlink.autopilots import PX4

CHUNK_BYTES: Final = 50
MAX_CHUNKS: Final = 16
MAX_OPEN: Final = 4
"""Maximum number of a vehicle's texts that may be incomplete at a time."""
MAX_CHUNK_WAIT_S: Final = 2.0
"""Maximum wait for the other chunks of a text, s; then it is passed on incomplete."""
TEXT_LENGTH: Final = 400
_GAP: Final = "[...]"


class Text(NamedTuple):
    """A text of a vehicle, whole or the received part."""

    severity: int
    """MAV_SEVERITY: 0 is an emergency, 7 for debugging."""
    words: str


@dataclass(slots=True)
class _Open:
    severity: int
    begun_s: float
    chunks: dict[int, str] = field(default_factory=dict)
    last: int | None = None
    """Number of the last chunk, once it has arrived."""

    @property
    def whole(self) -> bool:
        return self.last is not None and len(self.chunks) == self.last + 1

    def text(self) -> Text:
        end = max(self.chunks) + 1 if self.last is None else self.last + 1
        words = "".join(self.chunks.get(k, _GAP) for k in range(end))
        return _harmless(self.severity, words if self.last is not None else words + _GAP)


class Texts:
    """Joins texts; a lost chunk leaves a gap, and delays nothing."""

    def __init__(self) -> None:
        self._open: dict[tuple[int, int], _Open] = {}

    def add(self, component: int, message: Any, now_s: float) -> list[Text]:
        """Add a STATUSTEXT; return the texts that are whole, or given up."""
        done = self.late(now_s)
        words, full = _chunk_text(message)
        number, chunk = int(message.id), int(message.chunk_seq)
        if number == 0 or (chunk == 0 and not full):  # in one piece
            return [*done, _harmless(message.severity, words)]
        if chunk >= MAX_CHUNKS:
            return done
        key = (component, number)
        if key not in self._open and len(self._open) >= MAX_OPEN:
            done.append(self._open.pop(next(iter(self._open))).text())
        part = self._open.setdefault(key, _Open(int(message.severity), now_s))
        part.chunks[chunk] = words
        if not full:
            part.last = chunk
        if part.whole:
            done.append(self._open.pop(key).text())
        return done

    def late(self, now_s: float) -> list[Text]:
        """Return the texts whose other chunks are not waited for any longer."""
        keys = [key for key, part in self._open.items() if now_s - part.begun_s > MAX_CHUNK_WAIT_S]
        return [self._open.pop(key).text() for key in keys]


def _chunk_text(message: Any) -> tuple[str, bool]:
    """Return the text of one chunk, and whether it is full: then another follows."""
    text = message.text
    raw = text if isinstance(text, bytes) else str(text).encode("utf-8", "replace")
    raw = raw.split(b"\0", 1)[0]
    return raw.decode("utf-8", "replace"), len(raw) >= CHUNK_BYTES


def _harmless(severity: int, words: str) -> Text:
    return Text(int(severity), printable(words, TEXT_LENGTH).strip())


DUE: Final = "Failsafe activated due to "
"""Beginning of the text of a failsafe whose cause the autopilot names."""
CAUSELESS: Final = "Failsafe activated in "
"""The same without a cause: setpoints, position, fence, but no link and no battery."""


def number_of(name: str) -> int:
    """Return the number of an event: 24 bits of FNV-1a, without the component that sends it.

    >>> hex(number_of("commander_armed_by"))
    '0x90caf3'
    """
    value = 0x811C9DC5
    for byte in name.encode("ascii"):
        value = (value ^ byte) * 0x01000193 & 0xFFFFFFFF
    return value & 0xFFFFFF


_CAUSES: Final = {
    1: "manual control lost",
    2: "ground station connection lost",
    3: "low battery level",
    4: "critical battery level",
    5: "emergency battery level",
    6: "low battery: little flight time is left",
}
_ACTIONS: Final = {
    2: "POSITION", 3: "ALTITUDE", 4: "STABILIZED", 5: "HOLD", 6: "RTL", 7: "LAND", 8: "DESCEND",
    9: "motors off", 10: "termination",
}  # fmt: skip
_ARGUMENTS: Final = {
    number_of(f"commander_failsafe_enter{name}"): (struct.Struct(layout), fields)
    for name, layout, fields in (
        ("", "<IBB", ("mode", "action", "cause")),
        ("_hold", "<IBHB", ("mode", "action", "delay_s", "cause")),
        ("_generic", "<IB", ("mode", "action")),
        ("_generic_hold", "<IBH", ("mode", "action", "delay_s")),
    )
}
_EVENT_TEXTS: Final = {
    number_of(name): words
    for name, words in (
        ("commander_failsafe_enter_generic_warn", "Failsafe warning"),
        ("commander_failsafe_enter_warn", "Failsafe warning"),
        ("commander_failsafe_enter_low_bat", "Low battery level, return advised"),
        ("commander_failsafe_enter_crit_bat_warn", "Critical battery level, land now"),
        ("commander_failsafe_enter_crit_low_bat_warn", "Emergency battery level, land immediately"),
        ("commander_failsafe_enter_low_flight_time_warn", "Low battery: return advised"),
        ("check_modes_local_pos", "No valid position estimate"),
        ("check_modes_global_pos", "No valid global position estimate"),
        ("check_modes_offboard_signal", "No offboard signal"),
        ("check_modes_offboard_signal_lost", "Offboard signal lost"),
        ("check_gf_violation_max_hor_dist", "Geofence violation: too far from home"),
        ("check_gf_violation_max_alt", "Geofence violation: too high above home"),
        ("check_gf_violation_custom_gf", "Geofence violation: at or outside the geofence"),
    )
}


def event_text(event: Any, *, numbered: bool) -> Text | None:
    """Return the text of an EVENT; None if it is not known.

    With `numbered` an unknown event is returned as its number.
    """
    number = event.id & 0xFFFFFF
    words = _EVENT_TEXTS.get(number)
    if number in _ARGUMENTS:
        layout, fields = _ARGUMENTS[number]
        values = layout.unpack_from(bytes(event.arguments))
        words = _failsafe(**dict(zip(fields, values, strict=True)))
    elif words is None and numbered:
        words = f"event {event.id:#010x}: its text is in QGroundControl, not here"
    return None if words is None else Text(event.log_levels & 0x0F, words)


def _failsafe(mode: int, action: int, cause: int = 0, delay_s: int = 0) -> str:
    words = "Failsafe activated"
    if cause:
        words = DUE + _CAUSES.get(cause, f"cause {cause}")
    elif (name := PX4.mode_names.get(mode)) is not None:
        words = CAUSELESS + name
    if action in _ACTIONS:
        words += f", triggering {_ACTIONS[action]}"
    return f"{words} in {delay_s} s" if delay_s else words
