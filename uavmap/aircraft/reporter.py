"""The reports of a vehicle to the mission: telemetry in the mission's units, rounded."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Concatenate, Final, ParamSpec

from missions.errors import LinkError
from missions.events import Event
from missions.geo.grid import Grid
from missions.units import GridPoint, LatLon
from uavmap.mavlink.vehicle_view import VehicleView

P = ParamSpec("P")
Report = Callable[[Event], None]

BATTERY_STALE_S: Final = 10.0
"""Maximum age of a charge, s; without a newer one the vehicle returns while it can."""


@dataclass(slots=True, eq=False)
class Reporter:
    """Events of one vehicle, and lines about it, in mission time and the fixed frame."""

    number: int
    name: str
    view: VehicleView
    capacity_wh: float
    grid: Grid
    now_s: Callable[[], float]
    """Mission time, s."""
    loop_s: Callable[[], float]
    """The loop's clock, s."""
    battery_stale_s: float = BATTERY_STALE_S
    """Age from which a charge is unknown, s of the loop's clock."""
    operator: Callable[[str], None] = lambda text: None
    report: Report = lambda event: None
    """Takes an event to the mission."""

    def line(self, text: str) -> None:
        """Log a line for the operator; a terminal that is gone keeps no aircraft in the air."""
        with contextlib.suppress(Exception):
            self.operator(text)

    def t_s(self) -> float:
        """Mission time, to a millisecond."""
        return round(self.now_s(), 3)

    def report_now(
        self, kind: Callable[Concatenate[int, float, P], Event], *values: P.args, **named: P.kwargs
    ) -> None:
        """Report an event of the vehicle, at the present time."""
        self.report(kind(self.number, self.t_s(), *values, **named))

    def position(self) -> GridPoint:
        """Return the vehicle's position, in the fixed frame. Raises `LinkError` if it is not
        reported."""
        return self._place(self.view.position, "it is")

    def home(self) -> GridPoint:
        """Return its home, in the fixed frame. Raises `LinkError` if it is not reported."""
        return self._place(self.view.home, "its home is")

    def _place(self, position: LatLon | None, what: str) -> GridPoint:
        """Return a position in the fixed frame, to a centimetre."""
        if position is None:
            raise LinkError(f"{self.name}: the vehicle has not reported where {what}")
        point = self.grid.fixed(position)
        return GridPoint(round(point.east_m, 2), round(point.north_m, 2))

    def height_m(self) -> float:
        """Return the height above home, to a centimetre, m."""
        return round(self.view.height_m, 2)

    def home_amsl_m(self) -> float:
        """Return the height of home above the sea, to a decimetre, m."""
        return round(self.view.home_amsl_m, 1)

    def remaining_wh(self) -> float | None:
        """Return the charge, Wh; None when it is unknown or too old."""
        if self.loop_s() - self.view.battery_s > self.battery_stale_s:
            return None
        return self.view.remaining_wh(self.capacity_wh)

    def remaining(self) -> float:
        """Return the charge for an event, Wh.

        0 if it is unknown or the autopilot reports it as low: the vehicle returns, and does not
        take off.
        """
        return 0.0 if self.view.grounded_by else round(self.remaining_wh() or 0.0, 3)
