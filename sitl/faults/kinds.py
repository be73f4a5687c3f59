"""The vocabulary of faults: their kinds, and one of them with its time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

from sitl.faults.lossy_radio import CLEAN, LinkQuality

Kind: TypeAlias = Literal[
    "gps", "gps_glitch", "gps_drift", "battery_sag", "battery_voltage", "battery_cell", "compass",
    "wind_gust", "motor", "camera_stall", "camera_black", "camera_corrupt", "reject", "rc",
    "link_up", "link_down", "companion_reboot",
]  # fmt: skip
Way: TypeAlias = Literal["both", "up", "down"]


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault: from `begin_s` to before `end_s`, vehicle time.

    `numbers` are the kind's own: metres, m/s, volts, radians. `source` names a parameter that
    holds the fault, which replaces what it held before.
    """

    kind: Kind
    begin_s: float
    end_s: float
    numbers: tuple[float, ...] = ()
    quality: LinkQuality = CLEAN
    source: str = ""


def towards(size: float, bearing_deg: float) -> tuple[float, float]:
    """East and north of a length towards a true bearing."""
    bearing = math.radians(finite(bearing_deg))
    return size * math.sin(bearing), size * math.cos(bearing)


def finite(value: float) -> float:
    """The number, if it is one."""
    if not math.isfinite(value):
        raise ValueError(f"not a number to fly with: {value}")
    return value


def kinds_of(kind: str) -> tuple[str, ...]:
    """What a name stands for: "link" is both ways."""
    if kind == "link":
        return "link_up", "link_down"
    if kind not in get_args(Kind):
        raise ValueError(f"no such kind of fault: {kind}; there are {', '.join(get_args(Kind))}")
    return (kind,)
