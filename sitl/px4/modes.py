"""PX4's modes: a main mode and, for the automatic ones, a sub-mode."""

from __future__ import annotations

from enum import IntEnum

MAIN_AUTO = 4
SUB_MISSION = 4


class Px4Mode(IntEnum):
    """`custom_mode` of HEARTBEAT."""

    MANUAL = 1 << 16
    ALTITUDE = 2 << 16
    POSITION = 3 << 16
    ACRO = 5 << 16
    OFFBOARD = 6 << 16
    STABILIZED = 7 << 16
    TAKEOFF = 4 << 16 | 2 << 24
    HOLD = 4 << 16 | 3 << 24
    MISSION = 4 << 16 | 4 << 24
    RTL = 4 << 16 | 5 << 24
    LAND = 4 << 16 | 6 << 24

    @property
    def automatic(self) -> bool:
        """True if its main mode is AUTO."""
        return self >> 16 & 0xFF == MAIN_AUTO


BY_HAND = (Px4Mode.MANUAL, Px4Mode.ALTITUDE, Px4Mode.POSITION, Px4Mode.ACRO, Px4Mode.STABILIZED)
"""Modes that need a radio control (`Quirks.stick`)."""
LEVEL = tuple(mode for mode in BY_HAND if mode != Px4Mode.POSITION)
"""With the stick centred these keep level and the height, and drift with the wind."""
UNARMABLE = (Px4Mode.RTL, Px4Mode.LAND)


def requested_mode(main: int, sub: int) -> Px4Mode | None:
    """Return the mode that DO_SET_MODE requests; AUTO without a sub-mode is the mission.

    >>> requested_mode(4, 0).name, requested_mode(6, 0).name, requested_mode(4, 99)
    ('MISSION', 'OFFBOARD', None)
    """
    sub = (sub or SUB_MISSION) if main == MAIN_AUTO else 0
    try:
        return Px4Mode(main << 16 | sub << 24)
    except ValueError:
        return None
