"""ArduCopter's modes, and what the vehicle is doing within them."""

from __future__ import annotations

from enum import Enum, IntEnum


class Mode(IntEnum):
    """ArduCopter's custom modes."""

    STABILIZE = 0
    ALT_HOLD = 2
    AUTO = 3
    GUIDED = 4
    LOITER = 5
    RTL = 6
    LAND = 9
    POSHOLD = 16
    BRAKE = 17


LEVEL = (Mode.STABILIZE, Mode.ALT_HOLD)
"""With the stick centred these keep level and the height, and drift with the wind."""
UNARMABLE = (Mode.RTL, Mode.LAND, Mode.AUTO, Mode.BRAKE)


class Phase(Enum):
    """The activity of the vehicle."""

    LANDED = "landed"
    SPOOL = "spool"
    CLIMB = "climb"
    FLY = "fly"
    RTL_CLIMB = "rtl climb"
    RTL_RETURN = "rtl return"
    RTL_HOLD = "rtl hold"
    DESCEND = "descend"
