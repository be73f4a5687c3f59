"""EVENT (410): what a PX4 sends beside its texts, and where it takes nobody for a ground station.

An event is a number, a hash of its name, with arguments; its words are in a file that belongs to
the firmware, which is not here. Those of failsafes are known here by their names: the text of each
failsafe is the same, and its cause is an argument of its event alone. Of the others the number is
reported: with it the event is found in QGroundControl or in the flight's log.

Source: PX4, `commander/failsafe/framework.cpp` (`notifyUser`), `lib/events/enums.json`,
`commander/HealthAndArmingChecks`.
"""

from __future__ import annotations

import struct
from typing import Any, Final

from uavmap.mavlink.autopilots import PX4
from uavmap.mavlink.status_texts import Text

DUE: Final = "Failsafe activated due to "
"""Beginning of the words of a failsafe whose cause the autopilot names."""
CAUSELESS: Final = "Failsafe activated in "
"""The same of one without a cause: setpoints, position, fence, but no link and no battery."""


def number_of(name: str) -> int:
    """The number of an event: 24 bits of FNV-1a, without the component that sends it.

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
_WORDS: Final = {
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
        ("check_gf_violation_custom_gf", "Geofence violation: at or outside of the geofence"),
    )
}


def event_text(event: Any, *, numbered: bool) -> Text | None:
    """The words of an EVENT; None where they are not known, unless its number is to be reported.

    >>> from uavmap.mavlink.dialect import EventMessage
    >>> number = 1 << 24 | number_of("commander_failsafe_enter")
    >>> arguments = [0, 0, 6, 0, 6, 2, *[0] * 34]
    >>> event_text(EventMessage(number, 0, 0, 0, 0, 0x42, arguments), numbered=False).words
    'Failsafe activated due to ground station connection lost, triggering RTL'
    """
    number = event.id & 0xFFFFFF
    words = _WORDS.get(number)
    if number in _ARGUMENTS:
        layout, fields = _ARGUMENTS[number]
        values = layout.unpack_from(bytes(event.arguments))
        words = _failsafe(**dict(zip(fields, values, strict=True)))
    elif words is None and numbered:
        words = f"event {event.id:#010x}: its words are known to QGroundControl, not here"
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
