"""Promises of a mission file, and the mission's view of a vehicle, in the referee's terms."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from shapely.geometry import Polygon

from missions.flight.vehicle_state import Phase, VehicleState
from missions.geo.grid import Grid
from missions.mission.schema import Mission, positions
from missions.units import GridPoint
from tests.referee import Bounds, Charge

CHARGES: Final[dict[Phase, Charge]] = {
    Phase.OFFLINE: "silent", Phase.GROUNDED: "ground", Phase.AIRBORNE: "mission",
    Phase.YIELDED: "others", Phase.GUARDED: "guardian", Phase.FINISHED: "home",
    Phase.FAILED: "over", Phase.DOWN: "down", Phase.LOST: "lost",
}  # fmt: skip


def claim(vehicle: VehicleState, *, returns: bool) -> tuple[Charge, str, bool]:
    """Return its charge, its order by name, and whether a mode of a pilot or a failsafe is known.

    `returns`: whether its autopilot flies it home.
    """
    order = "" if vehicle.order is None else type(vehicle.order).__name__
    known = vehicle.phase is Phase.YIELDED and vehicle.returns_by_itself >= returns
    return CHARGES[vehicle.phase], order, known


def is_reported(vehicle: VehicleState) -> bool:
    """Return whether the mission reports it as down, lost, silent or away from its pad."""
    return vehicle.phase in (Phase.DOWN, Phase.LOST, Phase.OFFLINE) or vehicle.landed_away_m > 0.0


def bounds_of(mission: Mission, grid: Grid, pads: Mapping[int, GridPoint], **more: Any) -> Bounds:
    """Return the promises of a mission file alone. `more`: further fields of `Bounds`."""
    fence = Polygon(
        [grid.fixed(p) for p in positions(mission.fence.polygon)],
        [[grid.fixed(p) for p in positions(hole)] for hole in mission.fence.holes],
    )
    reserve_wh = mission.battery.reserve * mission.battery.capacity_wh
    return Bounds(fence, pads, mission.team.separation_m, reserve_wh, **more)
