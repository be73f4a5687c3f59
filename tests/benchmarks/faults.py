"""What must not happen in a flight with a fault, whatever the fault and the phase."""

from __future__ import annotations

from tests.benchmarks.watched import Flown

UNSEEN = ("gps", "compass deg=90", "wind_gust", "motor share=0.0")
"""Where a vehicle may leave its fence: GNSS that lies or is gone, a heading far off, more wind than
the airframe holds, no thrust."""
FORBIDDEN = frozenset({"air", "lie", "unrep", "end", "tb", "late", "far"})


def forbidden(flight: Flown) -> frozenset[str]:
    """What must not be, of what came of it."""
    # no charge is left, or nobody can tell it to come home
    spent = flight.name.startswith(("battery_cell", "link silent")) and "ever" in flight.name
    more = set() if spent else {"res"}
    if not flight.name.startswith(UNSEEN):
        more |= {"breach"}
    # a slow, steady lie of position and speed alike looks like wind: the map is where GNSS says
    unseen = {"lie"} if flight.name.startswith("gps_drift") else set()
    return flight.columns & (FORBIDDEN | more) - unseen
