"""ArduCopter's modes, and what the vehicle is doing within them."""

from __future__ import annotations

from enum import Enum, IntEnum

from sitl.copter.control import Limits, sqrt_controller
from sitl.copter.params import Parameters

_LOWEST_RETURN_M = 2.0


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
"""With the stick centred these keep level and the height, and go wherever the wind takes them."""
UNARMABLE = (Mode.RTL, Mode.LAND, Mode.AUTO, Mode.BRAKE)


class Phase(Enum):
    """What the vehicle is doing."""

    LANDED = "landed"
    SPOOL = "spool"
    CLIMB = "climb"
    FLY = "fly"
    RTL_CLIMB = "rtl climb"
    RTL_RETURN = "rtl return"
    RTL_HOLD = "rtl hold"
    DESCEND = "descend"


def return_height(parameters: Parameters, away_m: float, height_m: float) -> float:
    """Height above home at which RTL flies back from `away_m`, now at `height_m`.

    RTL_ALT, less inside a cone over home, and at least RTL_CLIMB_MIN higher than it is.

    >>> return_height(Parameters(), away_m=100.0, height_m=12.0)
    15.0
    >>> return_height(Parameters(), away_m=4.5, height_m=12.0)
    13.5
    """
    wanted = parameters["RTL_ALT"] / 100.0
    slope = parameters["RTL_CONE_SLOPE"]
    if slope > 0.0:
        wanted = min(wanted, max(_LOWEST_RETURN_M, away_m * slope))
    return max(height_m + max(0.0, parameters["RTL_CLIMB_MIN"] / 100.0), wanted)


def landing_speed(parameters: Parameters, limits: Limits, height_m: float) -> float:
    """Descent at `height_m` above home: slow below LAND_ALT_LOW, braking towards it above.

    >>> landing_speed(Parameters(), Limits.of(Parameters(), 15.0, 3.0), height_m=3.0)
    0.5
    """
    slow = parameters.positive("LAND_SPEED", 30, 200) / 100.0
    above_m = height_m - parameters["LAND_ALT_LOW"] / 100.0
    if above_m <= 0.0:
        return slow
    speed = sqrt_controller(above_m, limits.p_z, limits.accel_z_m_s2)
    fast = parameters["LAND_SPEED_HIGH"] / 100.0
    return max(slow, min(fast if fast > 0.0 else limits.descent_m_s, speed))
