"""The way home of a vehicle whose mission has failed: inside of the fence as far as that goes."""

from __future__ import annotations

from missions.geo.fence import Fence
from missions.units import GridPoint


def corners_home(fence: Fence, position: GridPoint, home: GridPoint) -> tuple[GridPoint, ...]:
    """Where to turn until home lies straight ahead: an autopilot that returns knows no fence.

    Empty where nothing is in the way, and where no way is known: outside of the fence already,
    or with a home that cannot be reached.

    >>> yard = [GridPoint(0, 0), GridPoint(50, 0), GridPoint(50, 50), GridPoint(0, 50)]
    >>> house = [GridPoint(20, 10), GridPoint(30, 10), GridPoint(30, 40), GridPoint(20, 40)]
    >>> fence = Fence.of(yard, [house], margin_m=2.0)
    >>> corners_home(fence, GridPoint(40, 12), GridPoint(10, 10))
    (GridPoint(east_m=32.0, north_m=8.0), GridPoint(east_m=18.0, north_m=8.0))
    >>> corners_home(fence, GridPoint(40, 5), GridPoint(10, 5))
    ()
    """
    if not fence.contains(position):
        return ()
    route = fence.route(position, home) or fence.route_near(position, home) or ()
    return route[:-1]
