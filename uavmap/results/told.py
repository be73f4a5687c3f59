"""What every file says of the map that it holds, in the same words."""

from __future__ import annotations

from typing import Any

from uavmap import __version__
from uavmap.printable import printable
from uavmap.results.flown import Flown


def described(flown: Flown) -> dict[str, Any]:
    """Mission, version, dates, coordinate system and extent, by name."""
    data, found = flown.data, flown.extent
    return {
        "mission": data.mission,
        "completed": flown.completed,
        "finding": printable(str(flown.values.get("finding", ""))),
        "version": __version__,
        "begun_utc": flown.calendar.utc(0.0),
        "map_utc": flown.calendar.utc(data.t_s),
        "t_s": round(data.t_s, 3),
        "simulated": flown.simulated,
        "computed_in": flown.crs,
        "area_m2": round(found.area_m2, 1),
        "area_low_m2": round(found.low_m2, 1),
        "area_high_m2": round(found.high_m2, 1),
        "perimeter_m": round(found.perimeter_m, 1),
    }


def in_words(flown: Flown) -> str:
    """The same in a line, for formats that have room for a description only."""
    told = {name: value for name, value in described(flown).items() if value not in (None, "")}
    return "; ".join(f"{name} {_word(value)}" for name, value in told.items())


def _word(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return str(value)
