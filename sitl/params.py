"""The parameters of the simulated ArduCopter: only those that change what it does."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Parameter:
    """Name, default and MAV_PARAM_TYPE (2 INT8, 4 INT16, 9 REAL32), as in ArduCopter 4.6."""

    name: str
    default: float
    type: int


INT8, INT16, REAL32 = 2, 4, 9

TABLE = (
    Parameter("ATC_SLEW_YAW", 6000.0, REAL32),  # centidegrees/s
    Parameter("DISARM_DELAY", 10, INT8),  # s
    Parameter("GUID_TIMEOUT", 3.0, REAL32),  # s
    Parameter("LAND_ALT_LOW", 1000, INT16),  # cm
    Parameter("LAND_SPEED", 50, INT16),  # cm/s
    Parameter("PSC_POSXY_P", 1.0, REAL32),  # 1/s
    Parameter("PSC_POSZ_P", 1.0, REAL32),  # 1/s
    Parameter("RTL_ALT", 1500, INT16),  # cm
    Parameter("RTL_CONE_SLOPE", 3.0, REAL32),  # metres up a metre away
    Parameter("RTL_LOIT_TIME", 5000, INT16),  # ms
    Parameter("WPNAV_ACCEL", 250.0, REAL32),  # cm/s^2
    Parameter("WPNAV_ACCEL_Z", 100.0, REAL32),  # cm/s^2
    Parameter("WPNAV_SPEED", 1000.0, REAL32),  # cm/s
    Parameter("WPNAV_SPEED_DN", 150.0, REAL32),  # cm/s
    Parameter("WPNAV_SPEED_UP", 250.0, REAL32),  # cm/s
    Parameter("WP_YAW_BEHAVIOR", 2, INT8),  # 0: keep the heading
)

_INTEGER_RANGE = {INT8: 127, INT16: 32767}


class Parameters:
    """Values by name and by index, in alphabetical order.

    >>> parameters = Parameters()
    >>> parameters.set("RTL_ALT", 2000.7)
    True
    >>> parameters["RTL_ALT"]
    2000.0
    """

    def __init__(self) -> None:
        self._values = {p.name: float(p.default) for p in TABLE}
        # raised at every change, so that what is derived from parameters can be cached
        self.version = 0

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def set(self, name: str, value: float) -> bool:
        """Set as ArduPilot does: no range check, fractions of integers cut.

        False, and nothing changed, for an unknown name or a value that is not a finite number.
        """
        parameter = BY_NAME.get(name)
        if parameter is None or not math.isfinite(value):
            return False
        limit = _INTEGER_RANGE.get(parameter.type)
        if limit is not None:
            value = float(max(-limit - 1, min(limit, math.trunc(value))))
        self._values[name] = value
        self.version += 1
        return True

    def positive(self, name: str, low: float, high: float) -> float:
        """A value held to a range in which flying is possible."""
        return max(low, min(high, self._values[name]))


BY_NAME = {p.name: p for p in TABLE}
INDEX = {p.name: i for i, p in enumerate(TABLE)}
