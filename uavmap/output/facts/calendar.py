"""Mission seconds as dates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any, Final, Literal

from uavmap.journal.flight_plan import FlightPlan

TAKEN: Final = "taken"
"""In the journal's meta of a replay: when its first picture was taken, and by which clock."""
_1970: Final = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, slots=True)
class Calendar:
    """The dates of mission seconds.

    Attributes:
        zero_s: Seconds since 1970 at mission time 0; None where unknown.
        rate: Seconds of the calendar in a mission second.
        clock: `utc`; `camera`, a clock without a zone; `simulated`: UTC of a world that begins on
            2020-01-01 in each flight.
    """

    zero_s: float | None
    rate: float = 1.0
    clock: Literal["utc", "camera", "simulated"] = "utc"

    @classmethod
    def of_flight(cls, plan: FlightPlan) -> Calendar:
        """Create the calendar of a flight."""
        if plan.simulated:
            return cls(plan.epoch_utc_s, clock="simulated")
        return cls(plan.epoch_utc_s, 1.0 / (plan.speedup or 1.0))

    @classmethod
    def of_replay(cls, taken: object) -> Calendar:
        """Create the calendar of recorded pictures, from the meta of their journal."""
        first_s = taken.get("first_s") if isinstance(taken, Mapping) else None
        if not isinstance(taken, Mapping) or not isinstance(first_s, int | float):
            return cls(None)
        return cls(float(first_s), clock="utc" if taken.get("clock") == "utc" else "camera")

    def utc(self, t_s: float) -> str | None:
        """Write UTC to a millisecond, as ISO 8601 and GeoPackage have it; None where unknown.

        >>> Calendar(1577836800.0).utc(61.5)
        '2020-01-01T00:01:01.500Z'
        >>> Calendar(0.0, clock="camera").utc(1.0) is None
        True
        """
        date = None if self.clock == "camera" else self.date(t_s)
        return None if date is None else f"{date:%Y-%m-%dT%H:%M:%S}.{date.microsecond // 1000:03}Z"

    def told(self, t_s: float) -> str:
        """Write a date to a second, for people.

        >>> Calendar(0.0, clock="camera").told(3600.0), Calendar(None).told(1.0)
        ("1970-01-01 01:00:00 by the camera's clock", 'not known')
        """
        date = self.date(t_s)
        if date is None:
            return "not known"
        zone = {"utc": " UTC", "camera": " by the camera's clock", "simulated": " UTC, simulated"}
        return f"{date:%Y-%m-%d %H:%M:%S}{zone[self.clock]}"

    def date(self, t_s: float) -> datetime | None:
        """Return the date; that of a camera's clock has a zone without meaning."""
        if self.zero_s is None:
            return None
        try:
            return _1970 + timedelta(milliseconds=round(1e3 * (self.zero_s + t_s * self.rate)))
        except (OverflowError, ValueError):  # a journal may hold any number
            return None


def taken_meta(first_s: float | None, clock: str) -> dict[str, Any]:
    """Create the meta of a replay's journal from the time of its first picture."""
    return {TAKEN: {"first_s": first_s, "clock": clock}}
