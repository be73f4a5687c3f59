"""Where the vehicles stand before take-off."""

from __future__ import annotations

from missions.geo.grid import Grid
from missions.mission.schema import Mission
from missions.units import GridPoint, LatLon

SMALLEST_GAP_M = 8.0
"""Vehicles in a row stand at least this far apart: room for a person to swap a battery."""


def homes(mission: Mission) -> tuple[LatLon, ...]:
    """The place of every vehicle, in the order of `mission.vehicles`.

    A vehicle with a `home` stands there. The others stand in a row from the start towards grid
    east, `max(2 * separation_m, 8)` metres apart, each at the place of its own number, so that
    the first of the file stands at the start. Raises `GeodesyError` outside 80 S to 84 N.
    """
    grid = Grid.at(mission.home, mission.grid.cell_m)
    gap_m = max(2 * mission.team.separation_m, SMALLEST_GAP_M)
    return tuple(
        LatLon(*vehicle.home)
        if vehicle.home is not None
        # exactly the start, not its image through the projection and back
        else (grid.position(GridPoint(i * gap_m, 0.0)) if i else mission.home)
        for i, vehicle in enumerate(mission.vehicles)
    )
